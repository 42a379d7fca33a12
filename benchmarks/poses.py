"""Camera poses beside PoseLib and OpenCV: speed of the solvers and of RANSAC, real images, a million rows, outliers.

    python benchmarks/poses.py [--sections solvers throughput real large scaling outliers] [--json FILE]

Real images are looked for in the folder that NONSAC_DATA names. Rivals take turns with us on the same inputs in the
same run; each section says in its settings what was run. Sections that are left out keep their results.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from common import RESULTS, Worker, installed, median, say, write
from pose_methods import METHODS, Array, call, poselib_camera

import nonsac
from nonsac import simulate
from nonsac.evaluation import rotation_error
from nonsac.kernels.five_point import five_point_poses
from nonsac.kernels.p3p import p3p_poses
from nonsac.sources import ArraySource

IDENTITY = np.eye(3)
GIVEN_UP = 60.0  # seconds for one call
Row = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--json", type=Path, default=RESULTS / "poses.json")
    arguments = parser.parse_args()
    results = json.loads(arguments.json.read_text())["results"] if arguments.json.is_file() else {}
    for name in arguments.sections:
        results[name] = SECTIONS[name]()
        say(f"{name}: {json.dumps(results[name])[:2000]}")
    write(arguments.json, "poses", results={name: results[name] for name in SECTIONS if name in results})


# --- speed -------------------------------------------------------------


def solvers(samples: int = 20_000, repeats: int = 15) -> list[Row]:
    """Microseconds for each minimal sample of matches that are wrong, as nearly all are in RANSAC."""
    two, three = minimal_samples(samples)
    rows = [
        {"solver": "five-point", "method": "nonsac"} | timed_solver(five_point_poses, two, 10, repeats),
        {"solver": "P3P", "method": "nonsac"} | timed_solver(p3p_poses, three, 4, repeats),
    ]
    if installed("poselib"):
        import poselib

        rays = [unit_rays(two[:3000, :, :2]), unit_rays(two[:3000, :, 2:])]
        rows.append({"solver": "five-point", "method": "poselib"} | timed_calls(poselib.relpose_5pt, rays, repeats))
        rays = [unit_rays(three[:3000, :, :2]), np.ascontiguousarray(three[:3000, :, 2:])]
        rows.append({"solver": "P3P", "method": "poselib"} | timed_calls(poselib.p3p, rays, repeats))
    return rows


def minimal_samples(count: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(0)
    return rng.uniform(-1, 1, (count, 5, 4)), rng.uniform(-1, 1, (count, 3, 5)) + np.array([0, 0, 0, 0, 4])


def unit_rays(points: Array) -> Array:
    rays = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def timed_solver(kernel: Callable[..., int], samples: Array, most: int, repeats: int) -> Row:
    models = np.empty((most * len(samples), 3, 4))
    count = kernel(samples, models)
    seconds = times(lambda: kernel(samples, models), repeats)
    return {"microseconds": 1e6 * median(seconds) / len(samples), "solutions": count / len(samples)}


def timed_calls(function: Callable[..., Any], rays: list[Array], repeats: int) -> Row:
    """The rival's solver, one call from Python for each sample, as its module offers it."""
    arguments = list(zip(*rays, strict=True))
    count = sum(len(function(*pair)) for pair in arguments)
    seconds = times(lambda: [function(*pair) for pair in arguments], max(3, repeats // 3))
    return {"microseconds": 1e6 * median(seconds) / len(arguments), "solutions": count / len(arguments)}


def throughput(iterations: int = 20_000, repeats: int = 9, rows: int = 1000, outliers: float = 0.85) -> list[Row]:
    """Microseconds for each iteration of RANSAC, refinement included, at equal numbers of iterations on one thread."""
    noise = 0.0025
    results = []
    for problem, (first, second) in scenes(rows, outliers, noise).items():
        runs = {"nonsac": partial(our_ransac, problem, first, second, noise, iterations)}
        if installed("poselib"):
            runs["poselib"] = partial(poselib_ransac, problem, first, second, noise, iterations)
        seconds: dict[str, list[float]] = {name: [] for name in runs}
        for run in runs.values():
            run(0)
        for seed in range(repeats):
            for name, run in runs.items():
                seconds[name] += times(partial(run, seed), 1)
        for name, measured in seconds.items():
            each = 1e6 * median(measured) / iterations
            ratio = median([b / a for a, b in zip(seconds["nonsac"], measured, strict=True)])
            results.append({"problem": problem, "method": name, "microseconds": each, "times_ours": ratio})
    return results


def scenes(rows: int, outliers: float, noise: float) -> dict[str, tuple[Array, Array]]:
    two = simulate.relative_pose(rows, outliers, noise, 0)
    three = simulate.absolute_pose(rows, outliers, noise, 0)
    return {"relative pose": (two.points1, two.points2), "absolute pose": (three.points2d, three.points3d)}


def our_ransac(problem: str, first: Array, second: Array, noise: float, iterations: int, seed: int) -> None:
    kind = nonsac.RelativePose() if problem == "relative pose" else nonsac.AbsolutePose()
    ransac = nonsac.Ransac(iterations, local_optimisation=True)
    rows = nonsac.Rows(np.hstack([first, second]))
    ransac.estimate(kind, rows, nonsac.Noise.given(noise), np.random.default_rng(seed))


def poselib_ransac(problem: str, first: Array, second: Array, noise: float, iterations: int, seed: int) -> None:
    import poselib

    options = {"max_iterations": iterations, "min_iterations": iterations, "seed": seed}
    options |= {"max_epipolar_error": 5.0 * noise, "max_reproj_error": 5.0 * noise}
    camera = poselib_camera(IDENTITY)
    if problem == "relative pose":
        poselib.estimate_relative_pose(first, second, camera, camera, options, {})
    else:
        poselib.estimate_absolute_pose(first, second, camera, options, {})


def scaling(samples: int = 30, rows: int = 1000, repeats: int = 7) -> list[Row]:
    """Seconds of m = 30 samples on one thread and on two, and their ratio in pairs of runs."""
    results = []
    for name, (first, second) in scenes(samples * rows, 0.85, 0.0025).items():
        problem = nonsac.RelativePose() if name == "relative pose" else nonsac.AbsolutePose()
        run = partial(
            nonsac.estimate,
            ArraySource(np.hstack([first, second])),
            problem,
            nonsac.Ransac(20_000, local_optimisation=True),
            noise=0.0025,
            samples=samples,
            sample_size=rows,
        )
        run(workers=2)
        one, two = [], []
        for _ in range(repeats):
            one += times(partial(run, workers=1), 1)
            two += times(partial(run, workers=2), 1)
        ratio = median([a / b for a, b in zip(one, two, strict=True)])
        results.append({"problem": name, "one": median(one), "two": median(two), "speedup": ratio})
    return results


def times(function: Callable[[], object], repeats: int) -> list[float]:
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - start)
    return seconds


# --- accuracy ----------------------------------------------------------


def real(seeds: int = 5) -> list[Row]:
    """Rotation error in degrees (median of the seeds) and milliseconds on real images, default bounds throughout."""
    folder = Path(os.environ.get("NONSAC_DATA", Path(__file__).parents[2] / "shared" / "data"))
    names = [name for name in ("nonsac", "poselib", "opencv") if installed(METHODS[name][1])]
    results = []
    for path in [*sorted((folder / "strecha").glob("*.npz")), folder / "kitti_stereo_sift" / "pair.npz"]:
        first, second, cameras, R = read_real(dict(np.load(path)))
        for name in names:
            call(name, first, second, cameras, None, 0)
        outcomes: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
        for seed in range(seeds):
            for name in names:
                start = time.perf_counter()
                T, _ = call(name, first, second, cameras, None, seed)
                outcomes[name].append((float(rotation_error(T[:3, :3], R)), 1e3 * (time.perf_counter() - start)))
        label = "kitti pair" if path.stem == "pair" else path.stem
        for name, values in outcomes.items():
            degrees, milliseconds = (median(list(column)) for column in zip(*values, strict=True))
            results.append({"pair": label, "method": name, "degrees": degrees, "milliseconds": milliseconds})
    return results


def read_real(d: dict[str, Array]) -> tuple[Array, Array, list[Array], Array]:
    if "x1" in d:
        return d["x1"], d["x2"], [d["K1"], d["K2"]], d["R"]
    return d["x"], d["X"], [d["K"]], d["R"]


def large(rows: int = 1_000_000, seeds: int = 100, outliers: float = 0.85, noise: float = 0.005) -> list[Row]:
    """A million rows, most wrong: seconds, memory above the data, and how often the error is at most 0.2 degrees."""
    limits = {"nonsac": seeds, "poselib_sample": seeds, "poselib": 3}
    workers = {name: Worker(partial(warm_up, name), GIVEN_UP) for name in limits if installed(METHODS[name][1])}
    calls: dict[str, list[Any]] = {name: [] for name in workers}
    for seed in range(seeds):
        data = simulate.relative_pose(rows, outliers, noise, seed)
        for name, worker in workers.items():
            if seed < limits[name]:
                outcome = worker.call(call, name, data.points1, data.points2, [IDENTITY] * 2, noise, seed)
                if outcome is None:
                    limits[name] = 0
                    continue
                error = float(rotation_error(outcome.value[0][:3, :3], data.T[:3, :3]))
                calls[name].append((error, outcome.seconds, outcome.megabytes, outcome.value[1]))
    for worker in workers.values():
        worker.close()
    rows_of = {name: large_summary(outcomes) if outcomes else {"trials": 0} for name, outcomes in calls.items()}
    return [{"method": name, "given_up_after": GIVEN_UP * (limits[name] == 0)} | rows_of[name] for name in calls]


def warm_up(name: str) -> None:
    data = simulate.relative_pose(30_000, 0.85, 0.005, 0)
    call(name, data.points1, data.points2, [IDENTITY] * 2, 0.005, 0)


def large_summary(outcomes: list[tuple[float, float, float, bool | None]]) -> Row:
    errors, seconds, megabytes, claims = zip(*outcomes, strict=True)
    return {
        "trials": len(errors),
        "within_0.2_deg": sum(error <= 0.2 for error in errors),
        "median_degrees": median(list(errors)),
        "worst_degrees": max(errors),
        "median_seconds": median(list(seconds)),
        "slowest_seconds": max(seconds),
        "peak_megabytes": max(megabytes),
        "false_claims": sum(bool(c) and e > 3.0 for c, e in zip(claims, errors, strict=True)),
    }


def outliers(seeds: int = 100, rows: int = 1000) -> list[Row]:
    """How often each status comes out where no row is right."""
    results = []
    for problem in ("relative pose", "absolute pose", "registration"):
        statuses: Counter[str] = Counter()
        for seed in range(seeds):
            rng = np.random.default_rng([seed, 7])
            image, world = rng.uniform(-1, 1, (2, rows, 2)), rng.uniform(-1, 1, (2, rows, 3))
            if problem == "relative pose":
                result = nonsac.relative_pose(*image, noise=0.0025, rng=seed)
            elif problem == "absolute pose":
                result = nonsac.absolute_pose(image[0], world[0], noise=0.0025, rng=seed)
            else:
                result = nonsac.register_pairs(*world, noise=0.01, rng=seed)
            statuses[str(result.status)] += 1
        results.append({"problem": problem, "trials": seeds} | dict(statuses))
    return results


SECTIONS: dict[str, Callable[[], list[Row]]] = {
    "solvers": solvers,
    "throughput": throughput,
    "scaling": scaling,
    "real": real,
    "large": large,
    "outliers": outliers,
}


if __name__ == "__main__":
    main()
