"""Rigid motions between points that carry a normal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.oriented_pairs import motions_of_pairs
from nonsac.problems.registration import Registration

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OrientedRegistration:
    """b = R a + t for rows (a, u, b, v): two points, each followed by its unit normal of unknown sign.

    Two rows determine a motion. Residuals and fits use the points alone, as `Registration` does.

    Parameters
    ----------
    angle : float
        Largest error of a normal, in radians, that a minimal sample may show.
    """

    angle: float = 0.2

    width: ClassVar[int] = 12
    minimal_size: ClassVar[int] = 2
    split: ClassVar[int] = 6

    def solve_minimal(self, samples: Array) -> Array:
        """Motions of B samples of two rows (B, 2, 12): none to four each."""
        models = np.empty((4 * len(samples), 3, 4))
        return models[: motions_of_pairs(samples, self.angle, models)]

    def residuals(self, models: Array, rows: Array) -> Array:
        return Registration().residuals(models, _points(rows))

    def count_inliers(self, models: Array, rows: Array, threshold: float) -> NDArray[np.int64]:
        return Registration().count_inliers(models, _points(rows), threshold)

    def refit(self, model: Array, rows: Array, weights: Array) -> Array:
        return Registration().refit(model, _points(rows), weights)

    def determined(self, model: Array, inliers: Array, threshold: float) -> bool:
        return Registration().determined(model, _points(inliers), threshold)

    def distance(self, a: Array, b: Array) -> Array:
        return Registration().distance(a, b)


def _points(rows: Array) -> Array:
    return rows[:, [0, 1, 2, 6, 7, 8]]
