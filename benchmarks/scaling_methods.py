"""What `scaling.py` measures: nonsac reads a few rows of a file, its rivals read all of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pose_methods
from common import installed
from numpy.typing import NDArray
from pairs import kiss_solve

import nonsac
from nonsac.problems.contract import Problem

Array = NDArray[np.float64]

CALLS = {
    "relative-pose": nonsac.relative_pose,
    "absolute-pose": nonsac.absolute_pose,
    "registration": nonsac.register_pairs,
}
PROBLEMS: dict[str, Problem] = {
    "relative-pose": nonsac.RelativePose(),
    "absolute-pose": nonsac.AbsolutePose(),
    "registration": nonsac.Registration(),
}
SAMPLE = 2000
# Name in the tables, the module it needs.
METHODS = {
    "union": ("nonsac, sampled rows", "nonsac"),
    "polish": ("nonsac, last fit to 100,000 rows", "nonsac"),
    "full": ("nonsac, last fit to all rows", "nonsac"),
    "blocks": ("nonsac, blocks drawn, last fit to 100,000 rows", "nonsac"),
    "poselib": ("PoseLib, all rows", "poselib"),
    "poselib_refit": ("PoseLib, 2,000 rows, refined on all", "poselib"),
    "opencv": ("OpenCV, all rows", "cv2"),
    "kiss": ("KISS-Matcher `solve`, all rows", "kiss_matcher"),
}


def named(problem: str, suffix: str) -> Sequence[str]:
    """The methods for a problem and a kind of file."""
    ours = ("union", "polish", "full", *(("blocks",) if suffix == "parquet" else ()))
    rivals = ("kiss",) if problem == "registration" else ("poselib", "poselib_refit", "opencv")
    return [*ours, *(rivals if suffix == "npy" else ())] if all(map(available, rivals)) else ours


def available(method: str) -> bool:
    return installed(METHODS[method][1])


def call(method: str, problem: str, path: str, noise: float, seed: int) -> tuple[Array, str | None]:
    """A transform and the status, where the method has one."""
    if method == "all_pairs":
        result = of_all_pairs(problem, Path(path), noise, seed)
        return result.T, str(result.status)
    if method in ("union", "polish", "full", "blocks"):
        source = nonsac.open_source(path)
        chosen = {"draw": "blocks"} if method == "blocks" else {"refine": method}
        result = CALLS[problem](source, noise=noise, rng=seed, **chosen)
        return result.T, str(result.status)
    rows = np.load(path).astype(np.float64)
    first, second = PROBLEMS[problem].layout.parts(rows)
    return rival(method, first, second, noise, seed), None


def rival(method: str, first: Array, second: Array, noise: float, seed: int) -> Array:
    if method == "kiss":
        return kiss_solve(first, second, noise, seed)[0]
    cameras = [np.eye(3)] * (2 if second.shape[1] == 2 else 1)
    if method == "poselib_refit":
        return poselib_refit(first, second, cameras, noise, seed)
    solver = pose_methods.poselib_pose if method == "poselib" else pose_methods.opencv_pose
    return solver(first, second, cameras, noise, seed)[0]


def poselib_refit(first: Array, second: Array, cameras: list[Array], noise: float, seed: int) -> Array:
    """PoseLib as it is used where there are too many rows: on 2,000 random ones, then refined on all.

    Truncated at two standard deviations, which of the losses and bounds that it has gave the least errors.
    """
    import poselib

    rows = np.random.default_rng(seed).choice(len(first), min(SAMPLE, len(first)), replace=False)
    T, _ = pose_methods.poselib_pose(first[rows], second[rows], cameras, noise, seed)
    start = poselib.CameraPose()
    start.R, start.t = T[:3, :3], T[:3, 3]
    refine = poselib.refine_relative_pose if second.shape[1] == 2 else poselib.refine_absolute_pose
    loss = {"loss_type": "TRUNCATED", "loss_scale": 2.0 * noise}
    pose, _ = refine(first, second, start, *map(pose_methods.poselib_camera, cameras), loss)
    return pose_methods.transform(pose.R, pose.t)


# --- all pairs -------------------------------------------------------------------------------------------------------


def write_clouds(folder: Path, problem: str, points: int) -> Array:
    """Two clouds of points that are to be paired, all with all, and the true transform.

    For registration two samples of one surface, of which 1.3 % of all pairs are near matches, as in the paper's
    Sec. 4.4. For poses two views: one match for each point, hopelessly few, and nothing but the work is measured.
    """
    rng = np.random.default_rng(0)
    if problem == "registration":
        surface = nonsac.simulate.demo_scans(rng, points=50_000, noise=0.0).target
        surface = (surface - surface.min(axis=0)) / np.ptp(surface, axis=0).max()
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = nonsac.simulate.random_rotation(rng), rng.uniform(-1.0, 1.0, 3)
        first, second = (surface[rng.integers(len(surface), size=points)] for _ in range(2))
        second = second @ T[:3, :3].T + T[:3, 3] + 0.01 * rng.standard_normal((points, 3))
    else:
        data = getattr(nonsac.simulate, problem.replace("-", "_"))(points, 0.0, 0.0025, rng)
        names = ("points1", "points2") if problem == "relative-pose" else ("points2d", "points3d")
        (first, second), T = (getattr(data, name) for name in names), data.T
    np.save(folder / "first.npy", first)
    np.save(folder / "second.npy", second)
    return T


def of_all_pairs(problem: str, folder: Path, noise: float, seed: int) -> nonsac.Result:
    """Ten samples."""
    clouds = (nonsac.open_source(folder / name) for name in ("first.npy", "second.npy"))
    settings: dict[str, Any] = {"noise": noise, "samples": 10, "rng": seed}
    if problem == "registration":
        estimator: Any = nonsac.Pcr99.for_all_pairs()
        settings |= {"sample_size": 5000, "rule": "tlp_1"}
    else:
        estimator = nonsac.Ransac(5000)
    return nonsac.estimate(nonsac.AllPairsSource(*clouds), PROBLEMS[problem], estimator, **settings)
