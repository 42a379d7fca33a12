"""Rows of another source, of which those that are read pass through a function."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nonsac.sources.contract import About, Source
from nonsac.values.numeric import shown

Map = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class MappedSource(Source):
    """The rows of `source`, passed through `map`; only rows that are read ever are.

    Parameters
    ----------
    source : Source
        Any; it stays as it is, and so do the cost of reading it and its blocks.
    map : callable
        From rows (k, D) to rows (k, D'), row by row: a camera's `normalise`, a choice of columns. It travels to
        workers, so it must pickle.
    """

    def __init__(self, source: Source, map: Map) -> None:
        if not isinstance(source, Source):
            raise TypeError(f"source must be a source of rows, got {shown(source)}")
        if not callable(map):
            raise TypeError(f"map must be a function of rows, got {shown(map)}")
        self.source, self.map = source, map

    @property
    def about(self) -> About:
        return replace(self.source.about, names=None)

    def bytes_to_take(self, rows: int) -> int:
        return self.source.bytes_to_take(rows)

    def hold(self, indices: NDArray[np.int64]) -> None:
        self.source.hold(indices)

    def __len__(self) -> int:
        return len(self.source)

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        return self._mapped(self.source.take(indices))

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        return map(self._mapped, self.source.chunks(rows, start, stop))

    def _mapped(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array(self.map(rows), np.float64, order="C")


@dataclass(frozen=True)
class ColumnMap:
    """Picks columns by their positions."""

    columns: tuple[int, ...]

    def __call__(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        return rows[:, self.columns]


@dataclass(frozen=True)
class BySideMap:
    """Passes neighbouring columns through maps of their own, as `JoinedSource` does with arrays.

    Attributes
    ----------
    widths : sequence of int
        Numbers of columns of each part; together all.
    maps : sequence of callable or None
        For each part, from (k, d) to (k, d'); None leaves it as it is.
    """

    widths: Sequence[int]
    maps: Sequence[Map | None]

    def __call__(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        parts = np.split(rows, np.cumsum(self.widths)[:-1], axis=1)
        moved = [part if move is None else move(part) for part, move in zip(parts, self.maps, strict=True)]
        return np.hstack(moved)
