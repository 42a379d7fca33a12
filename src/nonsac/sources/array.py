"""Rows of an array in memory."""

from __future__ import annotations

import mmap
import os
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.sources.columns import names_of_table
from nonsac.sources.contract import About, Source
from nonsac.sources.records import run_of
from nonsac.values.arraylike import as_array
from nonsac.values.checks import listed
from nonsac.values.quiet import as_doubles


class ArraySource(Source):
    """Rows of a (n, D) array of any real dtype and memory order; the array is neither copied nor converted whole.

    A memory map, or a view of one, travels to workers as a description of where it lies in its file. If the file has
    become shorter, reading raises InputError, where memory that is gone would end the process.

    Parameters
    ----------
    rows : (n, D) array
        Or a table of pandas, polars or Arrow, whose columns have names.
    names : sequence of str, optional
        What the columns are called, if calls are to find theirs by name; by default as in the table.
    """

    def __init__(self, rows: ArrayLike, names: Sequence[str] | None = None) -> None:
        if np.ma.isMaskedArray(rows):
            raise TypeError("rows must not be a masked array; pass rows.filled(numpy.nan) to have masked rows dropped")
        names = names_of_table(rows) if names is None else names
        self.rows = rows if isinstance(rows, np.ndarray) else as_array(rows, "rows")
        if self.rows.ndim != 2:
            raise ValueError(f"rows must be a (n, D) array, got shape {self.rows.shape}")
        if self.rows.dtype.kind not in "fiu":
            raise TypeError(f"rows must be an array of real numbers, got dtype {self.rows.dtype}")
        self._backing = _Backing.of(self.rows)
        self.width = int(self.rows.shape[1])
        self.names = (
            None
            if names is None
            else tuple(names if isinstance(names, str) else listed("names", names, "one for each column"))
        )
        if self.names is not None and len(self.names) != self.width:
            raise ValueError(f"names must have one for each of {self.width} columns, got {len(self.names)}")

    @property
    def about(self) -> About:
        if _mapping_of(self.rows) is None:
            return About(self.names, in_memory=True)
        return About(self.names, run=run_of(self.width * self.rows.itemsize))

    def __len__(self) -> int:
        return int(self.rows.shape[0])

    def pick(self, rows: Any) -> NDArray[Any]:
        """Some rows as they are, by a slice or by their numbers."""
        if self._backing is not None:
            self._backing.check()
        picked: NDArray[Any] = self.rows[rows]
        return picked

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        return as_doubles(self.pick(self.checked(indices)))

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        stop = len(self) if stop is None else min(stop, len(self))
        for first in range(start, stop, rows):
            yield as_doubles(self.pick(slice(first, min(first + rows, stop))))

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"rows": _mapping_of(self.rows) or self.rows, "_backing": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        rows = state["rows"]
        vars(self).update(state | {"rows": rows.map_again() if isinstance(rows, _Mapping) else rows})
        self._backing = _Backing.of(self.rows)


class _Backing(NamedTuple):
    """The file behind an array in mapped memory, and how long it has to be."""

    name: str
    memory: mmap.mmap
    needed: int

    @classmethod
    def of(cls, rows: NDArray[Any]) -> _Backing | None:
        """What is behind an array; None if it is not in the memory of a mapped file."""
        owner: Any = rows
        while isinstance(owner, np.ndarray) and not isinstance(_base(owner), mmap.mmap):
            owner = _base(owner)
        if not isinstance(owner, np.ndarray) or not rows.size:
            return None
        memory = _base(owner)
        first = np.frombuffer(memory, np.uint8).ctypes.data
        skipped = 0  # bytes of the file before the memory, which starts at a page
        if isinstance(owner, np.memmap):
            skipped = owner.offset - owner.offset % mmap.ALLOCATIONGRANULARITY
        name = str(getattr(owner, "filename", None) or "the file behind a memory map")
        return cls(name, memory, skipped + rows.ctypes.data - first + _reach(rows)[1])

    def check(self) -> None:
        """Raise InputError if the file has become shorter: to touch memory beyond its end is a signal, no exception."""
        try:
            size = self.memory.size()
        except (OSError, ValueError):  # there is no file, or nobody may ask
            return
        if size < self.needed:
            from nonsac.files.errors import input_error

            problem = f"the file was cut to {size} bytes while it was mapped into memory"
            raise input_error(self.name, problem, "let it be written first, then start again")


def _base(array: NDArray[Any]) -> Any:
    base = array.base
    return base.obj if isinstance(base, memoryview) else base


def _reach(rows: NDArray[Any]) -> tuple[int, int]:
    """How many bytes an array takes up before and after its first number."""
    reach = [(length - 1) * stride for length, stride in zip(rows.shape, rows.strides, strict=True)]
    return -sum(min(step, 0) for step in reach), sum(max(step, 0) for step in reach) + rows.itemsize


class _Mapping(NamedTuple):
    """Where an array lies in a file: its first number, and the bytes on either side of it that it takes up."""

    filename: str
    position: int
    before: int
    after: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    strides: tuple[int, ...]

    def map_again(self) -> NDArray[Any]:
        start = self.position - self.before
        try:
            content = np.memmap(self.filename, np.uint8, "r", offset=start, shape=(self.before + self.after,))
        except (OSError, ValueError) as error:
            from nonsac.files.errors import input_error

            problem = f"cannot be mapped again ({error})"
            raise input_error(self.filename, problem, "keep it as it was, where every worker can read it") from error
        return np.ndarray(self.shape, self.dtype, content, self.before, self.strides)


def _mapping_of(rows: NDArray[Any]) -> _Mapping | None:
    """The description of an array that shares the memory of a mapped file, if it is one."""
    owner: Any = rows
    while isinstance(owner, np.ndarray) and not isinstance(owner.base, mmap.mmap):
        owner = owner.base
    if (
        not isinstance(owner, np.memmap)
        or not rows.size
        or owner.mode == "c"
        or not os.path.isfile(owner.filename or "")
    ):
        return None
    before, after = _reach(rows)
    position = owner.offset + rows.ctypes.data - owner.ctypes.data
    return _Mapping(str(owner.filename), position, before, after, rows.dtype, rows.shape, rows.strides)
