"""What makes one model better than another: how much each row adds to a model's score by its residual."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem
from nonsac.values import special
from nonsac.values.numeric import as_whole, shown

_BLOCK = 2**19  # residuals that are held at once
_COMPARED = 8
_STEPS = 4096


class Score(ABC):
    """The gain of a row falls from 1 at residual 0 to 0 at the threshold; a model's score is the sum over the rows.

    It is one minus a loss that is 1 beyond the threshold, so that the highest score has the least loss.
    """

    @abstractmethod
    def gains(self, ratios: Array) -> Array:
        """The gains for residuals in units of the threshold, of any shape."""

    def of(self, problem: Problem, models: Array, rows: Rows, threshold: float) -> Array:
        """The scores of models (M,); a row counts by its weight, a model of NaN has none."""
        weights, scores = rows.mean_weights, np.empty(len(models))
        step = max(1, _BLOCK // max(1, len(rows)))
        for start in range(0, len(models), step):
            ratios = problem.residuals(models[start : start + step], rows.values) / threshold
            gains = self.gains(np.where(ratios < 1.0, ratios, 1.0))
            scores[start : start + step] = gains.sum(axis=1) if weights is None else gains @ weights
        return scores

    def best(
        self, problem: Problem, models: Array, rows: Rows, threshold: float, floor: float = 0.0
    ) -> tuple[int, float] | None:
        """The number of the best model and its score; None if no score is above the floor.

        No model's score is above the number of its inliers, which takes a tenth of the time: those with few are left
        out.
        """
        counts = problem.count_inliers(models, rows.values, threshold, rows.mean_weights)
        order = np.argsort(-counts, kind="stable")
        found, highest = None, floor
        for start in range(0, len(order), _COMPARED):
            some = order[start : start + _COMPARED]
            if not counts[some[0]] > highest:
                break
            scores = self.of(problem, models[some], rows, threshold)
            first = int(np.argmax(scores))
            if scores[first] > highest:
                found, highest = int(some[first]), float(scores[first])
        return None if found is None else (found, highest)


@dataclass(frozen=True)
class Inliers(Score):
    """The number of inliers (Fischler and Bolles 1981)."""

    def gains(self, ratios: Array) -> Array:
        return (ratios < 1.0).astype(np.float64)


@dataclass(frozen=True)
class Truncated(Score):
    """MSAC: squared residuals, constant from the threshold on (Torr and Zisserman, "MLESAC", CVIU 2000, eq. 13)."""

    def gains(self, ratios: Array) -> Array:
        return np.maximum(1.0 - ratios * ratios, 0.0)


@dataclass(frozen=True)
class Marginalised(Score):
    """MAGSAC++: the loss of a row averaged over all noise levels up to a largest one (Barath et al., CVPR 2020).

    A residual is the length of a Gaussian error in `dimension` directions, cut at its 99 % quantile k; the largest
    standard deviation is the one whose quantile is the threshold.

    Parameters
    ----------
    dimension : int
        At least 2; 4, as in the paper, for the errors of a match of two image points.
    """

    dimension: int = 4

    def __post_init__(self) -> None:
        whole = as_whole(self.dimension)
        if whole is None or whole < 2:
            raise ValueError(f"dimension must be a whole number of at least 2, got {shown(self.dimension)}")

    def gains(self, ratios: Array) -> Array:
        steps, gains, _ = _marginalised(int(self.dimension))
        return np.interp(ratios, steps, gains)

    def weights(self, ratios: Array) -> Array:
        """The weights of rows in a least-squares fit that lowers the loss: 1 at residual 0."""
        steps, _, weights = _marginalised(int(self.dimension))
        return np.interp(ratios, steps, weights)


@lru_cache(maxsize=8)
def _marginalised(dimension: int) -> tuple[Array, Array, Array]:
    """Gains and weights at ratios from 0 to 1 (Barath et al. 2020, Sec. 3.1 and 3.2), without their constant factors.

    With the largest standard deviation as the unit, x = r^2 / 2 and z = k^2 / 2, the weight is G(x) - G(z), where G is
    the upper incomplete gamma function of (n - 1) / 2; the loss is its integral times r.
    """
    steps, shape = np.linspace(0.0, 1.0, _STEPS + 1), 0.5 * (dimension - 1)
    end = 0.5 * special.chdtri(dimension, 0.01)  # half of the squared quantile
    half = end * steps * steps

    def upper(x: Any) -> Any:
        return special.gammaincc(shape, x) * special.gamma(shape)

    def lower(x: Any) -> Any:
        return special.gammainc(shape + 1.0, x) * special.gamma(shape + 1.0)

    weights = upper(half) - upper(end)
    losses = lower(half) + half * weights
    return steps, 1.0 - losses / losses[-1], weights / weights[0]
