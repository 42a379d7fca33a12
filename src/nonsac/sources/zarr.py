"""Rows of Zarr arrays, on disk or behind a URL."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.content import check_regular, unreadable
from nonsac.files.errors import FilePath, InputError, input_error, library_missing, not_held
from nonsac.sources.blocks import EvenBlockSource, block_rows
from nonsac.sources.columns import choose_columns, common_length, read_columns, real_dtype, split_columns
from nonsac.sources.contract import About

_METADATA = ("zarr.json", ".zarray", ".zgroup", ".zattrs", ".zmetadata")


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
        real numbers. Zarr takes a chunk that is not there for one of fill values; that is no error.
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
        self.shapes = [tuple(each.shape) for each in opened]
        rows, widths = common_length(self.path, self.shapes)
        named = self.arrays if all(len(shape) == 1 for shape in self.shapes) else None
        chosen = choose_columns(self.path, columns, sum(widths), named)
        self.names = named and tuple(named[position] for position in chosen)
        self.chosen = columns is not None
        self.runs = split_columns(chosen, widths)
        chunk = max(_chunk_rows(opened[number]) for number, _ in self.runs)
        stored = sum(opened[number].nbytes for number in {number for number, _ in self.runs})
        super().__init__(rows, block_rows(chunk, len(chosen)), len(chosen), stored)
        if "://" not in self.path:
            self.path = os.path.abspath(self.path)  # workers may be elsewhere

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
            return np.hstack([read_columns(opened[number], first, last, columns) for number, columns in self.runs])
        # Codecs and file systems share no type of errors.
        except Exception as error:
            raise _damaged(self.path, error) from error

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
            node = zarr.open(self.path, mode="r")
        except Exception as error:
            problem = f"holds no Zarr array or group that can be read ({_first_words(error)})"
            raise input_error(self.path, problem, "give the path or URL that it was written to") from error
        return _arrays(self.path, node, self.arrays)

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


def _chunk_rows(array: Any) -> int:
    return int((getattr(array, "shards", None) or array.chunks)[0])


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
