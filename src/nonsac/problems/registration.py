"""Rigid motions and similarities between 3D points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.kabsch import fit_each, fit_similarity
from nonsac.kernels.ladder import registration_ladder
from nonsac.kernels.pose_math import rotate
from nonsac.kernels.registration import (
    count_registration_inliers,
    registration_equations,
    registration_matrix,
    registration_residuals,
)
from nonsac.layouts import PAIRS, Array
from nonsac.problems.averages import mean_motion
from nonsac.problems.contract import Problem
from nonsac.problems.covariance import at_origin, least_squares_covariance, robust_covariance
from nonsac.problems.noise import Noise
from nonsac.problems.normal_equations import NormalEquations, Streaming, Weigher
from nonsac.problems.pose import (
    RESOLVED,
    ROTATION,
    SHIFT,
    homogeneous,
    largest_error,
    likely_length,
    rotation_distance,
)
from nonsac.result import Uncertainty
from nonsac.values.numeric import LEAST, MOST, as_real, shown

_TURNING, _DRAWN_TO_A_THIRD, _LEAST_ERROR = 1.25, 6.0, 0.1


@dataclass(frozen=True)
class Registration(Streaming, Problem):
    """b = s R a + t for rows (a, b) of six numbers `x1 y1 z1 x2 y2 z2`; the residual is |b - s R a - t|.

    Parameters
    ----------
    scale : float or None
        The known scale s; None estimates it. Default 1, a rigid motion.
    """

    scale: float | None = 1.0

    layout = PAIRS
    minimal_size = 3
    residual_dimension = 3

    def __post_init__(self) -> None:
        if self.scale is None:
            return
        if not 0 < as_real(self.scale) < np.inf:
            raise ValueError(f"scale must be positive, or None to estimate it, got {shown(self.scale)}")
        if not LEAST <= as_real(self.scale) <= MOST:
            raise ValueError(f"scale must be from {LEAST:g} to {MOST:g}, got {shown(self.scale)}")
        object.__setattr__(self, "scale", as_real(self.scale))  # other types would compile the kernels anew

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

    def count_inliers(self, models: Array, rows: Array, threshold: float, weights: Array | None = None) -> NDArray[Any]:
        if weights is not None:
            return super().count_inliers(models, rows, threshold, weights)
        counts = np.empty(len(models), np.int64)
        # Single precision is twice as fast.
        count_registration_inliers(*self._in_thresholds(models, rows, threshold), np.float32(1.0), counts)
        return counts

    def count_on_ladder(self, models: Array, rows: Array, thresholds: Array) -> NDArray[np.int64]:
        counts = np.empty((len(models), len(thresholds)), np.int64)
        registration_ladder(*self._in_thresholds(models, rows, float(thresholds[0])), self.minimal_size, counts)
        return counts

    def _in_thresholds(self, models: Array, rows: Array, threshold: float) -> tuple[NDArray[Any], NDArray[Any]]:
        """Models and columns near the origin, in units of a threshold: the error of single precision is then small."""
        shift = centre(rows)
        scaled = models.copy()
        scaled[:, :, 3] = (models[:, :, 3] + models[:, :, :3] @ shift[:3] - shift[3:]) / threshold
        return scaled.astype(np.float32), np.ascontiguousarray((rows - shift).T / threshold, np.float32)

    def refit(self, model: Array, rows: Array, weights: Array) -> Array:
        """Weighted least squares in closed form (Horn 1987; Umeyama 1991 for the scale)."""
        fitted = np.empty((3, 4))
        determined = fit_similarity(np.ascontiguousarray(rows), weights, self.scale is None, self.scale or 1.0, fitted)
        return fitted if determined else self.no_model

    def determined(self, model: Array, inliers: Array, noise: Noise) -> bool:
        """False for collinear inliers: the rotation about their line would be uncertain by ten degrees or more."""
        source, target = (
            np.linalg.svd(half - half.mean(axis=0), compute_uv=False)[1] for half in (inliers[:, :3], inliers[:, 3:])
        )
        scale = np.nan_to_num(np.linalg.norm(model[:, 0]), nan=1.0)  # the noise is in the unit of the target
        return bool(noise.sigma < 0.17 * min(scale * source, target))

    def resolution(self, model: Array, inliers: Array, noise: Noise) -> Array:
        size = np.linalg.norm(model[:, 0])  # the noise is in the unit of the target
        return RESOLVED * noise.sigma * np.array([1.0 / size] * 3 + [1.0] * 3)

    def standard_errors(self, model: Array, inliers: Array, noise: Noise) -> tuple[float, float]:
        extent = self._extent(model, inliers)
        moved = (inliers[:, :3] - inliers[:, :3].mean(axis=0)) @ model[:, :3].T
        covariance = least_squares_covariance(_slopes(moved / extent, self.scale is None), noise.sigma / extent)
        return largest_error(covariance[:3, :3]), largest_error(covariance[3:6, 3:6])

    def share_of_one_motion(self, model: Array, rows: Array, noise: Noise) -> float:
        """Share of the squared errors along one rigid motion; a third, or little more, if they have no direction.

        0 if they have the same direction everywhere, as those of a depth camera nearly do. A row counts by how far the
        motion moves it. Drawn towards a third if the rows are few, since six parameters fit some of any errors, and if
        they are exact: a tenth of the noise has all directions.
        """
        if len(rows) <= self.minimal_size:
            return 0.0
        moved = rows[:, :3] @ model[:, :3].T
        errors, least = rows[:, 3:] - moved - model[:, 3], (_LEAST_ERROR * noise.sigma) ** 2
        squares = (errors**2).sum(axis=1) + 3.0 * least
        slopes = _slopes((moved - moved.mean(axis=0)) / self._extent(model, rows), free_scale=False)
        along = (slopes * errors[:, :, None]).sum(axis=1)
        every, single = slopes.reshape(-1, 6), (slopes * squares[:, None, None]).reshape(-1, 6)
        root = np.linalg.inv(np.linalg.cholesky(single.T @ every / squares.sum() + 1e-9 * np.eye(6)))
        share = np.linalg.eigvalsh(root @ (along.T @ along + least * every.T @ every) @ root.T)[-1] / squares.sum()
        straight = np.linalg.eigvalsh(errors.T @ errors + least * len(rows) * np.eye(3))[-1] / squares.sum()
        if share < _TURNING * straight:
            return 0.0
        return float((len(rows) * share + _DRAWN_TO_A_THIRD / 3.0) / (len(rows) + _DRAWN_TO_A_THIRD))

    def covariance(self, model: Array, inliers: Array, noise: Noise) -> Array:
        """Covariance (6, 6) of the rotation vector w (R becomes exp([w]x) R, radians) and of t.

        With a free scale (7, 7), with the logarithm of the scale last.
        """
        origin = centre(inliers)[:3]
        moved = (inliers[:, :3] - origin) @ model[:, :3].T
        residuals = moved - (inliers[:, 3:] - (model[:, :3] @ origin + model[:, 3]))
        centred = robust_covariance(residuals, _slopes(moved, self.scale is None), noise.threshold)
        return at_origin(centred, model[:, :3] @ origin)

    def uncertainty(self, covariance: Array, model: Array, inliers: Array) -> Uncertainty:
        centred = at_origin(covariance, -model[:, :3] @ centre(inliers)[:3])
        angle = likely_length(centred[SHIFT, SHIFT]) / self._extent(model, inliers)
        rotation = float(np.degrees(likely_length(covariance[ROTATION, ROTATION])))
        return Uncertainty(rotation, likely_length(covariance[SHIFT, SHIFT]), float(np.degrees(angle)))

    def _extent(self, model: Array, rows: Array) -> float:
        """Root mean square distance of the moved points from their middle; infinite if they are one."""
        moved = (rows[:, :3] - rows[:, :3].mean(axis=0)) @ model[:, :3].T
        return float(np.sqrt((moved**2).sum(axis=1).mean())) or np.inf

    def pivot(self, rows: Array) -> Array:
        """A point amid the source (3,); far from the origin, a turn about the origin would be lost in the shift."""
        return centre(rows)[:3]

    def normal_equations(
        self, model: Array, rows: Array, weigher: Weigher, pivot: Array
    ) -> tuple[NormalEquations, Array]:
        columns, model = np.ascontiguousarray(rows.T), np.ascontiguousarray(model)
        residuals, sums, size = np.empty((1, len(rows))), np.zeros(17), 7 if self.scale is None else 6
        registration_residuals(model[None], columns, residuals)
        registration_equations(columns, *weigher(residuals[0]), model, pivot, sums)
        hessian, gradient = np.empty((size, size)), np.empty(size)
        registration_matrix(sums, self.scale is None, hessian, gradient)
        return NormalEquations(hessian, gradient), residuals[0]

    def moved(self, model: Array, step: Array, pivot: Array) -> Array:
        """The model after a step: a turn w of the source about the pivot, a shift, and the logarithm of a scale."""
        moved, place = np.array(model, np.float64), model[:, :3] @ pivot + model[:, 3]
        rotate(moved, *step[:3])
        if len(step) == 7:
            moved[:, :3] *= np.exp(step[6])
        moved[:, 3] = place + step[3:6] - moved[:, :3] @ pivot
        return moved

    def transform(self, model: Array) -> Array:
        return homogeneous(model)

    def distance(self, a: Array, b: Array) -> Array:
        """Angle between the rotations, in degrees."""
        return rotation_distance(_rotations(a), _rotations(b))

    def average(self, models: Array, rows: Array) -> Array:
        return mean_motion(models, self.pivot(rows))


def centre(rows: Array) -> Array:
    """A point amid the rows (D,), which a few rows far away, or not finite, do not move."""
    some = rows[:: max(1, len(rows) // 500)]
    finite = some[np.isfinite(some).all(axis=1)]
    middle = len(finite) // 2
    return np.partition(finite, middle, axis=0)[middle] if len(finite) else np.zeros(rows.shape[1])


def _slopes(moved: Array, free_scale: bool) -> Array:
    """Derivatives (N, 3, 6 or 7) of the points s R a (N, 3) and t with respect to w, t and log s."""
    slopes = np.zeros((len(moved), 3, 7 if free_scale else 6))
    x, y, z = moved.T
    slopes[:, 0, 1], slopes[:, 0, 2] = z, -y
    slopes[:, 1, 0], slopes[:, 1, 2] = -z, x
    slopes[:, 2, 0], slopes[:, 2, 1] = y, -x
    slopes[:, :, 3:6] = np.eye(3)
    if free_scale:
        slopes[:, :, 6] = moved
    return slopes


def _rotations(models: Array) -> Array:
    linear = np.asarray(models)[..., :3, :3]
    with np.errstate(invalid="ignore"):
        return linear / np.cbrt(np.linalg.det(linear))[..., None, None]
