"""OpenCV's USAC framework for two views and for one, and its older RANSAC for one (docs.opencv.org, module calib3d).

USAC is by Raguram et al. ("USAC: a universal framework for random sample consensus", PAMI 2013), and written anew by
Ivashechkin, Barath and Matas (2020). Its licence is Apache-2.0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nonsac.estimators.others.frame import Frame, near
from nonsac.estimators.others.library import CONFIDENCE, Library, normalised
from nonsac.layouts import Array
from nonsac.problems.absolute_pose import AbsolutePose
from nonsac.problems.contract import Problem
from nonsac.problems.relative_pose import RelativePose

_CAMERA = np.eye(3)
_NEAR = 0.4  # of our threshold of five standard deviations: two of them hold 95 % of the inliers
_BOUNDS = 1e-7, 1e3  # of the threshold, in normalised image coordinates of single precision

# What OpenCV's flags of these names stand for; with parameters in place of a flag there is a seed.
_USAC: dict[str, dict[str, Any]] = {
    "default": {"score": "SCORE_METHOD_MSAC", "loMethod": "LOCAL_OPTIM_INNER_AND_ITER_LO"},
    "accurate": {"score": "SCORE_METHOD_MSAC", "loMethod": "LOCAL_OPTIM_GC", "loSampleSize": 20, "loIterations": 25},
    "magsac": {"score": "SCORE_METHOD_MAGSAC", "loMethod": "LOCAL_OPTIM_SIGMA", "loSampleSize": 50, "loIterations": 10},
}


def default(problem: Problem) -> Library:
    """USAC with MSAC's scores, and local optimisation by an inner and an iterated RANSAC."""
    return Library(_Usac("default"))


def accurate(problem: Problem) -> Library:
    """USAC with graph-cut optimisation (Barath and Matas, "Graph-cut RANSAC", CVPR 2018)."""
    return Library(_Usac("accurate"))


def magsac(problem: Problem) -> Library:
    """USAC with MAGSAC++'s scores (Barath et al., CVPR 2020)."""
    return Library(_Usac("magsac"))


def p3p(problem: Problem) -> Library:
    """RANSAC as it was before USAC, by P3P and a fourth point."""
    return Library(one_view_by_p3p)


def sqpnp(problem: Problem) -> Library:
    """USAC's inliers, fitted by SQPnP (Terzakis and Lourakis, "A consistently fast and globally optimal solution to the
    perspective-n-point problem", ECCV 2020)."""
    return Library(one_view_by_sqpnp)


@dataclass(frozen=True)
class _Usac:
    """USAC with the settings of a name."""

    name: str

    def __call__(self, problem: Any, values: Array, threshold: float, seed: int, iterations: int) -> Array | None:
        bound = normalised(problem, threshold)
        if isinstance(problem, RelativePose):
            rows = _single(values)
            enough = len(rows) >= problem.minimal_size
            return two_views(rows, _settings(self.name, _NEAR * bound, seed, iterations)) if enough else None
        return _View.of(values).pose(_settings(self.name, bound, seed, iterations))


def two_views(rows: Array, settings: Any) -> Array | None:
    """The four poses of the essential matrix; in front of both cameras, points have the least residuals."""
    import cv2

    first, second = (np.ascontiguousarray(half) for half in np.hsplit(rows, 2))
    matrix, _ = cv2.findEssentialMat(first, second, _CAMERA, _CAMERA, None, None, settings)
    if matrix is None or np.shape(matrix) != (3, 3):
        return None
    *rotations, shift = cv2.decomposeEssentialMat(matrix)
    return np.stack([np.column_stack([R, sign * shift]) for R in rotations for sign in (1.0, -1.0)])


def one_view_by_sqpnp(
    problem: AbsolutePose, values: Array, threshold: float, seed: int, iterations: int
) -> Array | None:
    view = _View.of(values)
    inliers = view.consensus(_settings("default", normalised(problem, threshold), seed, iterations))[2]
    return None if inliers is None else view.fitted(inliers.ravel())


def one_view_by_p3p(problem: AbsolutePose, values: Array, threshold: float, seed: int, iterations: int) -> Array | None:
    """There is no seed: it draws the same samples each time."""
    import cv2

    view, bound = _View.of(values), normalised(problem, threshold)
    if len(view.points) < 4:
        return None
    found, turn, shift, _ = cv2.solvePnPRansac(
        view.points,
        view.seen,
        _CAMERA,
        None,
        iterationsCount=iterations,
        reprojectionError=bound,
        confidence=CONFIDENCE,
        flags=cv2.SOLVEPNP_P3P,
    )
    return view.model(turn, shift) if found else None


def _single(values: Array) -> Array:
    """Rows for which single precision is enough; too large or too small numbers keep USAC busy for ever."""
    return np.round(near(values, 1e4), 9)


@dataclass(frozen=True)
class _View:
    """Points of the world, in a frame of theirs, and where they are seen."""

    world: Frame
    points: Array
    seen: Array

    @classmethod
    def of(cls, values: Array) -> _View:
        world = Frame.of(values[:, 2:])
        rows = _single(np.hstack([values[:, :2], world.inside(values[:, 2:])]))
        return cls(world, np.ascontiguousarray(rows[:, 2:]), np.ascontiguousarray(rows[:, :2]))

    def pose(self, settings: Any) -> Array | None:
        """USAC's pose."""
        turn, shift, inliers = self.consensus(settings)
        return None if inliers is None else self.model(turn, shift)

    def consensus(self, settings: Any) -> tuple[Array, Array, Array | None]:
        """USAC's pose, as it gives it, and the numbers of its inliers."""
        import cv2

        found, _, turn, shift, inliers = cv2.solvePnPRansac(self.points, self.seen, _CAMERA, None, params=settings)
        return turn, shift, inliers if found else None

    def fitted(self, inliers: Array) -> Array | None:
        """The pose of some rows by SQPnP."""
        import cv2

        found, turn, shift = cv2.solvePnP(
            self.points[inliers], self.seen[inliers], _CAMERA, None, flags=cv2.SOLVEPNP_SQPNP
        )
        return self.model(turn, shift) if found else None

    def model(self, turn: Array, shift: Array) -> Array:
        import cv2

        return self.world.outside(cv2.Rodrigues(turn)[0], shift)


def _settings(name: str, threshold: float, seed: int, iterations: int) -> Any:
    import cv2

    settings = cv2.UsacParams()
    settings.threshold, settings.confidence = float(np.clip(threshold, *_BOUNDS)), CONFIDENCE
    settings.maxIterations, settings.randomGeneratorState = iterations, seed
    for option, value in _USAC[name].items():
        setattr(settings, option, getattr(cv2, value) if isinstance(value, str) else value)
    return settings
