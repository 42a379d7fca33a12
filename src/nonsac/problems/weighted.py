"""Any problem, for rows that carry a weight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nonsac.problems.normal_equations import Weigher

if TYPE_CHECKING:
    from nonsac.problems.contract import Problem

Array = NDArray[np.float64]

_BLOCK = 2**20


@dataclass(frozen=True)
class Weighted:
    """A problem whose rows have one more column, last: a weight, not negative, in any unit.

    A row of twice the weight is drawn twice as often into minimal samples and counts twice in scores and fits, as if
    it were there twice. The verdict counts rows, not weights.

    Parameters
    ----------
    problem : Problem
    """

    problem: Problem

    @property
    def width(self) -> int:
        return self.problem.width + 1

    @property
    def minimal_size(self) -> int:
        return self.problem.minimal_size

    @property
    def split(self) -> int:
        return self.problem.split

    @property
    def residual_dimension(self) -> int:
        return getattr(self.problem, "residual_dimension", 1)

    def row_weights(self, rows: Array) -> Array:
        """Weights of rows (N, D), scaled to a mean of 1; negative ones, which only a source can have, are 0."""
        weights = np.maximum(rows[:, -1], 0.0)
        total = weights.sum()
        return weights * (len(weights) / total) if total > 0.0 else weights

    def solve_minimal(self, samples: Array) -> Array:
        return self.problem.solve_minimal(np.ascontiguousarray(samples[..., :-1]))

    def residuals(self, models: Array, rows: Array) -> Array:
        return self.problem.residuals(models, rows[:, :-1])

    def count_inliers(self, models: Array, rows: Array, threshold: float) -> Array:
        """The total weight of the inliers of each model, in rows of mean weight."""
        weights = self.row_weights(rows)
        step = max(1, _BLOCK // max(1, len(rows)))
        blocks = (self.problem.residuals(models[i : i + step], rows[:, :-1]) for i in range(0, len(models), step))
        return np.concatenate([np.empty(0), *((block < threshold) @ weights for block in blocks)])

    def refit(self, model: Array, rows: Array, weights: Array) -> Array:
        return self.problem.refit(model, rows[:, :-1], weights * rows[:, -1])

    def determined(self, model: Array, inliers: Array, threshold: float) -> bool:
        return self.problem.determined(model, inliers[:, :-1], threshold)

    def distance(self, a: Array, b: Array) -> Array:
        return self.problem.distance(a, b)

    def __getattr__(self, name: str) -> Any:
        """What a problem may have besides (see `Problem`): the same, on rows without their weights."""
        if name.startswith("_") or name == "problem":
            raise AttributeError(name)
        method = getattr(self.problem, name)
        if name == "moved":
            return method
        if name == "pivot":
            return lambda rows: method(rows[:, :-1])
        if name == "refit_robustly":
            return lambda model, rows, weights, *settings: method(model, rows[:, :-1], weights * rows[:, -1], *settings)
        if name == "normal_equations":
            return lambda model, rows, weigher, pivot: method(model, rows[:, :-1], _scaled(weigher, rows[:, -1]), pivot)
        return lambda model, rows, *rest: method(model, rows[:, :-1], *rest)


def _scaled(weigher: Weigher, factors: Array) -> Weigher:
    """Weights times those that the rows carry."""

    def scaled(residuals: Array) -> tuple[Array, Array]:
        weights, curvatures = weigher(residuals)
        return weights * factors, curvatures * factors

    return scaled
