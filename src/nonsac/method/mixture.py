"""The last step of a fit: each row is weighted by its probability of being an inlier."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nonsac.layouts import Array, Rows
from nonsac.method.residuals import Residuals, chance_rate
from nonsac.problems.contract import Problem, refitted
from nonsac.problems.noise import Noise
from nonsac.problems.normal_equations import LikelyInliers
from nonsac.values import special

_ITERATIONS = 30


@dataclass(frozen=True)
class Mixture:
    """Inliers with Gaussian errors among rows that are near the model by chance, evenly spread within its threshold.

    Parameters
    ----------
    noise : float
        Standard deviation of an error.
    dimension : int
        Independent errors that a residual is the length of.
    inliers, others : float
        Expected numbers of either within the threshold.
    """

    noise: float
    dimension: int
    inliers: float
    others: float

    @classmethod
    def seen_in(cls, residuals: Residuals, noise: float, dimension: int) -> Mixture:
        """The mixture that the residuals of a model, and those of background rows, show."""
        window = Noise.given(noise).threshold
        others = len(residuals.of_rows) * chance_rate(residuals.background, window)
        within = np.count_nonzero(residuals.of_rows < window)
        return cls(noise, dimension, max(within - others, 1.0), others)

    @property
    def weigher(self) -> LikelyInliers:
        """From residuals to how likely rows are to be inliers."""
        d, window = self.dimension, Noise.given(1.0).threshold
        of_inliers = self.inliers / (2.0 * np.pi) ** (d / 2)
        of_others = self.others / (np.pi ** (d / 2) / special.gamma(d / 2 + 1) * window**d)
        return LikelyInliers(self.noise, float(of_others / of_inliers), d)


def mixture_fit(problem: Problem, model: Array, rows: Rows, residuals: Residuals, noise: float) -> Array:
    """Least squares with the weights of a `Mixture`, again and again (expectation maximisation), from a good start.

    With many outliers it loses less than a robust loss alone: among n inliers and as many others within the
    threshold no estimator reaches the accuracy of least squares on the inliers, and this one comes near what can be.
    """
    weigher = Mixture.seen_in(residuals, noise, problem.residual_dimension).weigher
    near = rows[residuals.of_rows < 2.0 * Noise.given(noise).threshold]
    previous = np.zeros(len(near))
    for _ in range(_ITERATIONS):
        weights = weigher(problem.residuals(model[None], near.values)[0])[0]
        if np.abs(weights - previous).max(initial=0.0) < 1e-6:
            break
        fitted = refitted(problem, model, near.values, near.times(weights))
        if not np.isfinite(fitted).all():
            break
        model, previous = fitted, weights
    return model
