"""What there is to go by: inliers that say something new."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.facts import distant_rows
from nonsac.layouts import Array, distinct
from nonsac.problems.contract import Problem
from nonsac.problems.noise import Noise

LOOKED_AT, _FOR_EXTENT = 2000, 1000
_PLACE = 0.035  # of the extent of a half


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
    def of(cls, model: Array, inliers: Array, rows: int, noise: Noise, places: Places, most: int = LOOKED_AT) -> Facts:
        """Those of some inliers (K, D), of which at most so many are looked at, among so many rows."""
        if len(inliers) <= most:
            chosen = places.independent(model, inliers, noise)
            return cls(chosen, rows - len(inliers) + int(np.count_nonzero(chosen)), 1.0)
        looked_at = np.linspace(0, len(inliers) - 1, most).astype(np.int64)
        chosen = np.zeros(len(inliers), dtype=np.bool_)
        chosen[looked_at] = places.independent(model, inliers[looked_at], noise)
        share = len(looked_at) / len(inliers)
        return cls(chosen, int(share * rows) - len(looked_at) + int(np.count_nonzero(chosen)), share)

    @property
    def looked_at(self) -> int:
        """Inliers that were compared with each other."""
        return round(self.share * len(self.chosen))

    @property
    def repetition(self) -> float:
        """How many inliers there are for each fact."""
        return max(1.0, self.share * len(self.chosen) / max(self.count, 1))

    def among(self, inliers: NDArray[np.bool_]) -> Facts:
        """Those of some of the inliers (K,) bool."""
        return Facts(self.chosen & inliers, self.rows, self.share)

    @property
    def count(self) -> int:
        return int(np.count_nonzero(self.chosen))


@dataclass(frozen=True, eq=False)
class Places:
    """What is one place in a scene: how far apart rows are, in each half, if they say different things.

    Attributes
    ----------
    problem : Problem
    least : (D,) float64 or None
        Differences in each column below which rows say the same however small the noise is: neighbours that look alike
        are matched alike. None if only equal rows do.
    """

    problem: Problem
    least: Array | None

    @classmethod
    def of(cls, problem: Problem, rows: Array) -> Places:
        """From some rows (N, D)."""
        if problem.layout.split is None or not len(rows):
            return cls(problem, None)
        some = rows[:: max(1, len(rows) // _FOR_EXTENT)]
        spans = np.subtract(*np.percentile(some, [90.0, 10.0], axis=0))
        halves = np.split(spans, [problem.layout.split])
        return cls(problem, _PLACE * np.concatenate([np.full(len(half), np.linalg.norm(half)) for half in halves]))

    @classmethod
    def finest(cls, problem: Problem) -> Places:
        """As far apart as the noise lets one tell."""
        return cls(problem, None if problem.layout.split is None else np.zeros(problem.width))

    def independent(self, model: Array, rows: Array, noise: Noise) -> NDArray[np.bool_]:
        """Which rows (K, D) are another place than those before, in one half or the other."""
        chosen = np.zeros(len(rows), dtype=np.bool_)
        resolution = None if self.least is None else self.problem.resolution(model, rows, noise)
        if resolution is None or self.least is None:
            chosen[distinct(rows)] = True
        elif len(rows):
            apart = np.maximum(resolution, self.least)
            distant_rows(np.ascontiguousarray(rows), apart, self.problem.layout.split, chosen)
        return chosen
