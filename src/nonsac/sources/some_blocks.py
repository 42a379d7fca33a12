"""The rows of some blocks of a source."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nonsac.sources.contract import About, Source
from nonsac.sources.held import HeldSource


class SomeBlocksSource(Source):
    """The rows of a source from some blocks, one block after the other.

    Parameters
    ----------
    source : Source
        Any.
    firsts, ends : (k,) int64
        The first row of each block, and the first one after it.

    Attributes
    ----------
    starts : (k + 1,) int64
        The first row of each block here, from 0, and then the number of rows.
    """

    def __init__(self, source: Source, firsts: NDArray[np.int64], ends: NDArray[np.int64]) -> None:
        self.source, self.firsts, self.width = source, firsts, source.width
        self.starts = np.append(0, np.cumsum(ends - firsts))

    @property
    def about(self) -> About:
        about = self.source.about
        return about if about.blocks is None else replace(about, blocks=self.starts)

    def __len__(self) -> int:
        return int(self.starts[-1])

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        indices = self.checked(indices)
        block = self.blocks_of(indices)
        return self.source.take(indices - self.starts[block] + self.firsts[block])

    def blocks_of(self, indices: NDArray[np.int64]) -> NDArray[np.int64]:
        """Which of these blocks each row lies in."""
        return np.searchsorted(self.starts, indices, side="right") - 1

    def bytes_to_take(self, rows: int) -> int:
        of_all = self.source.bytes_to_take(len(self.source))
        return min(self.source.bytes_to_take(rows), round(of_all * len(self) / max(len(self.source), 1)))


def whole(source: Source) -> Source:
    """All rows of what some were drawn from, or held of."""
    while isinstance(source, HeldSource | SomeBlocksSource):
        source = source.source
    return source
