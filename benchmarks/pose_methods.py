"""Camera poses by nonsac and by its rivals, in one form: a function of matches, noise, iterations and seed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import nonsac

Array = NDArray[np.float64]
# A transform (4, 4), and whether it claims success; None where the method does not say.
Answer = tuple[Array, bool | None]
# first, second: (n, 2) and (n, 2) or (n, 3) points; cameras: one or two K; noise: pixels, or None for the default.
Method = Callable[[Array, Array, list[Array], float | None, int], Answer]

MOST_ITERATIONS = 100_000
RANDOM_ROWS = 5000


def nonsac_pose(first: Array, second: Array, cameras: list[Array], noise: float | None, seed: int) -> Answer:
    call = nonsac.relative_pose if second.shape[1] == 2 else nonsac.absolute_pose
    result = call(first, second, *cameras, noise=noise, rng=seed)
    return result.T, result.success


def poselib_pose(first: Array, second: Array, cameras: list[Array], noise: float | None, seed: int) -> Answer:
    """At most 100,000 iterations; inliers within five standard deviations, or its own bounds where none are given."""
    import poselib

    options: dict[str, Any] = {"max_iterations": MOST_ITERATIONS, "seed": seed}
    if noise is not None:
        options |= {"max_epipolar_error": 5.0 * noise, "max_reproj_error": 5.0 * noise}
    call = poselib.estimate_relative_pose if second.shape[1] == 2 else poselib.estimate_absolute_pose
    pose, _ = call(first, second, *map(poselib_camera, cameras), options, {})
    return transform(pose.R, pose.t), None


def opencv_pose(first: Array, second: Array, cameras: list[Array], noise: float | None, seed: int) -> Answer:
    """USAC with MAGSAC++ and 100,000 iterations for two views, RANSAC with 10,000 for PnP, as its users run them."""
    import cv2

    if second.shape[1] == 3:
        bound = 4.0 if noise is None else 5.0 * noise
        solved = cv2.solvePnPRansac(
            second, first, cameras[0], None, iterationsCount=10_000, reprojectionError=bound, confidence=0.9999
        )
        return transform(cv2.Rodrigues(solved[1])[0], solved[2].ravel()), bool(solved[0])
    focal = np.mean([camera[0, 0] for camera in cameras])
    a, b = (normalised(points, camera) for points, camera in zip((first, second), cameras, strict=True))
    bound = (1.0 if noise is None else 2.0 * noise) / focal
    usac = {"method": cv2.USAC_MAGSAC, "prob": 0.9999, "threshold": bound, "maxIters": MOST_ITERATIONS}
    essential, mask = cv2.findEssentialMat(a, b, np.eye(3), **usac)
    _, R, t, _ = cv2.recoverPose(essential, a, b, np.eye(3), mask=mask)
    return transform(R, t.ravel()), None


def on_random_rows(method: Method) -> Method:
    """A method on 5,000 random rows: what is done today where there are too many."""

    def sampled(first: Array, second: Array, cameras: list[Array], noise: float | None, seed: int) -> Answer:
        rows = np.random.default_rng(seed).choice(len(first), min(RANDOM_ROWS, len(first)), replace=False)
        return method(first[rows], second[rows], cameras, noise, seed)

    return sampled


# Name in the tables, the module it needs, the function.
METHODS: dict[str, tuple[str, str, Method]] = {
    "nonsac": ("nonsac", "nonsac", nonsac_pose),
    "poselib": ("PoseLib", "poselib", poselib_pose),
    "poselib_sample": ("PoseLib, 5,000 random rows", "poselib", on_random_rows(poselib_pose)),
    "opencv": ("OpenCV", "cv2", opencv_pose),
}


def call(name: str, *arguments: Any) -> Answer:
    """A method by its name, which travels to another process where a closure does not."""
    return METHODS[name][2](*arguments)


def poselib_camera(K: Array) -> dict[str, Any]:
    return {"model": "PINHOLE", "width": 1, "height": 1, "params": [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]}


def normalised(points: Array, K: Array) -> Array:
    return (np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(K).T)[:, :2]


def transform(R: Array, t: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T
