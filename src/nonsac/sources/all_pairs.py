"""Every row of one array with every row of another, without ever storing the product."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.sources.array import ArraySource
from nonsac.sources.contract import About, Source
from nonsac.sources.held import HeldSource


class AllPairsSource(Source):
    """The product of `a` (n, P) and `b` (k, Q) as n k virtual rows (n k, P + Q): row `i k + j` is (a_i, b_j).

    Only sampled rows exist, so 10^6 x 10^6 points are no larger than the two arrays (Lee et al., Sec. 4.4), which may
    be sources themselves, and stay on disk.
    """

    def __init__(self, a: ArrayLike | Source, b: ArrayLike | Source) -> None:
        self.a, self.b = _part(a), _part(b)
        if len(self.a) * len(self.b) >= 2**62:
            raise ValueError(f"{len(self.a)} x {len(self.b)} pairs are more than 2^62; thin the clouds first")
        self.width = self.a.width + self.b.width

    @property
    def about(self) -> About:
        a, b = self.a.about, self.b.about
        return About(in_memory=a.in_memory or b.in_memory, keeps_rows=a.keeps_rows or b.keeps_rows)

    def __len__(self) -> int:
        return len(self.a) * len(self.b)

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        first, second = np.divmod(self.checked(indices), len(self.b))
        return np.hstack([self.a.take(first), self.b.take(second)])

    def bytes_to_take(self, rows: int) -> int:
        return self.a.bytes_to_take(rows) + self.b.bytes_to_take(rows)

    def hold(self, indices: NDArray[np.int64]) -> None:
        """Read what pairs that will be asked for are made of, if the parts come in blocks."""
        first, second = np.divmod(np.asarray(indices, np.int64), len(self.b))
        self.a.hold(first)
        self.b.hold(second)


def _part(rows: Any) -> Source:
    source = rows if isinstance(rows, Source) else ArraySource(rows)
    return source if source.about.blocks is None else HeldSource(source)
