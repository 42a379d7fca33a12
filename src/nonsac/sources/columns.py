"""Which columns of a file are read, and whether they hold numbers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from nonsac.files.errors import FilePath, input_error, not_held
from nonsac.layouts import WEIGHT, Columns
from nonsac.sources.contract import Source
from nonsac.sources.mapped import ColumnMap, MappedSource


def choose_columns(
    path: FilePath, columns: Sequence[int | str] | None, width: int, names: Sequence[str] | None = None
) -> list[int]:
    """The positions of the columns asked for by position or name, by default all of them.

    Raises
    ------
    TypeError
        If `columns` is no sequence of positions or names.
    InputError
        If the file holds no such column, or none is asked for.
    """
    if columns is None:
        return list(range(width))
    if isinstance(columns, str):
        raise TypeError(f"columns must be a sequence of positions or names, got {columns!r}")
    chosen = [_position(path, column, width, names) for column in columns]
    if not chosen:
        raise input_error(path, "none of its columns is asked for", "leave columns out to read all of them")
    return chosen


def _position(path: FilePath, column: Any, width: int, names: Sequence[str] | None) -> int:
    held = [str(position) for position in range(width)] if names is None else list(names)
    if isinstance(column, str):
        if column in (names or ()):
            return held.index(column)
        raise not_held(path, f"column {column!r}", held)
    if isinstance(column, bool) or not isinstance(column, (int, np.integer)):
        raise TypeError(f"columns must hold positions or names, got {column!r}")
    if not 0 <= column < width:
        raise not_held(path, f"column {column}", held)
    return int(column)


def real_dtype(path: FilePath, dtype: DTypeLike, what: str = "numbers") -> np.dtype[Any]:
    """The dtype, if it is one of real numbers."""
    kind = np.dtype(dtype)
    if kind.kind not in "fiu":
        raise input_error(path, f"holds {what} of type {kind}", "give real numbers, integers or floating-point")
    return kind


def common_length(path: FilePath, shapes: Sequence[tuple[int, ...]]) -> tuple[int, list[int]]:
    """Number of rows, and widths, of arrays (n,) or (n, d) that are to stand side by side."""
    for shape in shapes:
        if len(shape) not in (1, 2) or 0 in shape[1:]:
            raise input_error(path, f"holds an array of shape {shape}, not (n, d) or (n,)", "name another one")
    lengths = [shape[0] for shape in shapes]
    if len(set(lengths)) != 1:
        problem = f"its arrays have {', '.join(map(str, lengths)) or 'no'} rows"
        raise input_error(path, problem, "name arrays of equal length to stand side by side")
    return lengths[0], [shape[1] if len(shape) == 2 else 1 for shape in shapes]


def split_columns(chosen: Sequence[int], widths: Sequence[int]) -> list[tuple[int, list[int]]]:
    """Where columns of arrays that stand side by side come from: runs of an array and the columns in it."""
    homes = [(array, column) for array, width in enumerate(widths) for column in range(width)]
    runs = groupby((homes[position] for position in chosen), key=lambda home: home[0])
    return [(array, [column for _, column in run]) for array, run in runs]


def read_columns(array: Any, first: int, last: int, columns: list[int]) -> NDArray[np.float64]:
    """Columns of the rows `first` to `last - 1` of an array (n, d) or (n,) of HDF5 or Zarr."""
    if array.ndim == 1:
        return np.asarray(array[first:last], np.float64)[:, None]
    low, high = min(columns), max(columns) + 1
    return np.asarray(array[first:last, low:high], np.float64)[:, np.subtract(columns, low)]


def pick_columns(source: Source, columns: Columns) -> Source:
    """The source with the columns of these names, and the weight, if it has them; else as it is, if it fits.

    As it is, too, where `open_source` was told which columns to take: their order is that of the user.

    Raises
    ------
    ValueError
        Where it has another number of columns, or some of these names at other places and lacks the rest; the message
        says how many, and which.
    """
    names, width = tuple(getattr(source, "names", None) or ()), len(columns.names)
    given = getattr(source, "columns_given", False)
    places = [None if given else _place(name, names) for name in columns.names]
    chosen = [names[place] for place in places if place is not None]
    if len(chosen) == width:
        return _with_columns(source, [*chosen, WEIGHT] if WEIGHT in names else chosen)
    held = f"rows of {source.width} columns" + (f" ({' '.join(names)})" if names else "")
    if source.width not in (width, width + 1):
        expected = f"{width} ({' '.join(columns.names)}), or {width + 1} with a weight"
        raise ValueError(f"{held}, not of {expected}; choose columns")
    if any(place not in (None, position) for position, place in enumerate(places)):
        missing = " ".join(name for name, place in zip(columns.names, places, strict=True) if place is None)
        raise ValueError(f"{held}, of which none is called {missing}; rename the columns, or choose others")
    return source


def _place(name: str, names: Sequence[str]) -> int | None:
    """Where a name is, in whatever case; the exact one is preferred."""
    if name in names:
        return names.index(name)
    folded = [other.lower() for other in names]
    return folded.index(name.lower()) if folded.count(name.lower()) == 1 else None


def _with_columns(source: Source, chosen: Sequence[str]) -> Source:
    names = list(source.names)  # type: ignore[attr-defined]
    if list(chosen) == names:
        return source
    if hasattr(source, "with_columns"):
        return source.with_columns(chosen)
    return MappedSource(source, ColumnMap(tuple(names.index(name) for name in chosen)))
