"""What a pass over any number of rows adds up, in constant memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from nonsac.kernels.losses import likely_inliers
from nonsac.layouts import Array


class Weigher(Protocol):
    """From residuals (N,) to the weights of rows and of their derivatives, (N,) each."""

    def __call__(self, residuals: Array) -> tuple[Array, Array]: ...


@dataclass(frozen=True)
class LikelyInliers:
    """Weights each row by its probability of being an inlier (`kernels.losses.likely_inliers`).

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
        """The parameters that solve them (p,); NaN if the rows do not determine them."""
        scale = np.sqrt(np.abs(np.diagonal(self.hessian)))
        if not scale.all() or not np.isfinite(scale).all():
            return np.full(len(scale), np.nan)
        scaled = self.hessian / np.outer(scale, scale)
        if not np.linalg.eigvalsh(scaled)[0] > 1e-12:
            return np.full(len(scale), np.nan)
        return np.asarray(-np.linalg.solve(scaled, self.gradient / scale) / scale)


class Streaming(ABC):
    """What a problem has to know so that an answer can be fitted to any number of rows, in passes over them.

    Newton's method on parameters about a pivot: each pass adds up the normal equations of pieces of the rows.
    """

    @property
    def streaming(self) -> Self:
        return self

    @abstractmethod
    def pivot(self, rows: Array) -> Array:
        """A point (3,) amid the rows, about which the parameters are taken."""

    @abstractmethod
    def normal_equations(
        self, model: Array, rows: Array, weigher: Weigher, pivot: Array
    ) -> tuple[NormalEquations, Array]:
        """The sums over rows (N, D) at a model, and the residuals (N,)."""

    @abstractmethod
    def moved(self, model: Array, step: Array, pivot: Array) -> Array:
        """The model after a step of its parameters."""


def weighted(weigher: Weigher, factors: Array | None) -> Weigher:
    """The weigher, its weights times those that the rows carry."""
    if factors is None:
        return weigher

    def scaled(residuals: Array) -> tuple[Array, Array]:
        weights, curvatures = weigher(residuals)
        return weights * factors, curvatures * factors

    return scaled
