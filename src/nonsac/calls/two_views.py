"""From the result of a pair of views to what COLMAP stores of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nonsac.cameras.camera import Camera
from nonsac.cameras.models import pinhole_matrix
from nonsac.io.correspondences import Matches
from nonsac.io.two_view_geometry import Configuration, TwoViewGeometry
from nonsac.layouts import Array
from nonsac.problems.two_view import rotation_of, transfer_errors
from nonsac.result import Remark, Result, Status
from nonsac.values.quiet import quiet

# Of COLMAP's default settings: of the diagonal; of the inliers; pixels.
_BORDER, _IN_BORDER, _SHIFTED_ALIKE, _SHIFT_ERROR = 0.1, 0.7, 0.7, 4.0
_AT_INFINITY = np.zeros(3)
_FEWEST_OF_HOMOGRAPHY, _ROUNDS, _ABOUT_AS_WELL = 4, 6, 3.0


class View(NamedTuple):
    """What is to be written of a pair, and which of its matches are inliers (n,)."""

    geometry: TwoViewGeometry
    inliers: NDArray[np.bool_]


@quiet
def view_of(result: Result, matches: Matches, cameras: tuple[Camera, Camera]) -> View:
    """The geometry of two views that a result shows, without inliers if it is not to be trusted.

    What is trusted is the kind of geometry. A pure rotation has no baseline, so that the result is degenerate, but it
    is a panorama; a plane allows a second pose, so that the result may be ambiguous, but its homography is known. A
    rotation that explains all if the focal length were another one may be a plane that faces the camera as well. What
    pose it has is then left out.
    """
    chosen, inliers = _configuration(result), result.inliers
    has_evidence = result.found and result.status not in (Status.TOO_FEW, Status.LOW_SUPPORT)
    if has_evidence and _are_watermark(matches.points1[inliers], matches.points2[inliers], cameras):
        return View(TwoViewGeometry(Configuration.WATERMARK), inliers)
    if chosen in (Configuration.UNDEFINED, Configuration.DEGENERATE):
        return View(TwoViewGeometry(chosen), np.zeros(len(matches), bool))
    matrices = [pinhole_matrix(camera.model, camera.params) for camera in cameras]
    rotation, translation = result.R, result.t
    if chosen is Configuration.PANORAMIC:
        rotation, inliers = _turn(result, matches, cameras)
    homography = None
    if chosen is not Configuration.CALIBRATED:
        homography = homography_of(matches.points1[inliers], matches.points2[inliers])
    if chosen is Configuration.PLANAR_OR_PANORAMIC and homography is not None:
        inliers = _transfer_errors(homography, matches.points1, matches.points2) < result.threshold
    found = TwoViewGeometry.of_pose(rotation, translation, matrices, chosen, homography)
    if chosen is Configuration.PANORAMIC:
        found = TwoViewGeometry(chosen, found.E, found.F, homography, rotation, np.zeros(3))
    elif not result.success:
        found = TwoViewGeometry(chosen, found.E, found.F, homography)
    return View(found, inliers)


def _configuration(result: Result) -> Configuration:
    remarks, status = result.remarks, result.status
    if status is Status.OK:
        return Configuration.PLANAR if Remark.PLANAR in remarks else Configuration.CALIBRATED
    if status is Status.DEGENERATE and Remark.PURE_ROTATION in remarks:
        return Configuration.PANORAMIC
    if Remark.PLANAR in remarks and status is Status.AMBIGUOUS:
        return Configuration.PLANAR
    is_flat = Remark.PLANAR in remarks and status is Status.UNCERTAIN
    if is_flat or (status is Status.DEGENERATE and any(r.startswith(f"{Remark.PURE_ROTATION}: ") for r in remarks)):
        return Configuration.PLANAR_OR_PANORAMIC
    is_undecided = status in (Status.AMBIGUOUS, Status.UNCERTAIN, Status.TIME_LIMIT)
    return Configuration.UNDEFINED if is_undecided else Configuration.DEGENERATE


def _turn(result: Result, matches: Matches, cameras: tuple[Camera, Camera]) -> tuple[Array, NDArray[np.bool_]]:
    """The rotation without a baseline, and what it explains: a pose that explains it has turned a little away."""
    first, second = cameras
    rows = np.hstack([first.normalise(matches.points1), second.normalise(matches.points2)])
    focals, some = (first.focal, second.focal), rows[result.inliers]
    turned = rotation_of(result.model, some, lambda model: transfer_errors(model, _AT_INFINITY, some, focals))
    errors = transfer_errors(turned, _AT_INFINITY, rows, focals)
    return turned[:, :3], np.nan_to_num(errors, nan=np.inf) < result.threshold


def homography_of(points1: Array, points2: Array) -> Array | None:
    """The homography x2 ~ H x1 that most of the points (n, 2) fit best; None of fewer than four.

    The normalised direct linear transformation (Hartley and Zisserman, Algorithm 4.2), some times to those that fit
    about as well as half of them do.
    """
    chosen = np.ones(len(points1), bool)
    homography = None
    for _ in range(_ROUNDS):
        if np.count_nonzero(chosen) < _FEWEST_OF_HOMOGRAPHY:
            break
        homography = _transformation(points1[chosen], points2[chosen])
        errors = _transfer_errors(homography, points1, points2)
        chosen = errors <= _ABOUT_AS_WELL * np.median(errors)
    return homography


def _transfer_errors(homography: Array, points1: Array, points2: Array) -> Array:
    """How far points are from where a homography moves their partners to; infinite if it is nowhere."""
    moved = np.column_stack([points1, np.ones(len(points1))]) @ homography.T
    return np.nan_to_num(np.linalg.norm(moved[:, :2] / moved[:, 2:] - points2, axis=1), nan=np.inf)


def _transformation(points1: Array, points2: Array) -> Array:
    (first, frame1), (second, frame2) = _normalised(points1), _normalised(points2)
    nothing = np.zeros_like(first)
    upper = np.hstack([nothing, -first, second[:, 1:2] * first])
    lower = np.hstack([first, nothing, -second[:, :1] * first])
    homography = np.linalg.svd(np.vstack([upper, lower]), full_matrices=False)[2][-1].reshape(3, 3)
    homography = np.linalg.solve(frame2, homography @ frame1)
    return np.asarray(homography / homography[2, 2])


def _normalised(points: Array) -> tuple[Array, Array]:
    """Homogeneous points (n, 3) about the origin, at a distance of sqrt 2 from it in the mean; and the map (3, 3)."""
    middle = points.mean(axis=0)
    scale = np.sqrt(2.0) / max(float(np.linalg.norm(points - middle, axis=1).mean()), 1e-12)
    frame = np.array([[scale, 0.0, -scale * middle[0]], [0.0, scale, -scale * middle[1]], [0.0, 0.0, 1.0]])
    return np.column_stack([points, np.ones(len(points))]) @ frame.T, frame


def _are_watermark(points1: Array, points2: Array, cameras: tuple[Camera, Camera]) -> bool:
    """Whether matches lie in the border of both images and are shifted alike, as COLMAP tells watermarks.

    Not if the size of an image is not known.
    """
    in_border = np.ones(len(points1), bool)
    for points, camera in zip((points1, points2), cameras, strict=True):
        if camera.width is None or camera.height is None:
            return False
        size = np.array([camera.width, camera.height], np.float64)
        margin = _BORDER * float(np.linalg.norm(size))
        in_border &= ((points < margin) | (points > size - margin)).any(axis=1)
    shifts = points2 - points1
    alike = np.linalg.norm(shifts - np.median(shifts, axis=0), axis=1) < _SHIFT_ERROR
    return bool(in_border.mean() >= _IN_BORDER and alike.mean() >= _SHIFTED_ALIKE)
