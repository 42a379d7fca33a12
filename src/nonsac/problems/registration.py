"""Rigid motions and similarities between 3D points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.kabsch import fit_each, fit_similarity
from nonsac.kernels.residuals import count_registration_inliers, registration_residuals

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Registration:
    """b = s R a + t for rows (a, b) of six numbers `x1 y1 z1 x2 y2 z2`; the residual is |b - s R a - t|.

    Parameters
    ----------
    scale : float or None
        The known scale s; None estimates it. Default 1, a rigid motion.
    """

    scale: float | None = 1.0

    width: ClassVar[int] = 6
    minimal_size: ClassVar[int] = 3
    split: ClassVar[int] = 3

    def __post_init__(self) -> None:
        if self.scale is not None and not (np.isfinite(self.scale) and self.scale > 0):
            raise ValueError(f"scale must be positive, or None to estimate it, got {self.scale!r}")

    def solve_minimal(self, samples: Array) -> Array:
        """Models of B samples of three rows (B, 3, 6); collinear samples have none."""
        models = np.empty((len(samples), 3, 4))
        count = fit_each(samples, self.scale is None, self.scale or 1.0, models)
        return models[:count]

    def residuals(self, models: Array, rows: Array) -> Array:
        models = np.ascontiguousarray(models).reshape(-1, 3, 4)
        residuals = np.empty((len(models), len(rows)))
        registration_residuals(models, np.ascontiguousarray(rows.T), residuals)
        return residuals

    def count_inliers(self, models: Array, rows: Array, threshold: float) -> NDArray[np.int64]:
        # Single precision is twice as fast; near the origin its error is far below any useful threshold.
        mean = rows.mean(axis=0)
        shifted = models.copy()
        shifted[:, :, 3] += models[:, :, :3] @ mean[:3] - mean[3:]
        counts = np.empty(len(models), np.int64)
        columns = np.ascontiguousarray((rows - mean).T, np.float32)
        count_registration_inliers(shifted.astype(np.float32), columns, np.float32(threshold**2), counts)
        return counts

    def refit(self, model: Array, rows: Array, weights: Array) -> Array:
        """Weighted least squares in closed form (Horn 1987; Umeyama 1991 for the scale)."""
        fitted = np.empty((3, 4))
        determined = fit_similarity(rows, weights, self.scale is None, self.scale or 1.0, fitted)
        return fitted if determined else np.full((3, 4), np.nan)

    def determined(self, model: Array, inliers: Array, threshold: float) -> bool:
        """False for collinear inliers: the rotation about their line would be uncertain by ten degrees or more."""
        target = inliers[:, 3:]
        deviations = np.linalg.svd(target - target.mean(axis=0), compute_uv=False)
        return bool(threshold / 5.0 < 0.17 * deviations[1])

    def distance(self, a: Array, b: Array) -> Array:
        """Angle between the rotations, in degrees: 2 asin(|A - B|_F / sqrt 8) keeps its digits at small angles."""
        difference = _rotations(a) - _rotations(b)
        chord = np.sqrt((difference**2).sum(axis=(-2, -1)) / 8.0)
        return np.degrees(2.0 * np.arcsin(np.minimum(chord, 1.0)))


def _rotations(models: Array) -> Array:
    linear = np.asarray(models)[..., :3, :3]
    return linear / np.cbrt(np.linalg.det(linear))[..., None, None]
