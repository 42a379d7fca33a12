"""A source without some of its rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nonsac.sources.contract import About, Source


class WithoutRows(Source):
    """The rows of a source, in its order, but for some; those that are left out are never read.

    Parameters
    ----------
    source : Source
        Any.
    left_out : (k,) int64
        Numbers of the rows that are left out, sorted, each once.
    """

    def __init__(self, source: Source, left_out: NDArray[np.int64]) -> None:
        self.source, self.left_out, self.width = source, left_out, source.width
        self._before = left_out - np.arange(len(left_out))  # rows that are kept before each of them

    @property
    def about(self) -> About:
        about = self.source.about
        if about.blocks is None:
            return about
        return replace(about, blocks=about.blocks - np.searchsorted(self.left_out, about.blocks))

    def __len__(self) -> int:
        return len(self.source) - len(self.left_out)

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        return self.source.take(self._places(self.checked(indices)))

    def hold(self, indices: NDArray[np.int64]) -> None:
        self.source.hold(self._places(indices))

    def bytes_to_take(self, rows: int) -> int:
        return self.source.bytes_to_take(rows)

    def _places(self, indices: NDArray[np.int64]) -> NDArray[np.int64]:
        """Where rows are in the source."""
        return indices + np.searchsorted(self._before, indices, side="right")
