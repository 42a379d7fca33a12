"""Rigid motions between points that carry a normal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.oriented_pairs import motions_of_pairs
from nonsac.layouts import Array, Layout
from nonsac.problems.contract import Problem
from nonsac.problems.noise import Noise
from nonsac.problems.registration import Registration


@dataclass(frozen=True)
class OrientedRegistration(Problem):
    """b = R a + t for rows (a, u, b, v): two points, each followed by its unit normal of unknown sign.

    Two rows determine a motion. Residuals and fits use the points alone, as `Registration` does.

    Parameters
    ----------
    angle : float
        Largest error of a normal, in radians, that a minimal sample may show.
    """

    angle: float = 0.2

    layout = Layout("x1 y1 z1 u1 v1 w1 | x2 y2 z2 u2 v2 w2")
    minimal_size = 2

    def solve_minimal(self, samples: Array) -> Array:
        """Motions of B samples of two rows (B, 2, 12): none to four each."""
        models = np.empty((4 * len(samples), 3, 4))
        return models[: motions_of_pairs(samples, self.angle, models)]

    def residuals(self, models: Array, rows: Array) -> Array:
        return Registration().residuals(models, _points(rows))

    def count_inliers(self, models: Array, rows: Array, threshold: float, weights: Array | None = None) -> NDArray[Any]:
        return Registration().count_inliers(models, _points(rows), threshold, weights)

    def refit(self, model: Array, rows: Array, weights: Array) -> Array:
        return Registration().refit(model, _points(rows), weights)

    def determined(self, model: Array, inliers: Array, noise: Noise) -> bool:
        return Registration().determined(model, _points(inliers), noise)

    def transform(self, model: Array) -> Array:
        return Registration().transform(model)

    def distance(self, a: Array, b: Array) -> Array:
        return Registration().distance(a, b)

    def average(self, models: Array, rows: Array) -> Array:
        return Registration().average(models, _points(rows))


def _points(rows: Array) -> Array:
    return rows[:, [0, 1, 2, 6, 7, 8]]
