"""How far rows are from a model, beside what chance does: how many fit it, and how large their noise is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, background, residuals_of
from nonsac.problems.ladder import LADDER, Telling
from nonsac.problems.noise import Noise
from nonsac.values import special

_WINDOWS, _AROUND, _ROWS = 12, 2.5, 4000
_LEAST_FREE = 0.3


@dataclass(frozen=True)
class Residuals:
    """Of all rows, and of the problem's background rows, for one model."""

    of_rows: Array
    background: Array

    @classmethod
    def of(cls, problem: Problem, model: Array, rows: Rows) -> Residuals:
        size = min(50_000, max(6_000, 10 * len(rows)))
        by_chance = residuals_of(problem, model[None], background(problem, rows, size))[0]
        return cls(residuals_of(problem, model[None], rows.values)[0], by_chance)

    def support(self, threshold: float) -> float:
        """Share of the rows that are inliers beyond chance."""
        return np.count_nonzero(self.of_rows < threshold) / len(self.of_rows) - chance_rate(self.background, threshold)


def noise_of_model(model: Array, residuals: Residuals, telling: Telling) -> float:
    """Standard deviation of the inliers of a model, if nothing is known of it: NaN if there are none beyond chance.

    They are looked for within the threshold at which they are least likely by chance, and around it. What the fit has
    taken of the errors of few inliers is given back.
    """
    unit = float(np.median(residuals.background))
    if not 0.0 < unit < np.inf:
        return float("nan")
    level = telling.of(model, unit * LADDER)
    if not level.score > 0.0:
        return float("nan")
    dimension = telling.problem.residual_dimension
    noise = measured_noise(residuals, level.threshold, dimension, _AROUND * level.threshold)
    errors, fitted = dimension * (level.facts + telling.problem.minimal_size), dimension * telling.problem.minimal_size
    return noise * float(np.sqrt(errors / max(errors - fitted, _LEAST_FREE * errors)))


def telling_of(problem: Problem, rows: Rows) -> Telling:
    """What `noise_of_model` needs of the rows; some are enough."""
    return rows.kept(problem, "telling", lambda: Telling(problem, rows.some(_ROWS)))


def measured_noise(residuals: Residuals, threshold: float, dimension: int, most: float = np.inf) -> float:
    """Standard deviation of the inliers of a model, from the median of the residuals beyond chance.

    They are looked for within a threshold that is adjusted until it is that of the outcome, or until it is `most`. NaN
    if no residuals are beyond chance.
    """
    ordered, shuffled = np.sort(residuals.of_rows), np.sort(residuals.background)
    expected = len(ordered) / len(shuffled) * np.searchsorted(shuffled, ordered, side="right")
    beyond_chance = np.arange(1, len(ordered) + 1) - expected
    median = np.sqrt(special.chdtri(dimension, 0.5))
    window, noise = threshold, float("nan")
    for _ in range(_WINDOWS):
        within = int(np.searchsorted(ordered, window))
        if not within or beyond_chance[within - 1] <= 0.0:
            return noise
        half = int(np.argmax(beyond_chance[:within] >= 0.5 * beyond_chance[within - 1]))
        noise = float(ordered[half] / median)
        if ordered[half] > 0.35 * window:  # they go on beyond the window
            if window >= most:
                break
            window = min(2.0 * window, most)
        elif abs(Noise.given(noise).threshold - window) < 0.1 * window:
            break
        else:
            window = max(Noise.given(noise).threshold, 1e-300)
    return noise


def chance_rate(residuals: Array, threshold: float) -> float:
    """Share of inliers among the background rows; half a count is added to be safe."""
    return (np.count_nonzero(residuals < threshold) + 0.5) / (len(residuals) + 1)
