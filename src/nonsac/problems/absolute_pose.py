"""Absolute pose of a calibrated camera (PnP)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.ladder import reprojection_ladder
from nonsac.kernels.losses import mirror
from nonsac.kernels.p3p import p3p_poses
from nonsac.kernels.pose_fit import fit_pose, move
from nonsac.kernels.reprojection import (
    count_reprojection_inliers,
    reprojection_equations,
    reprojection_jacobian,
    reprojection_residuals,
)
from nonsac.layouts import POINTS, Array
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
    positive,
    rotation_distance,
    rotation_is_certain,
    spread_out,
)
from nonsac.problems.registration import centre
from nonsac.problems.special_case import SpecialCase
from nonsac.result import Uncertainty

_SAME_POSE = 3.0  # degrees


@dataclass(frozen=True)
class AbsolutePose(Streaming, Problem):
    """camera = R world + t, for rows `u v X Y Z`: normalised image coordinates and the point in the world.

    The residual is the distance in the image between the point and where it was seen (Hartley and Zisserman 2003), in
    pixels if the focal length is given, and in normalised coordinates otherwise. It is infinite for points behind
    the camera.

    Parameters
    ----------
    focal : float
        Focal length in pixels.
    """

    focal: float = 1.0

    layout = POINTS
    minimal_size = 3
    residual_dimension = 2

    def __post_init__(self) -> None:
        object.__setattr__(self, "focal", positive("focal", self.focal))

    def solve_minimal(self, samples: Array) -> Array:
        """Poses of B samples of three rows (B, 3, 5): none to four each, with the points in front of the camera."""
        models = np.empty((4 * len(samples), 3, 4))
        return models[: p3p_poses(np.ascontiguousarray(samples), models)]

    def residuals(self, models: Array, rows: Array) -> Array:
        models = np.ascontiguousarray(models).reshape(-1, 3, 4)
        residuals = np.empty((len(models), len(rows)))
        reprojection_residuals(models, np.ascontiguousarray(rows.T), residuals)
        return residuals * self.focal

    def count_inliers(self, models: Array, rows: Array, threshold: float, weights: Array | None = None) -> NDArray[Any]:
        if weights is not None:
            return super().count_inliers(models, rows, threshold, weights)
        # Single precision is twice as fast; near the origin its error does not matter.
        origin = centre(rows)[2:]
        columns = np.ascontiguousarray((rows - [0.0, 0.0, *origin]).T, np.float32)
        counts = np.empty(len(models), np.int64)
        square = np.float32((threshold / self.focal) ** 2)
        count_reprojection_inliers(moved_origin(models, origin).astype(np.float32), columns, square, counts)
        return counts

    def count_on_ladder(self, models: Array, rows: Array, thresholds: Array) -> NDArray[np.int64]:
        origin = centre(rows)[2:]
        columns = np.ascontiguousarray((rows - [0.0, 0.0, *origin]).T, np.float32)
        counts = np.empty((len(models), len(thresholds)), np.int64)
        square = np.float32((self.focal / thresholds[0]) ** 2)
        centred = moved_origin(models, origin).astype(np.float32)
        reprojection_ladder(centred, columns, square, self.minimal_size, counts)
        return counts

    def refit(self, model: Array, rows: Array, weights: Array) -> Array:
        """Weighted least squares in the image, by Levenberg and Marquardt's method from `model`."""
        return self.fit_robustly(model, rows, weights, np.inf, 50)

    def fit_robustly(self, model: Array, rows: Array, weights: Array, threshold: float, iterations: int) -> Array:
        """The same with Tukey's biweight loss, which is constant beyond the threshold."""
        if np.count_nonzero(weights) < self.minimal_size or not np.isfinite(model).all():
            return self.no_model
        columns, origin = self._centred(rows)
        fitted = moved_origin(model, origin)
        ok = fit_pose(columns, weights, float(threshold), iterations, np.array([self.focal, 1.0]), fitted)
        return moved_origin(fitted, -origin) if ok else self.no_model

    def determined(self, model: Array, inliers: Array, noise: Noise) -> bool:
        """False for points on a line, and if the rotation is uncertain by half a radian or more."""
        if len(inliers) < self.minimal_size or not spread_out(inliers[:, 2:]):
            return False
        if not np.isfinite(model).all():
            return True
        jacobian = self._derivatives(model, inliers)[1]
        return rotation_is_certain(least_squares_covariance(jacobian, noise.sigma))

    def resolution(self, model: Array, inliers: Array, noise: Noise) -> Array:
        in_image = RESOLVED * noise.sigma / self.focal
        in_space = in_image * float(np.median(self._depths(model, inliers)))
        return np.array([in_image, in_image, in_space, in_space, in_space])

    def standard_errors(self, model: Array, inliers: Array, noise: Noise) -> tuple[float, float]:
        covariance = least_squares_covariance(self._derivatives(model, inliers)[1], noise.sigma)
        shift = covariance[3:, 3:] / float(np.median(self._depths(model, inliers))) ** 2
        return largest_error(covariance[:3, :3]), largest_error(shift)

    def _depths(self, model: Array, rows: Array) -> Array:
        return np.asarray(rows[:, 2:] @ model[2, :3] + model[2, 3])

    def special_cases(self, model: Array, inliers: Array, noise: Noise) -> tuple[SpecialCase, ...]:
        """What a plane explains of these inliers: with little perspective, it allows a second pose."""
        points = inliers[:, 2:]
        centre_of_plane, normal = plane_of_points(points)
        relief = self.focal * np.abs((points - centre_of_plane) @ normal) / self._depths(model, inliers)
        flat = relief < noise.threshold
        others = np.empty((0, 3, 4))
        if flat.mean() > 0.5:
            twin = reflected_pose(model, centre_of_plane, normal)
            fitted = self.fit_robustly(twin, inliers, np.ones(len(inliers)), 2.0 * noise.threshold, 50)
            if np.isfinite(fitted).all() and rotation_distance(fitted, model) > _SAME_POSE:
                others = fitted[None]
        return (SpecialCase("planar", flat, determined=True, others=others),)

    def covariance(self, model: Array, inliers: Array, noise: Noise) -> Array:
        """Covariance (6, 6) of the rotation vector w (R becomes exp([w]x) R, radians) and of t."""
        residuals, jacobian = self._derivatives(model, inliers)
        centred = robust_covariance(residuals, jacobian, noise.threshold)
        return at_origin(centred, model[:, :3] @ centre(inliers)[2:])

    def uncertainty(self, covariance: Array, model: Array, inliers: Array) -> Uncertainty:
        centred = at_origin(covariance, -model[:, :3] @ centre(inliers)[2:])
        angle = likely_length(centred[SHIFT, SHIFT]) / float(np.median(self._depths(model, inliers)))
        rotation = float(np.degrees(likely_length(covariance[ROTATION, ROTATION])))
        return Uncertainty(rotation, likely_length(covariance[SHIFT, SHIFT]), float(np.degrees(angle)))

    def pivot(self, rows: Array) -> Array:
        """A point amid the world's (3,)."""
        return centre(rows)[2:]

    def normal_equations(
        self, model: Array, rows: Array, weigher: Weigher, pivot: Array
    ) -> tuple[NormalEquations, Array]:
        residuals, hessian, gradient = self.residuals(model[None], rows)[0], np.zeros((6, 6)), np.zeros(6)
        columns, about_pivot = self._columns(rows, pivot), moved_origin(model, pivot)
        reprojection_equations(columns, *weigher(residuals), self.focal, about_pivot, hessian, gradient)
        mirror(hessian)
        return NormalEquations(hessian, gradient), residuals

    def moved(self, model: Array, step: Array, pivot: Array) -> Array:
        """The pose after a step: a turn w of the world about the pivot, and a shift."""
        moved = np.empty((3, 4))
        move(moved_origin(model, pivot), step, moved)
        return moved_origin(moved, -pivot)

    def transform(self, model: Array) -> Array:
        return homogeneous(model)

    def distance(self, a: Array, b: Array) -> Array:
        """Angle between the rotations, in degrees."""
        return rotation_distance(a, b)

    def average(self, models: Array, rows: Array) -> Array:
        return mean_motion(models, self.pivot(rows))

    def _derivatives(self, model: Array, rows: Array) -> tuple[Array, Array]:
        """Residuals (N, 2) and their derivatives (N, 2, 6), for points relative to their centre."""
        columns, origin = self._centred(rows)
        residuals, jacobian = np.empty((len(rows), 2)), np.empty((len(rows), 2, 6))
        reprojection_jacobian(columns, self.focal, moved_origin(model, origin), residuals, jacobian)
        return residuals, jacobian

    def _centred(self, rows: Array) -> tuple[Array, Array]:
        """Columns (5, N) with image coordinates in pixels and points relative to their centre, and that centre."""
        origin = centre(rows)[2:]
        return self._columns(rows, origin), origin

    def _columns(self, rows: Array, origin: Array) -> Array:
        columns = np.ascontiguousarray(rows.T)
        columns[:2] *= self.focal
        columns[2:] -= origin[:, None]
        return columns


def moved_origin(models: Array, origin: Array) -> Array:
    """The models (..., 3, 4) for points that are given relative to an origin."""
    moved = np.array(models, np.float64)
    moved[..., 3] += moved[..., :3] @ origin
    return moved


def plane_of_points(points: Array) -> tuple[Array, Array]:
    """Centre (3,) and unit normal (3,) of the least-squares plane of points (n, 3)."""
    centre = points.mean(axis=0)
    return centre, np.linalg.svd(points - centre, full_matrices=False)[2][2]


def reflected_pose(model: Array, centre: Array, normal: Array) -> Array:
    """The pose (3, 4) that turns the plane about its centre to the other side of the line of sight.

    Without perspective both poses give the same image (Oberkampf, DeMenthon and Davis 1996; Collins and Bartoli,
    "Infinitesimal plane-based pose estimation", IJCV 2014), so with little of it the other one is a second minimum.
    """
    sight = model[:, :3] @ centre + model[:, 3]
    direction = sight / np.linalg.norm(sight)
    rotation = _mirror(direction) @ model[:, :3] @ _mirror(normal)
    return np.column_stack([rotation, sight - rotation @ centre])


def _mirror(normal: Array) -> Array:
    return np.eye(3) - 2.0 * np.outer(normal, normal)
