"""Rows of an array in memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray


class ArraySource:
    """Rows of a (n, D) array of any real dtype and memory order; the array is neither copied nor converted whole."""

    def __init__(self, rows: ArrayLike) -> None:
        if np.ma.isMaskedArray(rows):
            raise TypeError("rows must not be a masked array; pass rows.filled(numpy.nan) to have masked rows dropped")
        self.rows = np.asanyarray(rows)
        if self.rows.ndim != 2:
            raise ValueError(f"rows must be a (n, D) array, got shape {self.rows.shape}")
        if self.rows.dtype.kind not in "fiu":
            raise TypeError(f"rows must be an array of real numbers, got dtype {self.rows.dtype}")

    @property
    def width(self) -> int:
        return int(self.rows.shape[1])

    @property
    def in_memory(self) -> bool:
        return not isinstance(self.rows, np.memmap)

    def __len__(self) -> int:
        return int(self.rows.shape[0])

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.array(self.rows[indices], np.float64, order="C")

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        stop = len(self) if stop is None else min(stop, len(self))
        for first in range(start, stop, rows):
            yield np.array(self.rows[first : min(first + rows, stop)], np.float64, order="C")
