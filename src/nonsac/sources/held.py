"""Rows of a source of blocks that have been read once, and are kept."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nonsac.sources.contract import About, Source


class HeldSource(Source):
    """A source of which no row is read twice: `take` keeps what it reads.

    To take a row from a compressed block is to read the block. A random sample has rows in nearly all blocks, so one
    reading serves all samples if these are asked for together. What is kept does not travel: in a pickle this is the
    source itself, and tasks elsewhere are sent the rows of their sample.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self._forget()

    def _forget(self) -> None:
        self.width = self.source.width
        self._indices = np.empty(0, np.int64)
        self._rows = np.empty((0, self.width))
        self._lock = threading.Lock()

    @property
    def about(self) -> About:
        return replace(self.source.about, in_memory=True, keeps_rows=True)

    def __len__(self) -> int:
        return len(self.source)

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        wanted = self.checked(indices)
        with self._lock:
            self._read(wanted)
            return self._rows[np.searchsorted(self._indices, wanted)]

    def hold(self, indices: NDArray[np.int64]) -> None:
        """Read rows that will be asked for."""
        with self._lock:
            self._read(np.asarray(indices, np.int64))

    def bytes_to_take(self, rows: int) -> int:
        return self.source.bytes_to_take(rows)

    def _read(self, wanted: NDArray[np.int64]) -> None:
        missing = _distinct(wanted[~self._holds(wanted)])
        if len(missing):
            places = np.searchsorted(self._indices, missing)
            self._rows = np.insert(self._rows, places, self.source.take(missing), axis=0)
            self._indices = np.insert(self._indices, places, missing)

    def _holds(self, wanted: NDArray[np.int64]) -> NDArray[np.bool_]:
        places = np.searchsorted(self._indices, wanted)
        held = places < len(self._indices)
        held[held] = self._indices[places[held]] == wanted[held]
        return held

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        return self.source.chunks(rows, start, stop)

    def __getstate__(self) -> Source:
        return self.source

    def __setstate__(self, source: Source) -> None:
        self.source = source
        self._forget()


def _distinct(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """Each once, sorted; `numpy.unique` takes ten times as long for what is sorted already."""
    ordered = np.sort(indices)
    return ordered[np.append(True, ordered[1:] != ordered[:-1])[: len(ordered)]]
