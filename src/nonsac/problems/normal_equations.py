"""What a pass over any number of rows adds up, in constant memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.losses import likely_inliers

Array = NDArray[np.float64]


class Weigher(Protocol):
    """From residuals (N,) to the weights of rows and of their derivatives, (N,) each."""

    def __call__(self, residuals: Array) -> tuple[Array, Array]: ...


@dataclass(frozen=True)
class LikelyInliers:
    """Rows weigh as much as they are likely inliers (`kernels.normal_equations.likely_inliers`).

    Parameters
    ----------
    noise : float
        Standard deviation of an inlier.
    odds : float
        How many times as frequent as inliers others are at residual 0.
    dimension : int
        Independent errors that a residual is the length of.
    """

    noise: float
    odds: float
    dimension: int

    def __call__(self, residuals: Array) -> tuple[Array, Array]:
        weights, curvatures = np.empty(len(residuals)), np.empty(len(residuals))
        likely_inliers(residuals, self.noise, self.odds, self.dimension, weights, curvatures)
        return weights, curvatures


@dataclass(frozen=True)
class NormalEquations:
    """Of p parameters: sums over rows of h J^T J (p, p) and of w J^T r (p,), at one model."""

    hessian: Array
    gradient: Array

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(self.hessian + other.hessian, self.gradient + other.gradient)

    def step(self) -> Array:
        """The parameters that solve them (p,); NaN where the rows do not determine them."""
        scale = np.sqrt(np.abs(np.diagonal(self.hessian)))
        if not scale.all() or not np.isfinite(scale).all():
            return np.full(len(scale), np.nan)
        scaled = self.hessian / np.outer(scale, scale)
        if not np.linalg.eigvalsh(scaled)[0] > 1e-12:
            return np.full(len(scale), np.nan)
        return np.asarray(-np.linalg.solve(scaled, self.gradient / scale) / scale)
