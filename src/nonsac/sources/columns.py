"""Which columns of a file are read, and whether they hold numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from nonsac.files.column_names import find_places, listing
from nonsac.files.errors import FilePath, input_error, not_held
from nonsac.layouts import WEIGHT, Layout
from nonsac.sources.contract import Source
from nonsac.values.checks import iterable
from nonsac.values.numeric import shown
from nonsac.values.quiet import as_doubles


def names_of_table(rows: Any) -> tuple[str, ...] | None:
    """What the columns of a table in memory (of pandas, polars or Arrow) are called; None for what has no names."""
    held = getattr(rows, "column_names", getattr(rows, "columns", None))
    names = tuple(held) if isinstance(held, Iterable) else ()
    return names if names and all(isinstance(name, str) for name in names) else None


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
    given = iterable("columns", columns, "a sequence of positions or names")
    chosen = [_position(path, column, width, names) for column in given]
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
    try:
        kind = np.dtype(dtype)
    except (TypeError, ValueError, AttributeError, SyntaxError):
        raise TypeError(f"dtype must be a type of numbers, such as '<f8', got {shown(dtype)}") from None
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
        return as_doubles(array[first:last])[:, None]
    low, high = min(columns), max(columns) + 1
    return as_doubles(array[first:last, low:high])[:, np.subtract(columns, low)]


def arranged(source: Source, layout: Layout) -> Source:
    """The source with the columns of a layout, in its order, and with its weight in the last column, if it has one.

    If the source names its columns, they are found by name (`nonsac.files.column_names`); if not, it must have as many
    as the layout, or one more for a weight.

    Raises
    ------
    ValueError
        If some are missing; the message says which, and what the source has.
    """
    names, width = source.about.names, len(layout.names)
    if names is None:
        if source.width not in (width, width + 1):
            transposed = len(source) in (width, width + 1)
            raise ValueError(unfit(source.width, layout, "transpose it, one row per match" if transposed else ""))
        return source
    chosen = places_in(names, layout)
    return source if chosen == list(range(source.width)) else source.narrowed(chosen)


def places_in(names: Sequence[str], layout: Layout) -> list[int]:
    """Where the columns of a layout are, in its order, and then that of a weight, if there is one.

    Raises
    ------
    ValueError
        If some are missing, or if several could be meant; the message says which, and what names there are.
    """
    held, wanted = f"rows of {len(names)} columns ({listing(names)})", " ".join(layout.names)
    fix = f"rename the columns, or choose them, by name or position (columns=, --columns), in the order of {wanted}"
    try:
        places, weight = find_places(names, layout.names, layout.split), find_places(names, [WEIGHT])
    except ValueError as error:
        raise ValueError(f"{held}, where {error}; {fix}") from None
    missing = [name for name, place in zip(layout.names, places, strict=True) if place is None]
    if missing:
        raise ValueError(f"{held}, of which none is called {' '.join(missing)}; {fix}")
    return [place for place in (*places, *weight) if place is not None]


def unfit(held: int, layout: Layout, fix: str = "") -> str:
    """Says that rows without names have another number of columns than a layout, and what to do."""
    width = len(layout.names)
    fix = fix or ("choose columns" if held > width else f"choose columns of a table that has all {width}")
    return f"rows of {held} columns, not of {width} ({' '.join(layout.names)}), or {width + 1} with a weight; {fix}"
