"""The last fit to all rows: its time and accuracy beside PoseLib's, its speed in rows, and what a cluster gains.

    python benchmarks/full_fit.py [--sizes 1e6 1e7] [--seeds 7] [--json FILE]

*Poses*: relative pose at 85 % outliers, noise 0.0025, rows in memory, all cores, everything warm. `refine="full"`, the
default, and PoseLib on 2,000 random rows (100,000 iterations) refined on all rows take turns on the same data.
*Passes*: one pass over registration rows in memory, on one core. *Cluster*: 60 samples of relative pose at 90 %
outliers by one and by two worker processes of a Dask cluster, in turns, the whole call.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from common import RESULTS, installed, say, write
from numpy.typing import NDArray
from scaling_methods import poselib_refit

import nonsac
from nonsac.evaluation import rotation_error
from nonsac.method.full_pass import FullFit, first_pass
from nonsac.method.refine import Refinement
from nonsac.method.search import SampleTask, Search

Array = NDArray[np.float64]

OUTLIERS, NOISE = 0.85, 0.0025
ROWS, PAIRS_NOISE = 2**22, 0.01
CLUSTER_ROWS, CLUSTER_OUTLIERS, SAMPLES = 1_000_000, 0.9, 60


def main() -> None:
    options = parse()
    results: dict[str, Any] = {
        "poses": [row for size in options.sizes for row in poses(size, options.seeds)],
        "passes": [passes(outliers, options.repeats) for outliers in (0.99, 0.5, 0.0)],
    }
    if installed("distributed"):
        results["cluster"] = cluster(options.repeats)
    settings = {"outlier_ratio": OUTLIERS, "noise": NOISE, "seeds": options.seeds, "repeats": options.repeats}
    write(options.json, "full_fit", settings=settings, results=results)


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", nargs="+", type=lambda text: int(float(text)), default=[10**6, 10**7])
    parser.add_argument("--seeds", type=int, default=7)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--json", type=Path, default=RESULTS / "full_fit.json")
    return parser.parse_args()


# --- poses -----------------------------------------------------------------------------------------------------------


def ours(refine: str, first: Array, second: Array, seed: int) -> Array:
    return nonsac.relative_pose(first, second, noise=NOISE, refine=refine, rng=seed).T


def rival(first: Array, second: Array, seed: int) -> Array:
    return poselib_refit(first, second, [np.eye(3)] * 2, NOISE, seed)


def poses(rows: int, seeds: int) -> list[dict[str, Any]]:
    """Seconds and degrees of each method on the same data."""
    methods: dict[str, Callable[[Array, Array, int], Array]] = {
        "full": partial(ours, "full"),
        "polish": partial(ours, "polish"),
        **({"poselib_refit": rival} if installed("poselib") else {}),
    }
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in methods}
    for seed in range(seeds + 1):
        views = nonsac.simulate.relative_pose(rows, OUTLIERS, NOISE, rng=seed)
        for name, method in methods.items():
            start = time.perf_counter()
            T = method(views.points1, views.points2, seed)
            found[name].append((time.perf_counter() - start, rotation_error(T[:3, :3], views.T[:3, :3])))
    summaries = [
        {"rows": rows, "method": name} | summary(calls[1:]) for name, calls in found.items()
    ]  # the first warms
    for row in summaries:
        say(str(row))
    return summaries


def summary(calls: list[tuple[float, float]]) -> dict[str, Any]:
    seconds, degrees = np.array(calls).T
    return {
        "seconds": float(np.median(seconds)),
        "median_degrees": float(np.median(degrees)),
        "rms_degrees": float(np.sqrt(np.mean(degrees**2))),
        "all_seconds": np.round(seconds, 4).tolist(),
        "all_degrees": np.round(degrees, 6).tolist(),
    }


# --- passes ----------------------------------------------------------------------------------------------------------


def passes(outliers: float, repeats: int) -> dict[str, Any]:
    """Rows per second and core of one pass, and how far its answer is from least squares in memory."""
    pairs = nonsac.simulate.registration(ROWS, outliers, PAIRS_NOISE, rng=0)
    source = nonsac.JoinedSource([pairs.source, pairs.target])
    result = nonsac.register_pairs(pairs.source, pairs.target, noise=PAIRS_NOISE, workers=1)
    search = search_of(source)
    task = first_pass(search, result.model)
    seconds = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        for piece in range(len(task.bounds) - 1):
            task(piece)
        seconds.append(time.perf_counter() - start)
    polished = Refinement(result.model, result.status, result.confidence, result.num_inliers, result.num_rows)
    full = FullFit().finish(search, polished)
    difference = float(np.abs(full.model - least_squares(full.model, source, task.weigher)).max())
    row = {"outlier_ratio": outliers, "rows": ROWS, "rows_per_second": ROWS / float(np.median(seconds[1:]))}
    row |= {"passes": full.info["passes"], "difference_to_least_squares": difference}
    say(str(row))
    return row


def search_of(source: nonsac.Source) -> Search:
    """What passes ask for the rows and the noise; no sample is drawn of it."""
    noise, estimator = nonsac.Noise.given(PAIRS_NOISE), nonsac.Pcr99.for_pairs()
    task = SampleTask(source, nonsac.Registration(), estimator, noise, sample_size=2000, seed=0)
    return Search(task, most=1, workers=1, stop=None, progress=None, deadline=None)


def least_squares(model: Array, source: nonsac.Source, weigher: Any) -> Array:
    """Of all rows at once, in closed form, with weights and model in turn until neither changes."""
    problem = nonsac.Registration()
    rows = source.take(np.arange(len(source)))
    for _ in range(50):
        fitted = problem.refit(model, rows, weigher(problem.residuals(model[None], rows)[0])[0])
        settled, model = np.abs(fitted - model).max() < 1e-13, fitted
        if settled:
            break
    return model


# --- cluster ---------------------------------------------------------------------------------------------------------


def cluster(repeats: int) -> list[dict[str, Any]]:
    """Medians of seconds with one and with two worker processes, and whether the bits are those of one thread."""
    import distributed

    views = nonsac.simulate.relative_pose(CLUSTER_ROWS, CLUSTER_OUTLIERS, NOISE, rng=0)
    with (
        tempfile.TemporaryDirectory() as folder,
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0") as nodes,
        distributed.Client(nodes) as client,
    ):
        path = Path(folder) / "rows.npy"
        np.save(path, np.hstack([views.points1, views.points2]))
        first, _ = client.scheduler_info()["workers"]
        pools = {"one": client.get_executor(pure=False, workers=[first]), "two": client.get_executor(pure=False)}
        return [compared(pools, path, refine, repeats) for refine in ("none", "polish")]


def compared(pools: dict[str, Executor], path: Path, refine: str, repeats: int) -> dict[str, Any]:
    seconds: dict[str, list[float]] = {name: [] for name in pools}
    alone = sixty_samples(path, refine, 1)
    same = True
    for _ in range(repeats + 1):
        for name, pool in pools.items():
            start = time.perf_counter()
            result = sixty_samples(path, refine, pool)
            seconds[name].append(time.perf_counter() - start)
            same &= result.T.tobytes() == alone.T.tobytes()
    one, two = (float(np.median(seconds[name][1:])) for name in ("one", "two"))
    row = {"refine": refine, "seconds_one": one, "seconds_two": two, "ratio": one / two, "same_bits": bool(same)}
    say(str(row))
    return row


def sixty_samples(path: Path, refine: str, workers: Any) -> nonsac.Result:
    source = nonsac.open_source(path)
    return nonsac.relative_pose(source, noise=NOISE, samples=SAMPLES, refine=refine, workers=workers)


if __name__ == "__main__":
    main()
