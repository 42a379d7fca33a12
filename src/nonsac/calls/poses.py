"""Camera poses: choose the parts, run the pipeline."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.calls.arguments import warn_dropped_rows
from nonsac.calls.rows import Correspondences, rows_of_arrays, rows_of_source
from nonsac.cameras.camera import Camera, CameraLike
from nonsac.estimators import Ransac
from nonsac.estimators.contract import Estimator
from nonsac.layouts import MATCHES, POINTS
from nonsac.method.budget import Auto
from nonsac.method.pipeline import estimate
from nonsac.method.refine import Refiner
from nonsac.method.scoring import ScoringRule
from nonsac.problems import AbsolutePose, RelativePose, Weighted
from nonsac.problems.contract import Problem
from nonsac.result import Array, Result, Status
from nonsac.running.executors import Workers
from nonsac.sources.contract import Source

Random = int | np.random.Generator | None
Progress = Callable[[int, int], object]

_LARGEST_NORMALISED = 10.0


def relative_pose(
    points1: ArrayLike | Source,
    points2: ArrayLike | None = None,
    camera1: CameraLike | None = None,
    camera2: CameraLike | None = None,
    *,
    noise: float | None = None,
    weights: ArrayLike | None = None,
    samples: int | Auto = "auto",
    sample_size: int | Auto = "auto",
    max_samples: int = 100,
    time_limit: float | None = None,
    max_memory: int | str | None = None,
    estimator: Estimator | None = None,
    rule: str | ScoringRule = "tlp_0.1",
    refine: str | Refiner = "polish",
    workers: Workers = None,
    rng: Random = 0,
    progress: Progress | None = None,
) -> Result:
    """Pose of a second camera relative to a first one, from matched image points of which many may be wrong.

    Parameters
    ----------
    points1, points2 : (n, 2) array
        Row i of one is hypothesised to match row i of the other. Pixels where cameras are given, else normalised
        image coordinates (x/z, y/z) without distortion. Rows with NaN or infinity are dropped.

        Or `points1` alone: a source (see `nonsac.open_source`) with the columns x1 y1 x2 y2 and perhaps a weight, in
        this order; where it has columns of these names, they are picked by them.
    camera1, camera2 : camera, optional
        A matrix K (3, 3), `(fx, fy, cx, cy)`, a COLMAP model string or dict, or a `Camera`; `camera2` is `camera1`
        where it is left out. Nothing is shifted: points and cameras share one convention for the centres of pixels,
        (0, 0) for the first one as in OpenCV or (0.5, 0.5) as in COLMAP.
    noise : float, optional
        Standard deviation of a right match, in pixels where cameras are given, else in normalised coordinates; measured
        where it is left out. Rows with a Sampson residual below 5 `noise` are inliers.
    weights : (n,) array, optional
        How much each match counts, not negative, in any unit: the certainty of a dense matcher, say.
    samples, sample_size, max_samples, time_limit, max_memory, estimator, rule, refine, workers, rng, progress
        As in `nonsac.estimate`; the default estimator is `Ransac` with the five-point method, local optimisation and
        early stopping.

    Returns
    -------
    Result
        X2 = R X1 + t in camera coordinates (x right, y down, z forward), |t| = 1: the length of the baseline cannot be
        known. `status` is `DEGENERATE` where a rotation explains all, so that t means nothing, and `AMBIGUOUS` where
        all inliers lie on a plane that allows a second pose (in `alternatives`); `info["remarks"]` says "planar".

    Raises
    ------
    ValueError, TypeError
        Where an argument is out of its range; the message names it.
    """
    if isinstance(points1, Source):
        rows = rows_of_source(points1, MATCHES, "points1", points2=points2, weights=weights)
    else:
        rows = rows_of_arrays("relative_pose", {"points1": points1, "points2": points2}, MATCHES.widths, weights)
    if camera1 is None and camera2 is not None:
        raise ValueError("camera1 must be given where camera2 is")
    first = None if camera1 is None else Camera.parse(camera1, "camera1")
    second = first if camera2 is None else Camera.parse(camera2, "camera2")
    a, b = rows.parts
    wrong_unit = [_warn_wrong_unit(a, "points1", first, "camera1"), _warn_wrong_unit(b, "points2", second, "camera2")]
    problem = RelativePose() if first is None or second is None else RelativePose(first.focal, second.focal)
    return _estimate(
        rows,
        [_normaliser(first), _normaliser(second)],
        problem,
        any(wrong_unit),
        noise=noise,
        samples=samples,
        sample_size=sample_size,
        max_samples=max_samples,
        time_limit=time_limit,
        max_memory=max_memory,
        estimator=estimator,
        rule=rule,
        refine=refine,
        workers=workers,
        rng=rng,
        progress=progress,
    )


def absolute_pose(
    points2d: ArrayLike | Source,
    points3d: ArrayLike | None = None,
    camera: CameraLike | None = None,
    *,
    noise: float | None = None,
    weights: ArrayLike | None = None,
    samples: int | Auto = "auto",
    sample_size: int | Auto = "auto",
    max_samples: int = 100,
    time_limit: float | None = None,
    max_memory: int | str | None = None,
    estimator: Estimator | None = None,
    rule: str | ScoringRule = "tlp_0.1",
    refine: str | Refiner = "polish",
    workers: Workers = None,
    rng: Random = 0,
    progress: Progress | None = None,
) -> Result:
    """Pose of a camera in the world (PnP), from image points matched to 3D points, of which many may be wrong.

    Parameters
    ----------
    points2d : (n, 2) array
        Pixels where a camera is given, else normalised image coordinates (x/z, y/z) without distortion.
    points3d : (n, 3) array
        Row i is hypothesised to be seen at row i of `points2d`; any unit and origin. Rows with NaN or infinity are
        dropped.

        Or `points2d` alone: a source with the columns u v X Y Z and perhaps a weight, as in `relative_pose`.
    camera : camera, optional
        A matrix K (3, 3), `(fx, fy, cx, cy)`, a COLMAP model string or dict, or a `Camera`, with the same convention
        for the centres of pixels as the points.
    noise : float, optional
        Standard deviation of an image point in each direction, in pixels where a camera is given, else in normalised
        coordinates; measured where it is left out. Rows with a reprojection error below 5 `noise` are inliers; points
        behind the camera never are.
    weights : (n,) array, optional
        How much each match counts, not negative, in any unit.
    samples, sample_size, max_samples, time_limit, max_memory, estimator, rule, refine, workers, rng, progress
        As in `relative_pose`, with P3P in place of the five-point method.

    Returns
    -------
    Result
        camera = R world + t, as COLMAP and PoseLib have it; the camera's centre is -R^T t.

    Raises
    ------
    ValueError, TypeError
        Where an argument is out of its range; the message names it.
    """
    if isinstance(points2d, Source):
        rows = rows_of_source(points2d, POINTS, "points2d", points3d=points3d, weights=weights)
    else:
        rows = rows_of_arrays("absolute_pose", {"points2d": points2d, "points3d": points3d}, POINTS.widths, weights)
    parsed = None if camera is None else Camera.parse(camera, "camera")
    wrong_unit = [_warn_wrong_unit(rows.parts[0], "points2d", parsed, "camera")]
    return _estimate(
        rows,
        [_normaliser(parsed), None],
        AbsolutePose() if parsed is None else AbsolutePose(parsed.focal),
        any(wrong_unit),
        noise=noise,
        samples=samples,
        sample_size=sample_size,
        max_samples=max_samples,
        time_limit=time_limit,
        max_memory=max_memory,
        estimator=estimator,
        rule=rule,
        refine=refine,
        workers=workers,
        rng=rng,
        progress=progress,
    )


def _estimate(
    rows: Correspondences,
    maps: list[Callable[[Array], Array] | None],
    problem: Problem,
    wrong_unit: bool,
    estimator: Estimator | None,
    **settings: Any,
) -> Result:
    if estimator is None:
        # With a small baseline nearly every pose has nearly all inliers, and a good one needs a longer search.
        least = 1000 if isinstance(problem, RelativePose) else 100
        estimator = Ransac(20_000, confidence=0.9999, local_optimisation=True, least_iterations=least)
    result = estimate(rows.through(maps), Weighted(problem) if rows.weighted else problem, estimator, **settings)
    warn_dropped_rows(result, "that are NaN or infinite, or that the lens maps no ray to", stacklevel=3)
    if wrong_unit and result.status in (
        Status.OK,
        Status.AMBIGUOUS,
    ):  # what fits nearly parallel rays, or one point, is no pose
        result = replace(result, status=Status.DEGENERATE, confidence=0.0)
    return result


def _normaliser(camera: Camera | None) -> Callable[[Array], Array] | None:
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


def _some_sizes(points: NDArray[Any]) -> Array:
    sizes = np.abs(points[:: max(1, len(points) // 1000)].astype(np.float64))
    return sizes[np.isfinite(sizes)]
