"""Relative pose of two calibrated cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.five_point import five_point_poses
from nonsac.kernels.ladder import epipolar_ladder
from nonsac.kernels.losses import mirror
from nonsac.kernels.pose_fit import fit_pose, move
from nonsac.kernels.sampson import (
    count_epipolar_inliers,
    epipolar_geometries,
    epipolar_residuals,
    essential_directions,
    sampson_equations,
    sampson_jacobian,
)
from nonsac.layouts import MATCHES, Array
from nonsac.problems.averages import mean_motion
from nonsac.problems.contract import Problem
from nonsac.problems.covariance import least_squares_covariance, robust_covariance
from nonsac.problems.noise import Noise
from nonsac.problems.normal_equations import NormalEquations, Streaming, Weigher
from nonsac.problems.pose import (
    RESOLVED,
    ROTATION,
    SHIFT,
    homogeneous,
    largest_error,
    likely_length,
    positive,
    rotation_distance,
    rotation_is_certain,
    spread_out,
)
from nonsac.problems.special_case import SpecialCase
from nonsac.problems.two_view import (
    are_mirrored,
    miscalibrated_rotation,
    plane_of,
    pose_of_same_plane,
    reversed_in_depth,
    rotation_of,
    seen_through_plane,
    transfer_errors,
)
from nonsac.result import Remark, Uncertainty

_PLANE_ROWS, _CALIBRATION_ROWS = 300, 100
_REACH, _DIRECTIONS = 0.95, 8  # of the inliers
_LOCAL, _LOCAL_SHARE = 20.0, 0.05  # thresholds; of the image
_MOST, _NARROW, _TWIN_FIT = 0.9, 0.27, 50  # tan 15 degrees
_SAME = 3.0  # degrees
_VISIBLE_BEND = 0.02


@dataclass(frozen=True)
class RelativePose(Streaming, Problem):
    """X2 = R X1 + t with |t| = 1, for rows `x1 y1 x2 y2` of normalised image coordinates in two cameras.

    The residual is Sampson's first-order distance to the epipolar geometry (Sampson 1982; Luong and Faugeras 1996),
    in pixels if the focal lengths are given, and in normalised coordinates otherwise. A match whose rays meet behind
    a camera is as far away as the nearest match of a point at infinity.

    Parameters
    ----------
    focal1, focal2 : float
        Focal lengths in pixels; the noise in pixels is taken to be the same in both images.
    """

    focal1: float = 1.0
    focal2: float = 1.0

    layout = MATCHES
    minimal_size = 5

    def __post_init__(self) -> None:
        object.__setattr__(self, "focal1", positive("focal1", self.focal1))
        object.__setattr__(self, "focal2", positive("focal2", self.focal2))

    def solve_minimal(self, samples: Array) -> Array:
        """Poses of B samples of five rows (B, 5, 4): none to ten each, with all five points in front of both cameras.

        Nister's five-point method (PAMI 2004).
        """
        models = np.empty((10 * len(samples), 3, 4))
        return models[: five_point_poses(np.ascontiguousarray(samples), models)]

    def residuals(self, models: Array, rows: Array) -> Array:
        geometries = self._geometries(models)
        residuals = np.empty((len(geometries), len(rows)))
        epipolar_residuals(geometries, self._columns(rows), residuals)
        return residuals

    def count_inliers(self, models: Array, rows: Array, threshold: float, weights: Array | None = None) -> NDArray[Any]:
        if weights is not None:
            return super().count_inliers(models, rows, threshold, weights)
        # Single precision is twice as fast; in units of the threshold its error does not matter.
        in_thresholds = RelativePose(self.focal1 / threshold, self.focal2 / threshold)
        columns = in_thresholds._columns(rows).astype(np.float32)
        counts = np.empty(len(models), np.int64)
        count_epipolar_inliers(in_thresholds._geometries(models).astype(np.float32), columns, counts)
        return counts

    def count_on_ladder(self, models: Array, rows: Array, thresholds: Array) -> NDArray[np.int64]:
        in_thresholds = RelativePose(self.focal1 / thresholds[0], self.focal2 / thresholds[0])
        columns, geometries = in_thresholds._columns(rows), in_thresholds._geometries(models)
        counts = np.empty((len(models), len(thresholds)), np.int64)
        epipolar_ladder(geometries.astype(np.float32), columns.astype(np.float32), self.minimal_size, counts)
        return counts

    def refit(self, model: Array, rows: Array, weights: Array) -> Array:
        """Weighted least squares in the Sampson residuals, by Levenberg and Marquardt's method from `model`."""
        return self.fit_robustly(model, rows, weights, np.inf, 50)

    def fit_robustly(self, model: Array, rows: Array, weights: Array, threshold: float, iterations: int) -> Array:
        """The same with Tukey's biweight loss, which is constant beyond the threshold."""
        fitted = np.array(model, np.float64)
        if np.count_nonzero(weights) < self.minimal_size or not np.isfinite(fitted).all():
            return self.no_model
        ok = fit_pose(
            self._columns(rows), weights, float(threshold), iterations, np.array([self.focal1, self.focal2]), fitted
        )
        return fitted if ok else self.no_model

    def determined(self, model: Array, inliers: Array, noise: Noise) -> bool:
        """Whether rotation and direction of the translation are known to half a radian and 0.7, at all.

        Points on a plane determine them up to a second solution (see `special_cases`).
        """
        if not np.isfinite(model).all():
            return len(inliers) >= self.minimal_size and all(spread_out(half) for half in np.hsplit(inliers, 2))
        covariance = least_squares_covariance(self._derivatives(model, inliers)[1], noise.sigma)
        block = covariance[3:, 3:]
        direction_is_certain = np.isfinite(block).all() and np.linalg.eigvalsh(block)[-1] < 0.7**2
        return bool(direction_is_certain) and rotation_is_certain(covariance)

    def resolution(self, model: Array, inliers: Array, noise: Noise) -> Array:
        return RESOLVED * noise.sigma / np.array([self.focal1, self.focal1, self.focal2, self.focal2])

    def standard_errors(self, model: Array, inliers: Array, noise: Noise) -> tuple[float, float]:
        covariance = least_squares_covariance(self._derivatives(model, inliers)[1], noise.sigma)
        return largest_error(covariance[:3, :3]), largest_error(covariance[3:, 3:])

    def special_cases(self, model: Array, inliers: Array, noise: Noise) -> tuple[SpecialCase, ...]:
        """What a pure rotation, and a planar scene, explain of these inliers.

        A rotation without a baseline leaves the direction of t open; a plane allows a second pose.
        """
        at_infinity, threshold = np.zeros(3), noise.threshold
        turned = rotation_of(model, inliers, lambda turned: self._transfer_error(turned, at_infinity, inliers))
        errors = self._transfer_error(turned, at_infinity, inliers)
        by_rotation, reach = errors < threshold, float(np.nanquantile(errors, _REACH))
        extent = float(np.linalg.norm(np.ptp(inliers[:, 2:], axis=0))) * self.focal2
        is_local = reach < min(_LOCAL * threshold, _LOCAL_SHARE * extent)
        displaced = partial(self._displaced, turned, threshold, reach) if is_local else None
        cases = [SpecialCase("pure rotation", by_rotation, determined=False, displaced=displaced)]
        if by_rotation.mean() < 0.95:
            cases.append(self._seen_with_wrong_calibration(turned, inliers, noise))
        return (*cases, *self._second_poses(model, inliers, threshold))

    def _second_poses(self, model: Array, inliers: Array, threshold: float) -> list[SpecialCase]:
        """What is known to allow a second pose: a plane, and little perspective."""
        plane = self._plane(model, inliers, threshold)
        radius = np.linalg.norm(inliers[:, :2] - np.median(inliers[:, :2], axis=0), axis=1)
        if np.quantile(radius, _MOST) > _NARROW:
            return [plane]
        twin = reversed_in_depth(model, inliers)
        fitted = self.fit_robustly(twin, inliers, np.ones(len(inliers)), 2.0 * threshold, _TWIN_FIT)
        if not np.isfinite(fitted).all() or any(_are_alike(fitted, known) for known in (model, *plane.others)):
            return [plane]
        explains = self.residuals(fitted[None], inliers)[0] < threshold
        return [SpecialCase("reversed in depth", explains, determined=True, others=fitted[None]), plane]

    def _displaced(self, turned: Array, threshold: float, reach: float, rows: Array) -> tuple[NDArray[np.bool_], Array]:
        """Rows that a rotation misses by no more than inliers of the pose do, and the same missed in any direction."""
        errors = self._transfer_error(turned, np.zeros(3), rows)
        near = (errors >= threshold) & (errors <= reach)
        first, second = np.hsplit(np.tile(rows[near], (_DIRECTIONS, 1)), 2)
        seen = seen_through_plane(turned, np.zeros(3), first)
        angles = np.random.default_rng(len(rows)).uniform(0.0, 2.0 * np.pi, len(first))
        lengths = np.linalg.norm(second - seen, axis=1, keepdims=True)
        return near, np.hstack([first, seen + lengths * np.column_stack([np.cos(angles), np.sin(angles)])])

    def twins(self, model: Array, inliers: Array, noise: Noise) -> Sequence[Array]:
        return [other for case in self._second_poses(model, inliers, noise.threshold) for other in case.others]

    def _plane(self, model: Array, inliers: Array, threshold: float) -> SpecialCase:
        some = inliers[:: max(1, len(inliers) // _PLANE_ROWS)]
        plane = plane_of(model, some, lambda plane: self._transfer_error(model, plane, some), threshold)
        by_plane = self._transfer_error(model, plane, inliers) < threshold
        others = np.empty((0, 3, 4))
        if by_plane.mean() > 0.5:
            found = pose_of_same_plane(model, plane, inliers[by_plane])
            even = np.ones(len(inliers))
            others = np.array([self.fit_robustly(other, inliers, even, 2.0 * threshold, 20) for other in found])
            others = others[np.isfinite(others).all(axis=(1, 2))] if len(others) else found
        return SpecialCase("planar", by_plane, determined=True, others=others)

    def remarks(self, model: Array, inliers: Array) -> tuple[str, ...]:
        return (Remark.MIRRORED.value,) if are_mirrored(*np.hsplit(inliers, 2)) else ()

    def _seen_with_wrong_calibration(self, turned: Array, inliers: Array, noise: Noise) -> SpecialCase:
        """What a pure rotation explains if focal length and radial distortion are others than given."""
        some = inliers[:: max(1, len(inliers) // _CALIBRATION_ROWS)]
        turned, mistake = miscalibrated_rotation(turned, some, noise.sigma / self.focal2)
        camera = RelativePose(self.focal1 / mistake.scale, self.focal2 / mistake.scale)
        explains = camera._transfer_error(turned, np.zeros(3), mistake.corrected(inliers)) < noise.threshold
        detail = f"with a focal length {1.0 / mistake.scale:.2f} times the given one"
        if abs(mistake.bend) > _VISIBLE_BEND:
            detail += f" and a radial distortion of {mistake.bend:.2f}"
        return SpecialCase(f"pure rotation: {detail}", explains, determined=False)

    def covariance(self, model: Array, inliers: Array, noise: Noise) -> Array:
        """Covariance (5, 5) of the rotation vector w (R exp: exp([w]x) R, radians) and of t in its tangent plane."""
        residuals, jacobian = self._derivatives(model, inliers)
        return robust_covariance(residuals[:, None], jacobian[:, None], noise.threshold)

    def uncertainty(self, covariance: Array, model: Array, inliers: Array) -> Uncertainty:
        rotation, direction = (float(np.degrees(likely_length(covariance[part, part]))) for part in (ROTATION, SHIFT))
        return Uncertainty(rotation, direction, direction)

    def pivot(self, rows: Array) -> Array:
        """The first camera; there is no other place to turn about."""
        return np.zeros(3)

    def normal_equations(
        self, model: Array, rows: Array, weigher: Weigher, pivot: Array
    ) -> tuple[NormalEquations, Array]:
        columns, residuals = self._columns(rows), np.empty((1, len(rows)))
        epipolar_residuals(self._geometries(model), columns, residuals)
        directions, hessian, gradient = np.empty((6, 3, 3)), np.zeros((5, 5)), np.zeros(5)
        essential_directions(np.ascontiguousarray(model), np.array([self.focal1, self.focal2]), directions)
        sampson_equations(columns, *weigher(residuals[0]), directions, hessian, gradient)
        mirror(hessian)
        return NormalEquations(hessian, gradient), residuals[0]

    def moved(self, model: Array, step: Array, pivot: Array) -> Array:
        """The pose after a step: a turn w, and a shift of t in its tangent plane."""
        moved = np.empty((3, 4))
        move(np.ascontiguousarray(model), step, moved)
        return moved

    def transform(self, model: Array) -> Array:
        return homogeneous(model)

    def distance(self, a: Array, b: Array) -> Array:
        """Angle between the rotations, in degrees."""
        return rotation_distance(a, b)

    def average(self, models: Array, rows: Array) -> Array:
        return mean_motion(models, self.pivot(rows), is_direction=True)

    def _derivatives(self, model: Array, rows: Array) -> tuple[Array, Array]:
        residuals, jacobian = np.empty(len(rows)), np.empty((len(rows), 5))
        sampson_jacobian(
            self._columns(rows), np.array([self.focal1, self.focal2]), np.ascontiguousarray(model), residuals, jacobian
        )
        return residuals, jacobian

    def _transfer_error(self, model: Array, plane: Array, rows: Array) -> Array:
        return transfer_errors(model, plane, rows, (self.focal1, self.focal2))

    def _geometries(self, models: Array) -> Array:
        models = np.ascontiguousarray(models).reshape(-1, 3, 4)
        geometries = np.empty((len(models), 8, 3))
        epipolar_geometries(models, self.focal1, self.focal2, geometries)
        return geometries

    def _columns(self, rows: Array) -> Array:
        """The coordinates in pixels (4, N), copied once."""
        focals = np.array([self.focal1, self.focal1, self.focal2, self.focal2])
        return np.multiply(rows.T, focals[:, None], order="C")


def _are_alike(a: Array, b: Array) -> bool:
    """Whether two poses are the same but for some degrees."""
    return bool(rotation_distance(a, b) < _SAME and a[:, 3] @ b[:, 3] > 0.0)
