"""Rows in records of one size, of which any can be read by itself: raw files, .npy, contiguous HDF5, LAS."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.positioned import PositionedFile
from nonsac.sources.contract import About, Source
from nonsac.values.quiet import quiet

_PAGE, _RUN = 4096, 2**18  # bytes; a disk takes as long to find a place as to read some hundred kB


@dataclass(frozen=True)
class Records:
    """Records of equal size, one after the other, of which some columns are read.

    Attributes
    ----------
    file
        The file that holds them.
    offset, size
        First byte of the first record, and bytes from one record to the next.
    count
        Number of records.
    columns
        First byte within a record, and dtype, of each column.
    """

    file: PositionedFile
    offset: int
    size: int
    count: int
    columns: tuple[tuple[int, np.dtype[Any]], ...]

    @property
    def span(self) -> tuple[int, int]:
        """The bytes of a record from the first column's to the last one's."""
        return min(first for first, _ in self.columns), max(first + kind.itemsize for first, kind in self.columns)

    def take(self, indices: NDArray[np.int64], rows: NDArray[np.float64]) -> None:
        """Fill rows (k, D) with the records of these numbers, which must be sorted."""
        first, last = self.span
        self._unpack(self.file.gather(self.offset + first + indices * self.size, last - first), first, rows)

    def read(self, start: int, rows: NDArray[np.float64]) -> None:
        """Fill rows (k, D) with the records from a number on."""
        position = self.offset + start * self.size
        if self._are_doubles and rows.flags.c_contiguous:
            return self.file.read_into(position, rows)
        content = np.empty((len(rows), self.size), np.uint8)
        self.file.read_into(position, content)
        return self._unpack(content, 0, rows)

    @property
    def _are_doubles(self) -> bool:
        double = np.dtype(np.float64)
        return self.size == 8 * len(self.columns) and self.columns == tuple(
            (8 * position, double) for position in range(len(self.columns))
        )

    @quiet
    def _unpack(self, content: NDArray[np.uint8], skipped: int, rows: NDArray[np.float64]) -> None:
        for position, (first, kind) in enumerate(self.columns):
            first -= skipped
            rows[:, position] = content[:, first : first + kind.itemsize].view(kind)[:, 0]


def number_columns(dtype: np.dtype[Any], chosen: Sequence[int]) -> tuple[tuple[int, np.dtype[Any]], ...]:
    """The columns of records that are numbers of one dtype, side by side."""
    return tuple((position * dtype.itemsize, dtype) for position in chosen)


def run_of(size: int) -> int:
    """How many neighbouring records of so many bytes are read about as fast as one."""
    return max(1, _RUN // size)


class RecordSource(Source):
    """The columns of several records, side by side; what is read is checked to be the file that was there at first.

    Parameters
    ----------
    parts : sequence of Records
        Equally many of each.
    names : tuple of str, optional
        What the columns are called.
    chosen : bool
        Whether the user chose them, so that they are taken in order, whatever their names.
    """

    def __init__(self, parts: Sequence[Records], names: tuple[str, ...] | None = None, chosen: bool = False) -> None:
        self.parts, self.names, self.chosen = tuple(parts), names, chosen
        self.width = sum(len(part.columns) for part in parts)

    def __repr__(self) -> str:
        path = self.parts[0].file.name
        return f"{type(self).__name__}({path!r}: {len(self)} x {self.width})"

    @property
    def about(self) -> About:
        return About(None if self.chosen else self.names, run=run_of(max(part.size for part in self.parts)))

    def __len__(self) -> int:
        return self.parts[0].count

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        indices = self.checked(indices)
        if (indices[1:] >= indices[:-1]).all():
            return self._take_sorted(indices)
        order = np.argsort(indices, kind="stable")
        taken = np.empty((len(indices), self.width))
        taken[order] = self._take_sorted(indices[order])
        return taken

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        stop = len(self) if stop is None else min(stop, len(self))
        for first in range(start, stop, rows):
            chunk = np.empty((min(rows, stop - first), self.width))
            for part, columns in self._columns(chunk):
                part.read(first, columns)
            yield chunk

    def bytes_to_take(self, rows: int) -> int:
        """What the disk has to give for so many random rows: the pages that hold them."""
        spans = [last - first for first, last in (part.span for part in self.parts)]
        return sum(
            min(rows * (span + _PAGE), len(self) * part.size) for span, part in zip(spans, self.parts, strict=True)
        )

    def _take_sorted(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        taken = np.empty((len(indices), self.width))
        if len(indices):
            for part, columns in self._columns(taken):
                part.take(indices, columns)
        return taken

    def _columns(self, rows: NDArray[np.float64]) -> Iterator[tuple[Records, NDArray[np.float64]]]:
        """Each part, and the columns of rows that are its own."""
        first = 0
        for part in self.parts:
            yield part, rows[:, first : first + len(part.columns)]
            first += len(part.columns)
