"""The last step of a fit: each row weighs as much as it is likely to be an inlier."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gamma

from nonsac.method.verdict import Residuals, chance_rate
from nonsac.problems.contract import Problem, residual_dimension
from nonsac.problems.normal_equations import LikelyInliers
from nonsac.result import Array, threshold_of

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
        """The mixture that the residuals of a model, and those of rows paired at random, show."""
        window = threshold_of(noise)
        others = len(residuals.of_rows) * chance_rate(residuals.by_chance, window)
        within = np.count_nonzero(residuals.of_rows < window)
        return cls(noise, dimension, max(within - others, 1.0), others)

    @property
    def weigher(self) -> LikelyInliers:
        """From residuals to how likely rows are to be inliers."""
        d, window = self.dimension, threshold_of(1.0)
        of_inliers = self.inliers / (2.0 * np.pi) ** (d / 2)
        of_others = self.others / (np.pi ** (d / 2) / gamma(d / 2 + 1) * window**d)
        return LikelyInliers(self.noise, float(of_others / of_inliers), d)


def mixture_fit(problem: Problem, model: Array, rows: Array, residuals: Residuals, noise: float) -> Array:
    """Least squares with the weights of a `Mixture`, again and again (expectation maximisation), from a good start.

    It loses less than a robust loss alone where there are many outliers: among n inliers and as many others within the
    threshold no estimator reaches the accuracy of least squares on the inliers, and this one comes near what can be.
    """
    weigher = Mixture.seen_in(residuals, noise, residual_dimension(problem)).weigher
    near = rows[residuals.of_rows < 2.0 * threshold_of(noise)]
    previous = np.zeros(len(near))
    for _ in range(_ITERATIONS):
        weights = weigher(problem.residuals(model[None], near)[0])[0]
        if np.abs(weights - previous).max(initial=0.0) < 1e-6:
            break
        fitted = problem.refit(model, near, weights)
        if not np.isfinite(fitted).all():
            break
        model, previous = fitted, weights
    return model
