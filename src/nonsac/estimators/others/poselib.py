"""PoseLib's LO-RANSAC for two views and for one (Larsson, "PoseLib: minimal solvers for camera pose estimation", 2020).

Its licence is BSD-3-Clause.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nonsac.estimators.others.frame import Frame
from nonsac.estimators.others.library import CONFIDENCE, Library, normalised
from nonsac.layouts import Array
from nonsac.problems.absolute_pose import AbsolutePose
from nonsac.problems.contract import Problem
from nonsac.problems.relative_pose import RelativePose

_CAMERA = {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [1.0, 0.0, 0.0]}


def default(problem: Problem) -> Library:
    return Library(two_views if isinstance(problem, RelativePose) else one_view)


def two_views(problem: RelativePose, values: Array, threshold: float, seed: int, iterations: int) -> Array | None:
    import poselib

    options = _options(seed, iterations) | {"max_epipolar_error": normalised(problem, threshold)}
    pose, told = poselib.estimate_relative_pose(values[:, :2], values[:, 2:], _CAMERA, _CAMERA, options, {})
    return np.array(pose.Rt) if told["num_inliers"] else None


def one_view(problem: AbsolutePose, values: Array, threshold: float, seed: int, iterations: int) -> Array | None:
    import poselib

    world = Frame.of(values[:, 2:])
    options = _options(seed, iterations) | {"max_reproj_error": normalised(problem, threshold)}
    pose, told = poselib.estimate_absolute_pose(values[:, :2], world.inside(values[:, 2:]), _CAMERA, options, {})
    return world.outside(pose.R, pose.t) if told["num_inliers"] else None


def _options(seed: int, iterations: int) -> dict[str, Any]:
    return {"seed": seed, "max_iterations": iterations, "success_prob": CONFIDENCE}
