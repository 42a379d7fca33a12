"""What there is to go by: inliers that say something new."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.facts import distant_rows
from nonsac.layouts import Array, distinct
from nonsac.problems.contract import Problem
from nonsac.problems.noise import Noise

_LOOKED_AT = 2000


@dataclass(frozen=True, eq=False)
class Facts:
    """Inliers that are independent of each other: many matches of one place say no more than one.

    Attributes
    ----------
    chosen : (K,) bool
        Which of the K inliers.
    rows : int
        Rows that these were found among.
    share : float
        Of the inliers that were looked at, and of the rows therefore: 1, unless there are many.
    """

    chosen: NDArray[np.bool_]
    rows: int
    share: float

    @classmethod
    def of(cls, problem: Problem, model: Array, inliers: Array, rows: int, noise: Noise) -> Facts:
        """Those of some inliers (K, D) among so many rows."""
        looked_at = np.linspace(0, len(inliers) - 1, min(len(inliers), _LOOKED_AT)).astype(np.int64)
        chosen = np.zeros(len(inliers), dtype=np.bool_)
        chosen[looked_at] = _independent(problem, model, inliers[looked_at], noise)
        share = len(looked_at) / max(len(inliers), 1)
        return cls(chosen, int(share * rows) - len(looked_at) + int(np.count_nonzero(chosen)), share)

    @property
    def repetition(self) -> float:
        """How many inliers there are for each fact."""
        return max(1.0, min(len(self.chosen), _LOOKED_AT) / max(int(np.count_nonzero(self.chosen)), 1))


def _independent(problem: Problem, model: Array, rows: Array, noise: Noise) -> NDArray[np.bool_]:
    """Which rows (N, D) are as far from those before as the noise lets one tell, in one half or the other."""
    chosen = np.zeros(len(rows), dtype=np.bool_)
    split = problem.layout.split
    resolution = None if split is None else problem.resolution(model, rows, noise)
    if resolution is None:
        chosen[distinct(rows)] = True
    elif len(rows):
        columns = np.ascontiguousarray(((rows - rows.mean(axis=0)) / resolution).T, np.float32)
        distant_rows(columns, split, chosen)
    return chosen
