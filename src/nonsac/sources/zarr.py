"""Rows of Zarr arrays, on disk or behind a URL."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.claims import check_expansion, check_shape, check_width
from nonsac.files.compressed import expands_beyond
from nonsac.files.content import check_regular, unreadable
from nonsac.files.errors import FilePath, InputError, input_error, library_missing, not_held
from nonsac.sources.blocks import EvenBlockSource, block_rows
from nonsac.sources.columns import choose_columns, common_length, read_columns, real_dtype, split_columns
from nonsac.sources.contract import About

_METADATA = ("zarr.json", ".zarray", ".zgroup", ".zattrs", ".zmetadata")
_FEW_BLOCKS, _MOST_BLOCKS = 10_000, 2**22
_LARGE_CHUNK = 2**20  # numbers
_MOST_DECODED = 32  # bytes of a number, with what filters add


class ZarrSource(EvenBlockSource):
    """Rows of one or several Zarr arrays, in blocks of whole chunks or, if the array has them, shards.

    Parameters
    ----------
    path : path or URL
        The array (n, D), or a group; of Zarr format 2 or 3.
    array : str or sequence of str, optional
        In a group: the array (n, D), or several (n, d) or (n,) that stand side by side.
    columns : sequence of int or str, optional
        Positions of the columns in the order wanted, or names of arrays if all are (n,); by default all.

    Raises
    ------
    InputError
        If zarr is missing, there is no Zarr array or group, it is damaged, or holds no such arrays or columns or no
        real numbers; on reading also if a chunk is not there, which Zarr itself takes for one of fill values (and does
        not write if it holds nothing else, unless told `write_empty_chunks=True`).
    """

    _opened: tuple[int, list[Any]] | None = None

    def __init__(
        self,
        path: FilePath,
        array: str | Sequence[str] | None = None,
        columns: Sequence[int | str] | None = None,
    ) -> None:
        self.path = os.fspath(path)
        self.arrays = (array,) if isinstance(array, str) else None if array is None else tuple(array)
        opened = self._open()
        for each in opened:
            real_dtype(self.path, each.dtype, "an array")
            check_shape(self.path, each.shape)
        self.shapes = [tuple(each.shape) for each in opened]
        rows, widths = common_length(self.path, self.shapes)
        check_width(self.path, sum(widths))
        named = self.arrays if all(len(shape) == 1 for shape in self.shapes) else None
        chosen = choose_columns(self.path, columns, sum(widths), named)
        self.names = named and tuple(named[position] for position in chosen)
        self.chosen = columns is not None
        self.runs = split_columns(chosen, widths)
        chunk = max(_chunk_rows(self.path, opened[number], rows) for number, _ in self.runs)
        stored = sum(opened[number].nbytes for number in {number for number, _ in self.runs})
        size = block_rows(chunk, len(chosen))
        _check_count(self.path, rows, size)
        super().__init__(rows, size, len(chosen), stored)
        if "://" not in self.path:
            self.path = os.path.abspath(self.path)  # workers may be elsewhere
        if len(self.block_starts) > _FEW_BLOCKS:
            self.read_block(len(self.block_starts) - 2)  # is missing, if the number of rows is made up

    @property
    def about(self) -> About:
        return About(None if self.chosen else self.names, self.block_starts)

    def __repr__(self) -> str:
        return f"ZarrSource({self.path!r}: {len(self)} x {self.width})"

    def __getstate__(self) -> dict[str, Any]:
        return super().__getstate__() | {"_opened": None}

    def read_block(self, block: int) -> NDArray[np.float64]:
        first, last = self.bounds(block)
        opened = self._open_here()
        try:
            return np.hstack([self._read(opened[number], first, last, columns) for number, columns in self.runs])
        except InputError:
            raise
        # Codecs and file systems share no type of errors.
        except Exception as error:
            raise _damaged(self.path, error) from error

    def _read(self, array: Any, first: int, last: int, columns: list[int]) -> NDArray[np.float64]:
        """Some rows of an array; what changes with the fill value is not there."""
        for chunk in _files_of_chunks(self.path, array, first, last, columns):
            if os.path.exists(chunk) and expands_beyond(_MOST_DECODED * math.prod(array.chunks), chunk):
                raise input_error(chunk, "is a chunk that would expand far beyond its size", "write or copy it again")
        rows, step = read_columns(array, first, last, columns), array.chunks[0]
        starts = np.unique(np.append(np.arange(-first % step, last - first, step), 0))
        if not _are_equal(rows[starts], _fill_value(array)).any():
            return rows
        other = read_columns(_with_other_fill(array), first, last, columns)
        missing = np.flatnonzero(~_are_equal(rows, other).all(axis=1))
        if len(missing):
            start = (first + int(missing[0])) // step * step
            problem = f"lacks rows {start} to {min(start + step, array.shape[0]) - 1} (never written, or gone)"
            raise input_error(self.path, problem, "write or copy all of it (Zarr itself: write_empty_chunks=True)")
        return rows

    def _open_here(self) -> list[Any]:
        """The arrays, opened once in each process."""
        self._check_there()
        if self._opened is None or self._opened[0] != os.getpid():
            opened = self._open()
            if [tuple(each.shape) for each in opened] != self.shapes:
                raise input_error(
                    self.path, "was changed while it was read", "let it be written first, then start again"
                )
            self._opened = (os.getpid(), opened)
        return self._opened[1]

    def _open(self) -> list[Any]:
        zarr = _import_zarr(self.path)
        self._check_there()
        try:
            with warnings.catch_warnings():  # of files that lie beside
                warnings.simplefilter("ignore", UserWarning)
                return _arrays(self.path, zarr.open(self.path, mode="r"), self.arrays)
        except InputError:
            raise
        except Exception as error:
            problem = f"holds no Zarr array or group that can be read ({_first_words(error)})"
            raise input_error(self.path, problem, "give the path or URL that it was written to") from error

    def _check_there(self) -> None:
        # Zarr itself takes what is gone for fill values.
        if "://" not in self.path and not os.path.exists(self.path):
            raise unreadable(self.path, FileNotFoundError())
        check_metadata(self.path)


def check_metadata(path: str) -> None:
    """Refuse an array or group on disk whose descriptions, or those of the arrays in it, are pipes or devices."""
    if "://" in path or not os.path.isdir(path):
        return
    with os.scandir(path) as entries:
        folders = [path, *(entry.path for entry in entries if entry.is_dir())]
    for folder in folders:
        for name in _METADATA:
            file = os.path.join(folder, name)
            if os.path.lexists(file):
                check_regular(file)


def _arrays(path: str, node: Any, names: tuple[str, ...] | None) -> list[Any]:
    if hasattr(node, "shape"):
        if names is not None:
            raise input_error(path, "is an array, not a group of arrays", "leave the name of an array out")
        return [node]
    held = sorted(node.array_keys())
    if names is None:
        problem = f"is a group of arrays (it holds {', '.join(held[:4]) or 'none'})"
        raise input_error(path, problem, "name one of them")
    for name in names:
        if name not in node or not hasattr(node[name], "shape"):
            raise not_held(path, f"array {name!r}", held)
    return [node[name] for name in names]


def _chunk_rows(path: str, array: Any, rows: int) -> int:
    """Rows that are read at once, after a look at what the metadata say of chunks and shards."""
    for chunks in filter(None, (array.chunks, getattr(array, "shards", None))):
        if min(check_shape(path, chunks), default=0) < 1:
            raise input_error(path, f"names the chunks {tuple(chunks)}, which no array has", "write or copy it again")
    chunk = getattr(array, "shards", None) or array.chunks
    numbers = math.prod(chunk)
    if numbers > _LARGE_CHUNK and "://" not in path:
        there = sum(entry.stat().st_size for entry in Path(path).rglob("*") if entry.is_file())
        check_expansion(path, "a chunk", numbers, there, "write it in smaller chunks")
    return min(int(chunk[0]), max(rows, 1))


def _check_count(path: str, rows: int, size: int) -> None:
    """Refuse a number of rows that cannot be, as nothing but the chunks says how many there are."""
    if rows // size > _MOST_BLOCKS:
        raise input_error(path, f"promises {rows:.3g} rows", "check its shape, or split it into several arrays")


def _files_of_chunks(path: str, array: Any, first: int, last: int, columns: list[int]) -> list[str]:
    """The files on this machine that some rows and columns of an array lie in."""
    if "://" in path:
        return []
    is_new = hasattr(array, "async_array")  # Zarr 3
    key, folder = (array.metadata.encode_chunk_key, array.path) if is_new else (array._chunk_key, "")
    bounds = [(first, last), (min(columns), max(columns) + 1)]
    lengths = getattr(array, "shards", None) or array.chunks
    places = [range(low // n, (high - 1) // n + 1) for (low, high), n in zip(bounds, lengths, strict=False)]
    return [os.path.join(path, folder, key(place)) for place in product(*places)]


def _are_equal(rows: NDArray[np.float64], others: Any) -> NDArray[np.bool_]:
    """Which numbers are the same, or both no numbers."""
    equal: NDArray[np.bool_] = (rows == others) | (np.isnan(rows) & np.isnan(others))
    return equal


def _fill_value(array: Any) -> float:
    return float(array.fill_value or 0)


def _with_other_fill(array: Any) -> Any:
    """The same array, in which other numbers stand for what is not there."""
    value = array.dtype.type(2 if _fill_value(array) == 1 else 1)
    if not hasattr(array, "async_array"):  # Zarr 2
        other = copy(array)
        other._fill_value = value
        return other
    inner = array.async_array
    metadata = replace(inner.metadata, fill_value=value)
    return type(array)(type(inner)(metadata, inner.store_path, inner.config))


def _damaged(path: str, error: Exception) -> InputError:
    return input_error(path, f"is truncated or damaged ({_first_words(error)})", "write or copy it again")


def _first_words(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"[:200]


def _import_zarr(path: str) -> Any:
    try:
        import zarr
    except ImportError as error:
        raise library_missing(path, "Zarr arrays", "zarr", "zarr") from error
    return zarr
