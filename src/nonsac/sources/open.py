"""Opening a file as a source: its content says of which kind."""

from __future__ import annotations

import glob
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from nonsac.files.arrays import open_npz
from nonsac.files.content import content_kind, with_article
from nonsac.files.errors import FilePath, input_error, not_held
from nonsac.files.paths import file_errors, holds, is_folder, is_url, read_head
from nonsac.files.records import find_columns
from nonsac.files.text import Table, read_table
from nonsac.sources.array import ArraySource

if TYPE_CHECKING:
    from nonsac.sources.contract import Source

Columns = Sequence[str | int] | None
_HEAD_LENGTH = 4096
_FILES_OF_ZARR = ("zarr.json", ".zarray", ".zgroup")
_PAIRS_OF_KEYS = (
    ("points1", "points2"),
    ("x1", "x2"),
    ("points2d", "points3d"),
    ("x", "X"),
    ("source", "target"),
    ("src", "tgt"),
)


def open_source(path: FilePath | Sequence[FilePath], *, columns: Columns = None, dataset: str | None = None) -> Source:
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
    columns : sequence of str or int, optional
        The columns wanted, in this order: by position from 0 or, where they have names (Parquet, Arrow, text with a
        header line, structured arrays, arrays (n,) of HDF5 and Zarr), by name. By default all; in Parquet and Arrow all
        columns of numbers.
    dataset : str, optional
        Which array of an HDF5 file, a Zarr group or an .npz is meant, where there are several.

    Returns
    -------
    Source

    Raises
    ------
    InputError
        Where there is no such file, its kind is unknown or unfit, or it lacks what was asked for.
    """
    source = _opened(path, columns, dataset)
    if columns is not None:  # they are what their places say, whatever their names
        source.columns_given = True  # type: ignore[attr-defined]
    return source


def _opened(path: FilePath | Sequence[FilePath], columns: Columns, dataset: str | None) -> Source:
    if not isinstance(path, (str, os.PathLike)):
        return _open_parquet(path, columns)
    name = os.fspath(path)
    kind = _kind_of(name)
    if kind not in _OPENERS:
        raise input_error(
            name, f"is no table of rows, it looks like {with_article(kind)}", f"give one of {', '.join(_OPENERS)}"
        )
    if dataset is not None and kind not in _WITH_DATASETS:
        raise input_error(name, f"holds no datasets, it is {with_article(kind)}", "leave the dataset out")
    if is_url(name) and kind not in _BEHIND_URLS:
        raise input_error(name, f"{with_article(kind)} cannot be read from a URL", "download it first")
    return _OPENERS[kind](name, columns, dataset)


def _kind_of(path: str) -> str:
    if glob.has_magic(path) and (is_url(path) or not os.path.exists(path)):
        return "Parquet file"
    if is_folder(path):
        return "Zarr folder" if any(holds(path, name) for name in _FILES_OF_ZARR) else "Parquet file"
    head = read_head(path, _HEAD_LENGTH)
    if not head:
        raise input_error(path, "the file is empty", "write or copy it again")
    return content_kind(head)


def _open_npy(path: str, columns: Columns, dataset: str | None) -> Source:
    from nonsac.sources.npy import NpySource

    return NpySource(path, columns=columns)


def _open_hdf5(path: str, columns: Columns, dataset: str | None) -> Source:
    from nonsac.sources.hdf5 import Hdf5Source

    if dataset is None and _are_names(columns):
        return Hdf5Source(path, columns)
    return Hdf5Source(path, _only_dataset(path) if dataset is None else dataset, columns=columns)


def _open_zarr(path: str, columns: Columns, dataset: str | None) -> Source:
    from nonsac.sources.zarr import ZarrSource

    array = _only_array(path, columns) if dataset is None else dataset
    return ZarrSource(path, array=array, columns=columns)


def _open_las(path: str, columns: Columns, dataset: str | None) -> Source:
    from nonsac.sources.las import LasSource

    if columns is not None:
        raise input_error(path, "the columns of LAS files are always x, y, z", "leave the columns out")
    return LasSource(path)


def _open_parquet(paths: FilePath | Sequence[FilePath], columns: Columns, dataset: str | None = None) -> Source:
    from nonsac.sources.parquet import ParquetSource

    return ParquetSource(paths, columns)


def _open_npz(path: str, columns: Columns, dataset: str | None) -> Source:
    with open_npz(path) as archive:
        if dataset is not None and dataset not in archive.names:
            raise not_held(path, f"array {dataset!r}", archive.names)
        tables = {name: array for name in archive.names if (array := archive.load(name)).ndim == 2}
    pair = next((pair for pair in _PAIRS_OF_KEYS if dataset is None and set(pair) <= set(tables)), None)
    names = pair or [_the_only(path, list(tables)) if dataset is None else dataset]
    if not set(names) <= set(tables):
        raise input_error(path, f"the array {dataset!r} has not the shape (n, D)", "name one with rows")
    parts = [tables[name] for name in names]
    try:
        source = ArraySource(parts[0] if len(parts) == 1 else np.hstack(parts))
    except (TypeError, ValueError) as error:
        raise input_error(path, f"holds no rows of numbers ({error})", "save arrays (n, D) of equal length") from error
    return _narrowed(path, source, columns)


def _only_dataset(path: str) -> str:
    """The name of the only dataset (n, D) of numbers in an HDF5 file."""
    from nonsac.files.hdf5 import open_hdf5

    found: list[str] = []
    with open_hdf5(path) as file:
        file.visititems(lambda name, item: found.append(name) if _is_table(item) else None)
    return _the_only(path, found)


def _only_array(path: str, columns: Columns) -> str | Sequence[str] | None:
    """The name of the only array (n, D) of numbers in a Zarr group, or those of its columns; None for an array."""
    try:
        import zarr
    except ImportError:
        return None  # ZarrSource says so
    with file_errors(path):
        opened = zarr.open(path, mode="r")
        if not isinstance(opened, zarr.Group):
            return None
        return (
            columns if _are_names(columns) else _the_only(path, [n for n, each in opened.arrays() if _is_table(each)])
        )


def _is_table(array: Any) -> bool:
    return getattr(array, "ndim", 0) == 2 and array.dtype.kind in "fiu"


def _the_only(path: str, names: Sequence[str]) -> str:
    if len(names) != 1:
        problem = f"cannot tell which array holds the rows (n, D): {', '.join(names) or 'there is none'}"
        raise input_error(path, problem, "name one as the dataset")
    return names[0]


def _are_names(columns: Columns) -> TypeGuard[Sequence[str]]:
    """Whether columns are arrays (n,) of their own."""
    return columns is not None and all(isinstance(column, str) for column in columns)


def _open_text(path: str, columns: Columns, dataset: str | None) -> Source:
    table = read_table(path)
    return ArraySource(table.numbers(_columns_of(path, table, columns)))


def _columns_of(path: str, table: Table, columns: Columns) -> Sequence[int]:
    width = len(table.first_row() or table.names or ())
    if columns is None:
        return range(width)
    by_name = [column.lower() for column in columns if isinstance(column, str)]
    if by_name and table.names is None:
        raise input_error(path, "has no header line, so its columns have no names", "give their positions, from 0")
    places = dict(zip(by_name, find_columns(path, table.names or (), by_name, "check the names"), strict=True))
    return _within(path, width, [places[c.lower()] if isinstance(c, str) else c for c in columns])


def _narrowed(path: str, source: ArraySource, columns: Columns) -> ArraySource:
    if columns is None:
        return source
    if any(isinstance(column, str) for column in columns):
        raise input_error(path, "the columns of its arrays have no names", "give their positions, from 0")
    return ArraySource(source.rows[:, _within(path, source.width, [int(column) for column in columns])])


def _within(path: str, width: int, columns: list[int]) -> list[int]:
    beyond = [column for column in columns if not 0 <= column < width]
    if beyond:
        raise input_error(path, f"holds {width} columns, no column {beyond[0]}", "count them from 0")
    return columns


_OPENERS: dict[str, Callable[[str, Columns, str | None], Source]] = {
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
