"""COLMAP's LO-RANSAC for two views and for one (Schönberger and Frahm, "Structure-from-motion revisited", CVPR 2016).

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


def default(problem: Problem) -> Library:
    return Library(two_views if isinstance(problem, RelativePose) else one_view)


def two_views(problem: RelativePose, values: Array, threshold: float, seed: int, iterations: int) -> Array | None:
    import pycolmap

    options = _options(normalised(problem, threshold), seed, iterations)
    found = pycolmap.estimate_essential_matrix(values[:, :2], values[:, 2:], _camera(), _camera(), options)
    return None if found is None else np.array(found["cam2_from_cam1"].matrix())


def one_view(problem: AbsolutePose, values: Array, threshold: float, seed: int, iterations: int) -> Array | None:
    """Without a refinement at the end: there is ours, and on a pose of NaN COLMAP's ends the process."""
    import pycolmap

    world, options = Frame.of(values[:, 2:]), pycolmap.AbsolutePoseEstimationOptions()
    options.ransac = _options(normalised(problem, threshold), seed, iterations)
    found = pycolmap.estimate_absolute_pose(values[:, :2], world.inside(values[:, 2:]), _camera(), options)
    return None if found is None else world.outside(*np.hsplit(found["cam_from_world"].matrix(), [3]))


def _camera() -> Any:
    import pycolmap

    return pycolmap.Camera(model="SIMPLE_PINHOLE", width=1, height=1, params=[1.0, 0.0, 0.0])


def _options(threshold: float, seed: int, iterations: int) -> Any:
    import pycolmap

    return pycolmap.RANSACOptions(
        max_error=threshold,
        random_seed=seed,
        confidence=CONFIDENCE,
        min_num_trials=min(iterations, 1000),
        max_num_trials=iterations,
    )
