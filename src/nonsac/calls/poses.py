"""Poses of cameras from matched points."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.calls.arguments import warn_dropped_rows
from nonsac.calls.image_area import remarks_on_image_area
from nonsac.calls.rows import rows_of_arrays, rows_of_source
from nonsac.cameras.camera import Camera, CameraLike
from nonsac.estimators.named import chosen_estimator
from nonsac.kernels.ahead import compile_for
from nonsac.layouts import MATCHES, POINTS, Array
from nonsac.method.pipeline import run
from nonsac.method.settings import KeywordsAndEstimator, Settings, shows_settings
from nonsac.problems import AbsolutePose, RelativePose
from nonsac.result import Result, Status
from nonsac.sources.contract import Source
from nonsac.sources.mapped import Map
from nonsac.values.quiet import quiet

_LARGEST_NORMALISED = 10.0


@shows_settings()
def relative_pose(
    points1: ArrayLike | Source,
    points2: ArrayLike | None = None,
    camera1: CameraLike | None = None,
    camera2: CameraLike | None = None,
    *,
    weights: ArrayLike | None = None,
    **settings: Unpack[KeywordsAndEstimator],
) -> Result:
    """Pose of a second camera relative to a first one, from matched image points of which many may be wrong.

    Parameters
    ----------
    points1, points2 : (n, 2) array
        Row i of one is hypothesised to match row i of the other. Pixels if cameras are given, else normalised image
        coordinates (x/z, y/z) without distortion. Rows with NaN or infinity are dropped.

        Or `points1` alone: a source (see `nonsac.open_source`) with the columns x1 y1 x2 y2 and perhaps a weight, in
        this order; if it has columns of these names, they are picked by them.
    camera1, camera2 : camera, optional
        A matrix K (3, 3), `(fx, fy, cx, cy)`, `(K, distortion)` as OpenCV has them, a COLMAP model string or dict, or
        a `Camera`; `camera2` is `camera1` if it is left out. Nothing is shifted: points and cameras share one
        convention for the centres of pixels, (0, 0) for the first one as in OpenCV or (0.5, 0.5) as in COLMAP.
    weights : (n,) array, optional
        How much each match counts, not negative, in any unit: the certainty of a dense matcher, say.
    noise : float, optional
        Standard deviation of a right match, in pixels if cameras are given, else in normalised coordinates; measured
        if it is left out. Rows with a Sampson residual below 5 `noise` are inliers.
    {others}
        As in `nonsac.estimate`; the default estimator is `Ransac` with the five-point method, local optimisation and
        early stopping. The rule decides the answer only with refine="none". In `tlp_0.1` the p of the paper's Eq. 2 is
        applied to Sampson residuals as lengths; the paper compares their squares (Sec. 4.1), so that its p = 0.1 is
        `tlp_0.2` here.

    Returns
    -------
    Result
        X2 = R X1 + t in camera coordinates (x right, y down, z forward), |t| = 1: the length of the baseline cannot be
        known. `status` is `DEGENERATE` if a rotation explains all, so that t means nothing, and `AMBIGUOUS` if all
        inliers lie on a plane that allows a second pose (in `alternatives`); `info["remarks"]` says "planar".

    Raises
    ------
    ValueError, TypeError
        If an argument is out of its range; the message names it.
    """
    if camera1 is None and camera2 is not None:
        raise ValueError("camera1 must be given if camera2 is")
    first = None if camera1 is None else Camera.parse(camera1, "camera1")
    second = first if camera2 is None else Camera.parse(camera2, "camera2")
    problem = RelativePose() if first is None or second is None else RelativePose(first.focal, second.focal)
    chosen = Settings.of("relative_pose", settings).fitting(problem)
    estimator = chosen_estimator(chosen.estimator, problem)
    if isinstance(points1, Source):
        rows = rows_of_source(points1, MATCHES, "points1", points2=points2, weights=weights)
    else:
        rows = rows_of_arrays("relative_pose", {"points1": points1, "points2": points2}, MATCHES.widths, weights)
    a, b = rows.parts
    wrong_unit = [_warn_wrong_unit(a, "points1", first, "camera1"), _warn_wrong_unit(b, "points2", second, "camera2")]
    remarks = (*remarks_on_image_area(a, "points1", first), *remarks_on_image_area(b, "points2", second))
    source = rows.through([_normaliser(first), _normaliser(second)])
    compile_for("relative_pose", chosen.noise)
    return _judged(run(source, problem, estimator, chosen), any(wrong_unit), remarks)


@shows_settings()
def absolute_pose(
    points2d: ArrayLike | Source,
    points3d: ArrayLike | None = None,
    camera: CameraLike | None = None,
    *,
    weights: ArrayLike | None = None,
    **settings: Unpack[KeywordsAndEstimator],
) -> Result:
    """Pose of a camera in the world (PnP), from image points matched to 3D points, of which many may be wrong.

    Parameters
    ----------
    points2d : (n, 2) array
        Pixels if a camera is given, else normalised image coordinates (x/z, y/z) without distortion.
    points3d : (n, 3) array
        Row i is hypothesised to be seen at row i of `points2d`; any unit and origin. Rows with NaN or infinity are
        dropped.

        Or `points2d` alone: a source with the columns u v X Y Z and perhaps a weight, as in `relative_pose`.
    camera : camera, optional
        A matrix K (3, 3), `(fx, fy, cx, cy)`, `(K, distortion)` as OpenCV has them, a COLMAP model string or dict, or
        a `Camera`, with the same convention for the centres of pixels as the points.
    weights : (n,) array, optional
        How much each match counts, not negative, in any unit.
    noise : float, optional
        Standard deviation of an image point in each direction, in pixels if a camera is given, else in normalised
        coordinates; measured if it is left out. Rows with a reprojection error below 5 `noise` are inliers; points
        behind the camera never are.
    {others}
        As in `nonsac.estimate`; the default estimator is `Ransac` with P3P, local optimisation and early stopping. The
        rule decides the answer only with refine="none".

    Returns
    -------
    Result
        camera = R world + t, as COLMAP and PoseLib have it; the camera's centre is -R^T t.

    Raises
    ------
    ValueError, TypeError
        If an argument is out of its range; the message names it.
    """
    parsed = None if camera is None else Camera.parse(camera, "camera")
    problem = AbsolutePose() if parsed is None else AbsolutePose(parsed.focal)
    chosen = Settings.of("absolute_pose", settings).fitting(problem)
    estimator = chosen_estimator(chosen.estimator, problem)
    if isinstance(points2d, Source):
        rows = rows_of_source(points2d, POINTS, "points2d", points3d=points3d, weights=weights)
    else:
        rows = rows_of_arrays("absolute_pose", {"points2d": points2d, "points3d": points3d}, POINTS.widths, weights)
    wrong_unit = _warn_wrong_unit(rows.parts[0], "points2d", parsed, "camera")
    remarks = remarks_on_image_area(rows.parts[0], "points2d", parsed)
    source = rows.through([_normaliser(parsed), None])
    compile_for("absolute_pose", chosen.noise)
    return _judged(run(source, problem, estimator, chosen), wrong_unit, remarks)


def _judged(result: Result, wrong_unit: bool, remarks: tuple[str, ...]) -> Result:
    """The result and further remarks; not to be trusted if the points are in another unit than the cameras say."""
    if remarks:
        result = replace(result, info=result.info | {"remarks": (*result.info["remarks"], *remarks)})
    warn_dropped_rows(result, "that are NaN or infinite, or that the lens maps no ray to", stacklevel=3)
    if wrong_unit and result.status in (Status.OK, Status.AMBIGUOUS):
        # What fits nearly parallel rays, or one point, is no pose.
        return replace(result, status=Status.DEGENERATE, confidence=0.0)
    return result


def _normaliser(camera: Camera | None) -> Map | None:
    return None if camera is None else camera.normalise


def _warn_wrong_unit(points: NDArray[Any], name: str, camera: Camera | None, camera_name: str) -> bool:
    """Whether these are pixels without a camera, or normalised coordinates with one, going by some; and warn of it."""
    some = _some_sizes(points)
    if camera is None and look_like_pixels(points):
        message = (
            f"{name} look like pixels (median size {np.median(some):.3g}), not like normalised image coordinates: "
        )
        warnings.warn(f"{message}pass {camera_name}", stacklevel=3)
        return True
    if camera is not None and len(some) and some.max() < _LARGEST_NORMALISED < 0.1 * camera.focal:
        message = f"{name} look like normalised image coordinates (at most {some.max():.3g}), not like pixels: "
        warnings.warn(f"{message}leave {camera_name} out, and give noise in their unit", stacklevel=3)
        return True
    return False


def look_like_pixels(points: NDArray[Any]) -> bool:
    """Whether image points are too far from the origin to be normalised coordinates, going by some."""
    some = _some_sizes(points)
    return bool(len(some) and np.median(some) > _LARGEST_NORMALISED)


@quiet
def _some_sizes(points: NDArray[Any]) -> Array:
    sizes = np.abs(points[:: max(1, len(points) // 1000)].astype(np.float64))
    return sizes[np.isfinite(sizes)]
