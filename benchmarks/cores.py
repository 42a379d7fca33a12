"""The general cores by name on one sample of 1,000 rows, beside their authors' code where a wheel of it is installed.

    python benchmarks/cores.py [--trials 20] [--iterations 1000] [--json FILE]

Writes the JSON and the tables of docs/cores.md. All search for the same number of iterations and do not stop early,
but for OpenCV, which cannot be told not to, and for GNC, IRLS and Hough, whose work is their own. Weights, for what
needs them, are drawn from beta distributions: (4, 2) for right rows and (2, 4) for wrong ones. pygcransac and pymagsac
are measured if they can be imported.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from common import RESULTS, installed, renewed, say, write

from nonsac import AbsolutePose, Noise, Registration, RelativePose, Rows, simulate
from nonsac.estimators.named import ESTIMATORS
from nonsac.estimators.scores import Truncated
from nonsac.estimators.usac import Usac
from nonsac.evaluation import mean_average_accuracy, rotation_error

PAGE, BEGIN, END = Path(__file__).parents[1] / "docs" / "cores.md", "<!-- cores -->", "<!-- end -->"
ROWS = 1000
OWN = ("ransac", "msac", "lo-ransac", "prosac", "magsac", "gc-ransac", "gnc-tls", "gnc-gm", "irls", "hough")
FOCAL = 1000.0  # pixels, for what wants some

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Task:
    """What a method is given: rows, a seed, and how long it may search."""

    rows: Array
    weights: Array
    noise: Noise
    iterations: int
    seed: int


@dataclass(frozen=True)
class Kind:
    """A problem, its data, and where it is measured."""

    problem: Any
    make: Callable[..., tuple[Array, Array]]
    sigma: float
    outliers: tuple[float, ...]

    def task(self, outliers: float, seed: int, iterations: int) -> tuple[Task, Array]:
        rng = np.random.default_rng(seed)
        rows, truth = self.make(ROWS, outliers, self.sigma, rng)
        right = self.problem.residuals(truth[None], rows)[0] < 5.0 * self.sigma
        weights = np.where(right, rng.beta(4, 2, ROWS), rng.beta(2, 4, ROWS))
        return Task(rows, weights, Noise.given(self.sigma), iterations, seed), truth


def two_views(*arguments: Any) -> tuple[Array, Array]:
    matches = simulate.relative_pose(*arguments)
    return np.hstack([matches.points1, matches.points2]), matches.T[:3]


def one_view(*arguments: Any) -> tuple[Array, Array]:
    matches = simulate.absolute_pose(*arguments)
    return np.hstack([matches.points2d, matches.points3d]), matches.T[:3]


def two_clouds(*arguments: Any) -> tuple[Array, Array]:
    pairs = simulate.registration(*arguments)
    return np.hstack([pairs.source, pairs.target]), pairs.T[:3]


KINDS = {
    "relative pose": Kind(RelativePose(), two_views, 0.002, (0.5, 0.6, 0.7, 0.8)),
    "absolute pose": Kind(AbsolutePose(), one_view, 0.005, (0.5, 0.7, 0.9)),
    "registration": Kind(Registration(), two_clouds, 0.01, (0.5, 0.7, 0.8, 0.9, 0.95, 0.97)),
}


def own(name: str, kind: Kind, task: Task) -> Array:
    """The model of one of ours; only what needs weights gets them."""
    estimator = ESTIMATORS[name].made_for(kind.problem)
    if isinstance(estimator, Usac) or name == "ransac":
        estimator = replace(estimator, iterations=task.iterations, confidence=None)
    rows = Rows(task.rows, task.weights if name == "prosac" else None)
    return estimator.estimate(kind.problem, rows, task.noise, np.random.default_rng(task.seed)).model


def by_opencv(method: str) -> Callable[[Task], Any]:
    def essential(task: Task) -> Any:
        import cv2

        rows = task.rows[np.argsort(-task.weights)] if method == "USAC_PROSAC" else task.rows
        first, second = (np.ascontiguousarray(half) for half in np.hsplit(rows, 2))
        return cv2.findEssentialMat(
            first, second, np.eye(3), getattr(cv2, method), 0.9999999, task.noise.threshold, task.iterations
        )[0]

    return essential


def in_pixels(rows: Array) -> tuple[Array, Array, int]:
    """Rows in pixels, all of them in the image; its K, and its size."""
    corner = FOCAL * np.abs(rows).max() + 1.0
    K = np.array([[FOCAL, 0.0, corner], [0.0, FOCAL, corner], [0.0, 0.0, 1.0]])
    return np.ascontiguousarray(FOCAL * rows + corner), K, int(2.0 * corner) + 2


def by_magsac(task: Task) -> Any:
    """The largest noise is the one whose 99 % quantile is the threshold."""
    import pymagsac

    pixels, K, size = in_pixels(task.rows)
    settings = {"sampler": 0, "use_magsac_plus_plus": True, "sigma_th": FOCAL * task.noise.threshold / 3.64}
    limits = {"conf": 0.9999999, "min_iters": task.iterations, "max_iters": task.iterations}
    return pymagsac.findEssentialMatrix(pixels, K, K, *[size] * 4, np.zeros(0), **settings, **limits)[0]


def by_gcransac(task: Task) -> Any:
    """Neighbours within 200 of some 2,000 pixels: within its own 20 a thousand random points have none."""
    import pygcransac

    pixels, K, size = in_pixels(task.rows)
    settings = {"threshold": FOCAL * task.noise.threshold, "spatial_coherence_weight": 0.14, "use_sprt": False}
    limits = {"conf": 0.9999999, "min_iters": task.iterations, "max_iters": task.iterations}
    graph = {"sampler": 0, "neighborhood": 1, "neighborhood_size": 200.0}
    return pygcransac.findEssentialMatrix(pixels, K, K, *[size] * 4, np.zeros(0), **settings, **limits, **graph)[0]


def pose_of(kind: Kind, essential: Any, task: Task) -> Array:
    """The pose, of the four that an essential matrix stands for, that has most of the rows in front of the cameras."""
    import cv2

    if essential is None or np.shape(essential) != (3, 3) or not np.isfinite(essential).all():
        return kind.problem.no_model
    first, second, t = cv2.decomposeEssentialMat(np.asarray(essential, np.float64))
    poses = np.stack([np.column_stack([R, sign * t]) for R in (first, second) for sign in (1.0, -1.0)])
    return poses[np.argmax(Truncated().of(kind.problem, poses, Rows(task.rows), task.noise.threshold))]


def by_poselib(task: Task) -> Array:
    import poselib

    camera = {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [1.0, 0.0, 0.0]}
    limits = {"max_iterations": task.iterations, "min_iterations": task.iterations, "seed": task.seed}
    options = {"max_epipolar_error": task.noise.threshold, **limits}
    pose = poselib.estimate_relative_pose(*np.hsplit(task.rows, 2), camera, camera, options, {})[0]
    return np.column_stack([pose.R, pose.t])


# Whose code it is, the module it needs, and which of ours it is held against; they give essential matrices.
PEERS: dict[str, tuple[str, str, Callable[[Task], Any]]] = {
    "OpenCV RANSAC": ("cv2", "msac", by_opencv("RANSAC")),
    "PoseLib": ("poselib", "lo-ransac", by_poselib),
    "OpenCV USAC_DEFAULT": ("cv2", "lo-ransac", by_opencv("USAC_DEFAULT")),
    "OpenCV USAC_PROSAC": ("cv2", "prosac", by_opencv("USAC_PROSAC")),
    "OpenCV USAC_MAGSAC": ("cv2", "magsac", by_opencv("USAC_MAGSAC")),
    "pymagsac": ("pymagsac", "magsac", by_magsac),
    "OpenCV USAC_ACCURATE": ("cv2", "gc-ransac", by_opencv("USAC_ACCURATE")),
    "pygcransac": ("pygcransac", "gc-ransac", by_gcransac),
}


def peer(name: str, kind: Kind, task: Task) -> Array:
    found = PEERS[name][2](task)
    return found if np.shape(found) == (3, 4) else pose_of(kind, found, task)


def measured(
    name: str, kind: Kind, outliers: float, trials: int, iterations: int, solve: Callable[..., Array]
) -> dict[str, Any]:
    errors, cpu = [], 0.0
    for seed in range(trials):
        task, truth = kind.task(outliers, seed, iterations)
        start = time.process_time()
        model = solve(name, kind, task)
        cpu += time.process_time() - start
        errors.append(float(rotation_error(model[:, :3], truth[:, :3])))
    solved = float(np.mean(np.array(errors) < 5.0))
    return {
        "method": name,
        "outliers": outliers,
        "maa": round(mean_average_accuracy(errors), 4),
        "median_error": round(float(np.median(np.nan_to_num(errors, nan=180.0))), 4),
        "solved": solved,
        "cpu_ms": round(1000.0 * cpu / trials, 2),
    }


def results(trials: int, iterations: int) -> Iterator[dict[str, Any]]:
    for title, kind in KINDS.items():
        peers = [name for name, (module, *_) in PEERS.items() if title == "relative pose" and installed(module)]
        for name in (*(name for name in OWN if ESTIMATORS[name].fits(kind.problem)), *peers):
            solve = own if name in OWN else peer
            measured(name, kind, kind.outliers[0], 1, iterations, solve)  # compiles
            for outliers in kind.outliers:
                yield {"problem": title, **measured(name, kind, outliers, trials, iterations, solve)}
            say(f"{title}: {name}")


def table(found: Sequence[dict[str, Any]], title: str) -> str:
    """The mean average accuracy by method and share of outliers, and the CPU time of one call."""
    rows = [row for row in found if row["problem"] == title]
    shares = sorted({row["outliers"] for row in rows})
    lines = [f"| {title} | {' | '.join(f'{100 * share:g} %' for share in shares)} | mean | CPU ms |"]
    lines.append("| --- |" + " ---: |" * (len(shares) + 2))
    for name in dict.fromkeys(row["method"] for row in rows):
        of_name = [row for row in rows if row["method"] == name]
        values = [row["maa"] for row in sorted(of_name, key=lambda row: row["outliers"])]
        cpu = np.mean([row["cpu_ms"] for row in of_name])
        words = " | ".join(f"{value:.3f}" for value in (*values, np.mean(values)))
        lines.append(f"| {f'`{name}`' if name in OWN else name} | {words} | {cpu:.1f} |")
    return "\n".join(lines)


def main() -> None:
    """Measure, and write the JSON and the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--iterations", type=int, default=1000)
    parser.add_argument("--json", type=Path, default=RESULTS / "cores.json")
    options = parser.parse_args()
    found = list(results(options.trials, options.iterations))
    settings = {"trials": options.trials, "iterations": options.iterations, "rows": ROWS}
    write(options.json, "cores", settings=settings, results=found)
    block = "\n\n".join(table(found, title) for title in KINDS)
    print(block)
    if options.json == RESULTS / "cores.json":
        PAGE.write_text(renewed(PAGE.read_text(), BEGIN, END, block))


if __name__ == "__main__":
    main()
