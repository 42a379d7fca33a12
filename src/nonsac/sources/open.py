"""Opening a file as a source: its content says of which kind."""

from __future__ import annotations

import glob
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from nonsac.files.arrays import Archive, as_rows, open_npz
from nonsac.files.column_names import is_wanted_anywhere, listing, place_of
from nonsac.files.content import UTF16, check_regular, content_kind, with_article
from nonsac.files.errors import FilePath, InputError, input_error, not_held
from nonsac.files.paths import file_errors, holds, is_folder, is_url, read_head
from nonsac.files.pipes import is_stream
from nonsac.files.text import is_number, read_table
from nonsac.layouts import MATCHES, PAIRS, POINTS, WEIGHT, Layout
from nonsac.sources.array import ArraySource
from nonsac.sources.columns import arranged, places_in, unfit
from nonsac.sources.contract import Source
from nonsac.values.checks import file_name, listed, whole_number
from nonsac.values.numeric import shown
from nonsac.values.quiet import quiet

Columns = Sequence[str | int] | None
_KNOWN = (MATCHES, POINTS, PAIRS)
_HEAD_LENGTH = 4096
_FILES_OF_ZARR = ("zarr.json", ".zarray", ".zgroup")


def open_source(
    path: FilePath | Sequence[FilePath],
    *,
    layout: Layout | str | None = None,
    columns: Columns = None,
    dataset: str | None = None,
) -> Source:
    """Open a file of rows; its first bytes say of which kind it is, whatever its name.

    Parameters
    ----------
    path : path, URL or sequence of paths or URLs
        - Parquet, Arrow or Feather files, one or many, a folder of them or a pattern with `*`: `ParquetSource`;
        - a Zarr array, or a group with one: `ZarrSource`;
        - NumPy's .npy: `NpySource`; HDF5: `Hdf5Source`; LAS or LAZ: `LasSource`;
        - .npz, CSV and other tables of text, which are read whole, into memory: `ArraySource`.

        Parquet, Arrow and Zarr may be at any URL that fsspec knows. Raw numbers say nothing of their kind and need
        `RawSource`.
    layout : Layout or str, optional
        The columns that are needed, as "x1 y1 | x2 y2": they are found by name if the file names its columns, in
        whatever case and order, and a column `weight` comes last. The calls do this by themselves.
    columns : sequence of str or int, optional
        The columns wanted, in this order, whatever their names mean: by position from 0 or, if they have names
        (Parquet, Arrow, text with a header line, structured arrays, arrays (n,) of HDF5 and Zarr), by name. By default
        all; in Parquet and Arrow all columns of numbers. In an .npz the columns of both parts, as `points1` and
        `points2`, count on.
    dataset : str, optional
        Which array of an HDF5 file, a Zarr group or an .npz is meant, if there are several.

    Returns
    -------
    Source

    Raises
    ------
    ValueError
        If `columns` chooses more or fewer than the layout has.
    InputError
        If there is no such file, its kind is unknown or unfit, or it lacks what was asked for.
    """
    if not isinstance(path, (str, os.PathLike)):
        path = listed("path", path, "a path, or several")
    _check_types(path, layout, columns, dataset)
    asked = _Asked(_layout_of(layout) if isinstance(layout, str) else layout, columns, dataset)
    _check_chosen(asked)
    source = _opened(path, asked)
    if asked.layout is None:
        return source
    try:
        return arranged(source, asked.layout)
    except ValueError as error:
        name = path if isinstance(path, (str, os.PathLike)) else next(iter(path))
        raise InputError(f"{name}: {error}") from None


def _check_types(path: Any, layout: Any, columns: Any, dataset: Any) -> None:
    for name in [path] if isinstance(path, (str, os.PathLike)) else path:
        file_name("path", name)
    if layout is not None and not isinstance(layout, (str, Layout)):
        raise TypeError(f'layout must be a nonsac.Layout or a string such as "x1 y1 | x2 y2", got {shown(layout)}')
    if columns is not None and not isinstance(columns, Sequence) and np.ndim(columns) != 1:
        raise TypeError(f"columns must be a sequence of positions or names, got {shown(columns)}")
    if dataset is not None and not isinstance(dataset, str):
        raise TypeError(f"dataset must be the name of an array, got {shown(dataset)}")


def _check_chosen(asked: _Asked) -> None:
    if asked.layout is None or asked.columns is None or isinstance(asked.columns, str):
        return
    chosen, width = len(asked.columns), len(asked.layout.names)
    if chosen not in (width, width + 1):
        names = " ".join(asked.layout.names)
        raise ValueError(f"columns must choose {width} ({names}), or {width + 1} with a weight; got {chosen}")


def _layout_of(columns: str) -> Layout:
    """The layout of these columns; the known one, which also has keys, if there is one."""
    layout = Layout(columns)
    return next((known for known in _KNOWN if (known.names, known.split) == (layout.names, layout.split)), layout)


@dataclass(frozen=True)
class _Asked:
    """What is wanted of a file."""

    layout: Layout | None
    columns: Columns
    dataset: str | None


def _opened(path: FilePath | Sequence[FilePath], asked: _Asked) -> Source:
    if not isinstance(path, (str, os.PathLike)):
        return _open_parquet(path, asked)
    name = os.fspath(path)
    kind = _kind_of(name)
    if kind not in _OPENERS:
        fix = "save it as UTF-8 text" if kind == UTF16 else f"give one of {', '.join(_OPENERS)}"
        raise input_error(name, f"is no table of rows, it looks like {with_article(kind)}", fix)
    if asked.dataset is not None and kind not in _WITH_DATASETS:
        raise input_error(name, f"holds no datasets, it is {with_article(kind)}", "leave the dataset out")
    if is_url(name) and kind not in _BEHIND_URLS:
        raise input_error(name, f"{with_article(kind)} cannot be read from a URL", "download it first")
    return _OPENERS[kind](name, asked)


def holds_rows(folder: str) -> bool:
    """Whether a folder is a Zarr array or has Parquet or Arrow files, and is not the folder of a COLMAP model, say."""
    from nonsac.sources.parquet import SUFFIXES

    if any(os.path.exists(os.path.join(folder, name)) for name in _FILES_OF_ZARR):
        return True
    return any(name.lower().endswith(SUFFIXES) for _, _, names in os.walk(folder) for name in names)


def _kind_of(path: str) -> str:
    if glob.has_magic(path) and (is_url(path) or not os.path.exists(path)):
        return "Parquet file"
    if is_stream(path):
        return "text table"
    if is_folder(path):
        return "Zarr folder" if any(holds(path, name) for name in _FILES_OF_ZARR) else "Parquet file"
    if not is_url(path):
        check_regular(path)
    head = read_head(path, _HEAD_LENGTH)
    if not head:
        raise input_error(path, "the file is empty", "write or copy it again")
    return content_kind(head)


def _open_npy(path: str, asked: _Asked) -> Source:
    from nonsac.sources.npy import NpySource

    return NpySource(path, columns=asked.columns)


def _open_hdf5(path: str, asked: _Asked) -> Source:
    from nonsac.sources.hdf5 import Hdf5Source

    if asked.dataset is None and _are_names(asked.columns):
        return Hdf5Source(path, asked.columns)
    return Hdf5Source(path, _datasets(path, asked) if asked.dataset is None else asked.dataset, columns=asked.columns)


def _open_zarr(path: str, asked: _Asked) -> Source:
    from nonsac.sources.zarr import ZarrSource

    array = _arrays(path, asked) if asked.dataset is None else asked.dataset
    return ZarrSource(path, array=array, columns=asked.columns)


def _open_las(path: str, asked: _Asked) -> Source:
    from nonsac.sources.las import LasSource

    if asked.columns is not None:
        raise input_error(path, "the columns of LAS files are always x, y, z", "leave the columns out")
    return LasSource(path)


def _open_parquet(paths: FilePath | Sequence[FilePath], asked: _Asked) -> Source:
    from nonsac.sources.parquet import ParquetSource

    source = ParquetSource(paths, asked.columns)
    if asked.layout is not None and asked.columns is None:
        _check_numbers(source.paths[0], asked.layout, source.names, source.other_columns)
    return source


def _check_numbers(path: str, layout: Layout, names: Sequence[str], others: Mapping[str, str]) -> None:
    """Refuse columns that have the right name but cannot be read, and so are not among `names`."""
    for name in (*layout.names, WEIGHT):
        place = place_of(name, list(others))
        if place_of(name, names) is None and place is not None:
            held = list(others)[place]
            fix = "save one column of numbers under this name, or choose other columns"
            raise input_error(path, f"column {held!r} {others[held]}", fix)


def _open_npz(path: str, asked: _Asked) -> Source:
    if asked.dataset is not None:
        return _narrowed(path, _named_array(path, asked.dataset), asked.columns)
    return _narrowed(path, _open_archive(path, asked.layout if asked.columns is None else None), asked.columns)


def _named_array(path: str, name: str) -> ArraySource:
    with open_npz(path) as archive:
        if name not in archive.names:
            raise not_held(path, f"array {name!r}", archive.names)
        array = archive.load(name)
    if array.ndim != 2:
        raise input_error(path, f"the array {name!r} has the shape {array.shape}, not (n, D)", "name one with rows")
    return _of_numbers(path, [array])


def _open_archive(path: str, layout: Layout | None) -> ArraySource:
    """Both parts of the rows under their keys, and the weights; else the only array that fits."""
    layouts = _KNOWN if layout is None else (layout,)
    with open_npz(path) as archive:
        if layout is not None and (columns := _columns_in_archive(archive, layout)):
            return _of_numbers(path, columns)
        keys = [pair for known in layouts for pair in known.keys]
        pair = next((pair for pair in keys if set(pair) <= set(archive.names)), None)
        if pair is not None:
            parts = [archive.load(name) for name in pair]
            if layout is not None:
                parts = [as_rows(path, part, width) for part, width in zip(parts, layout.widths, strict=True)]
        elif layout is None:
            held = [name for name in archive.names if len(archive.shape(name)) == 2]
            parts = [archive.load(_the_only(path, held))]
        else:
            fix = f"save it under {' or '.join('/'.join(names) for names in keys)}" if keys else "save one array (n, D)"
            parts = [archive.load_only([len(layout.names), len(layout.names) + 1], fix)]
        if "weights" in archive.names and layout is not None and sum(map(_columns_in, parts)) == len(layout.names):
            parts.append(_weights(archive, len(parts[0])))
    return _of_numbers(path, parts, layout)


def _columns_in_archive(archive: Archive, layout: Layout) -> list[NDArray[Any]]:
    """The arrays (n, 1) of a layout's columns and of the weights, if the archive has an array (n,) for each column."""
    if not set(layout.names) <= set(archive.names):
        return []
    weight = next((name for name in (WEIGHT, "weights") if name in archive.names), None)
    columns = [archive.load(name) for name in (*layout.names, *([] if weight is None else [weight]))]
    return [column[:, None] for column in columns] if all(column.ndim == 1 for column in columns) else []


def _columns_in(part: NDArray[Any]) -> int:
    return part.shape[1] if part.ndim == 2 else 0


def _weights(archive: Archive, rows: int) -> NDArray[Any]:
    weights = archive.load("weights")
    if weights.shape != (rows,) or weights.dtype.kind not in "iuf":
        problem = f"the array weights has the shape {weights.shape} and the type {weights.dtype}"
        raise input_error(archive.path, problem, "save one number for every match")
    return weights[:, None]


@quiet
def _of_numbers(path: str, parts: Sequence[NDArray[Any]], layout: Layout | None = None) -> ArraySource:
    if any(part.ndim == 0 or 0 in part.shape[1:] for part in parts):
        raise input_error(path, "holds single numbers or nothing where rows are", "save one row for every match")
    lengths = [len(part) for part in parts]
    if len(set(lengths)) > 1:
        problem = f"its arrays have {' and '.join(map(str, lengths))} rows, which should match one by one"
        clouds = "" if layout not in (None, PAIRS) else "; for unmatched clouds use `nonsac register-clouds`"
        raise input_error(path, problem, f"save one row of each for every match{clouds}")
    try:
        return ArraySource(parts[0] if len(parts) == 1 else np.hstack(parts))
    except (TypeError, ValueError) as error:
        raise input_error(path, f"holds no rows of numbers ({error})", "save arrays (n, D) of equal length") from error


def _datasets(path: str, asked: _Asked) -> str | Sequence[str]:
    """The datasets of an HDF5 file that hold the columns of the layout, or else the only one (n, D) of numbers."""
    from nonsac.files.hdf5 import nodes_of, open_hdf5

    with open_hdf5(path) as file:
        nodes = nodes_of(file)
        tables = [name for name, node in nodes if _is_table(node)]
        columns = [name for name, node in nodes if "/" not in name and _is_column(node)]
    return _named_in(path, asked, columns, tables) or _the_only(path, tables)


def _arrays(path: str, asked: _Asked) -> str | Sequence[str] | None:
    """The arrays of a Zarr group, likewise, or those of the columns asked for; None for an array."""
    from nonsac.sources.zarr import check_metadata

    try:
        import zarr
    except ImportError:
        return None  # ZarrSource says so
    with file_errors(path), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of files that lie beside
        check_metadata(path)
        opened = zarr.open(path, mode="r")
        if not isinstance(opened, zarr.Group):
            return None
        if _are_names(asked.columns):
            return asked.columns
        held = list(opened.arrays())
    tables, columns = [n for n, each in held if _is_table(each)], [n for n, each in held if _is_column(each)]
    return _named_in(path, asked, columns, tables) or _the_only(path, tables)


def _named_in(path: str, asked: _Asked, columns: Sequence[str], tables: Sequence[str]) -> Sequence[str] | None:
    """The arrays (n,) that are named as the columns of the layout; refused if there are others, and no table."""
    if asked.layout is None or asked.columns is not None or not columns:
        return None
    try:
        return [columns[place] for place in places_in(columns, asked.layout)]
    except ValueError as error:
        if tables:
            return None
        raise InputError(f"{path}: {error}") from None


def _is_table(array: Any) -> bool:
    return getattr(array, "ndim", 0) == 2 and array.dtype.kind in "fiu"


def _is_column(array: Any) -> bool:
    return getattr(array, "ndim", 0) == 1 and array.dtype.kind in "fiu"


def _the_only(path: str, names: Sequence[str]) -> str:
    if len(names) != 1:
        problem = f"cannot tell which array holds the rows (n, D): {', '.join(names[:20]) or 'there is none'}"
        raise input_error(path, problem, "name one as the dataset, or arrays (n,) as columns")
    return names[0]


def _are_names(columns: Columns) -> TypeGuard[Sequence[str]]:
    """Whether columns are arrays (n,) of their own."""
    return columns is not None and all(isinstance(column, str) for column in columns)


def _open_text(path: str, asked: _Asked) -> Source:
    table = read_table(path)
    width, names = len(table.first_row() or table.names or ()), table.names
    if not width:
        raise input_error(path, "the file holds no rows", "export it again with its rows")
    if asked.columns is not None:
        return ArraySource(table.numbers(_columns_of(path, names, width, asked.columns)))
    if names is None:
        if asked.layout is not None and width > len(asked.layout.names) + 1:
            fix = f"choose columns, or name them in a header line: {' '.join(asked.layout.names)}"
            raise InputError(f"{path}: {unfit(width, asked.layout, fix)}")
        return ArraySource(table.numbers(range(width)))
    if asked.layout is not None:
        numbers = sorted(_places_in(path, names, asked.layout))
    else:
        numbers = _number_columns(table.first_row(), names)
    return ArraySource(table.numbers(numbers), [names[place] for place in numbers])


def _number_columns(row: Sequence[str], names: Sequence[str]) -> list[int]:
    """The columns that look like numbers, or that bear the name of some."""
    pairs = enumerate(zip(row, names, strict=False))
    found = [place for place, (word, name) in pairs if is_number(word) or is_wanted_anywhere(name)]
    return found or list(range(len(names)))


def _places_in(path: str, names: Sequence[str], layout: Layout) -> list[int]:
    try:
        return places_in(names, layout)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def _columns_of(path: str, names: Sequence[str] | None, width: int, columns: Sequence[str | int]) -> Sequence[int]:
    if names is None and any(isinstance(column, str) for column in columns):
        raise input_error(path, "has no header line, so its columns have no names", "give their positions, from 0")
    return _within(path, width, [_place(path, names or (), c) if isinstance(c, str) else c for c in columns])


def _place(path: str, names: Sequence[str], column: str) -> int:
    place = place_of(column, names)
    if place is None:
        problem = f"the header names no {column}, or several (it names {listing(names, ', ')})"
        raise input_error(path, problem, "check the names, or give positions, from 0")
    return place


def _narrowed(path: str, source: ArraySource, columns: Columns) -> ArraySource:
    if columns is None:
        return source
    if any(isinstance(column, str) for column in columns):
        raise input_error(path, "the columns of its arrays have no names", "give their positions, from 0")
    places = [whole_number("columns", column, 0) for column in columns]
    return ArraySource(source.rows[:, _within(path, source.width, places)])


def _within(path: str, width: int, columns: list[int]) -> list[int]:
    beyond = [column for column in columns if not 0 <= column < width]
    if beyond:
        raise input_error(path, f"holds {width} columns, no column {beyond[0]}", "count them from 0")
    return columns


_OPENERS: dict[str, Callable[[str, _Asked], Source]] = {
    "Parquet file": _open_parquet,
    "Arrow file": _open_parquet,
    "NumPy array": _open_npy,
    "NumPy archive": _open_npz,
    "HDF5 file": _open_hdf5,
    "Zarr folder": _open_zarr,
    "LAS file": _open_las,
    "text table": _open_text,
}
_WITH_DATASETS = ("HDF5 file", "Zarr folder", "NumPy archive")
_BEHIND_URLS = ("Parquet file", "Arrow file", "Zarr folder")
