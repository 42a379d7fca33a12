"""Every row of one array with every row of another, without ever storing the product."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.sources.array import ArraySource
from nonsac.sources.held import HeldSource

if TYPE_CHECKING:
    from nonsac.sources.contract import Source


class AllPairsSource:
    """The product of `a` (n, P) and `b` (k, Q) as n k virtual rows (n k, P + Q): row `i k + j` is (a_i, b_j).

    Only sampled rows exist, so 10^6 x 10^6 points are no larger than the two arrays (Lee et al., Sec. 4.4), which may
    be sources themselves, and stay on disk.
    """

    def __init__(self, a: ArrayLike | Source, b: ArrayLike | Source) -> None:
        self.a, self.b = _source(a), _source(b)
        if len(self.a) * len(self.b) >= 2**62:
            raise ValueError(f"{len(self.a)} x {len(self.b)} pairs are more than 2^62; thin the clouds first")

    @property
    def width(self) -> int:
        return self.a.width + self.b.width

    @property
    def in_memory(self) -> bool:
        return any(getattr(part, "in_memory", False) for part in (self.a, self.b))

    def __len__(self) -> int:
        return len(self.a) * len(self.b)

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        first, second = np.divmod(np.asarray(indices, np.int64), len(self.b))
        return np.hstack([self.a.take(first), self.b.take(second)])

    def hold(self, indices: NDArray[np.int64]) -> None:
        """Read what pairs that will be asked for are made of, where the parts come in blocks."""
        for part, places in zip((self.a, self.b), np.divmod(np.asarray(indices, np.int64), len(self.b)), strict=True):
            if isinstance(part, HeldSource):
                part.hold(places)

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        stop = len(self) if stop is None else min(stop, len(self))
        for first in range(start, stop, rows):
            yield self.take(np.arange(first, min(first + rows, stop), dtype=np.int64))


def _source(rows: Any) -> Source:
    if not (hasattr(rows, "take") and hasattr(rows, "chunks") and hasattr(rows, "width")):
        return ArraySource(rows)
    return HeldSource(rows) if hasattr(rows, "block_starts") else rows
