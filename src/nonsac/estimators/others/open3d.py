"""Open3D's RANSAC and fast global registration on given pairs (www.open3d.org, pipelines.registration).

There is one generator of random numbers for all threads, so searches take turns. Its RANSAC starts threads of its own,
which race for these numbers: the same seed may give another model. Its licence is MIT.
"""

from __future__ import annotations

from threading import Lock
from typing import Any

import numpy as np

from nonsac.estimators.others.frame import Pairs
from nonsac.estimators.others.library import CONFIDENCE, Library
from nonsac.layouts import Array
from nonsac.problems.contract import Problem
from nonsac.problems.registration import Registration

_ALIKE = 0.9  # lengths of the edges of a sample; the value of Open3D's examples

_TURN = Lock()


def ransac(problem: Problem) -> Library:
    """RANSAC that first compares the lengths of a sample's edges."""
    return Library(by_ransac)


def fast_global(problem: Problem) -> Library:
    """Fast global registration (Zhou, Park and Koltun, ECCV 2016)."""
    return Library(by_fast_global, needs_scale=True)


def by_ransac(problem: Registration, values: Array, threshold: float, seed: int, iterations: int) -> Array | None:
    import open3d

    registration = open3d.pipelines.registration
    pairs, free = Pairs.of(problem, values, threshold), problem.scale is None
    checkers = [] if free else [registration.CorrespondenceCheckerBasedOnEdgeLength(_ALIKE)]
    with _TURN:
        open3d.utility.random.seed(seed)
        found = registration.registration_ransac_based_on_correspondence(
            *_clouds(pairs),
            max_correspondence_distance=1.0,
            estimation_method=registration.TransformationEstimationPointToPoint(free),
            ransac_n=3,
            checkers=checkers,
            criteria=registration.RANSACConvergenceCriteria(iterations, CONFIDENCE),
        )
    return _model(pairs, found)


def by_fast_global(problem: Registration, values: Array, threshold: float, seed: int, iterations: int) -> Array | None:
    """The scale of the loss falls from the size of the scene to the threshold; there is no number of iterations."""
    import open3d

    registration, pairs = open3d.pipelines.registration, Pairs.of(problem, values, threshold)
    option = registration.FastGlobalRegistrationOption(
        use_absolute_scale=True, decrease_mu=True, maximum_correspondence_distance=1.0
    )
    with _TURN:
        open3d.utility.random.seed(seed)
        found = registration.registration_fgr_based_on_correspondence(*_clouds(pairs), option)
    return _model(pairs, found)


def _clouds(pairs: Pairs) -> tuple[Any, Any, Any]:
    import open3d

    vectors = open3d.utility
    clouds = (open3d.geometry.PointCloud(vectors.Vector3dVector(points)) for points in (pairs.source, pairs.target))
    numbers = np.arange(len(pairs.source), dtype=np.int32)
    return *clouds, vectors.Vector2iVector(np.column_stack([numbers, numbers]))


def _model(pairs: Pairs, found: Any) -> Array | None:
    motion = np.array(found.transformation)
    return None if np.array_equal(motion, np.eye(4)) else pairs.model(motion[:3, :3], motion[:3, 3])
