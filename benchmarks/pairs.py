"""Given pairs, nearly all wrong: accuracy, time and memory of `register_pairs` and of its rivals.

    python benchmarks/pairs.py [--seeds 100] [--rows 20000] [--methods nonsac] [--json FILE]

The data are the paper's (Sec. 4.3, `nonsac.simulate.registration`). All methods see the same inputs, one after the
other, each in a process of its own that has been warmed up. A method that has used up its budget of seconds at one
outlier ratio, or the limit for one call, is stopped there; its number of trials says so.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from common import RESULTS, Call, Worker, installed, median, say, write
from numpy.typing import NDArray

import nonsac
from nonsac.evaluation import mean_average_accuracy, rotation_error
from nonsac.simulate import Pairs, registration

Array = NDArray[np.float64]
# A transform (4, 4), and whether it claims success; None where the method does not say.
Answer = tuple[Array, bool | None]
Method = Callable[[Array, Array, float, int], Answer]

SAMPLE = 2000
RIGHT = 3.0  # degrees


def nonsac_pairs(source: Array, target: Array, noise: float, seed: int) -> Answer:
    result = nonsac.register_pairs(source, target, noise=noise, rng=seed)
    return result.T, result.success


def open3d_ransac(source: Array, target: Array, noise: float, seed: int) -> Answer:
    """100,000 iterations, inliers within five standard deviations, as ours."""
    import open3d

    open3d.utility.random.seed(seed)
    registration = open3d.pipelines.registration
    clouds = (open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points)) for points in (source, target))
    matches = open3d.utility.Vector2iVector(np.repeat(np.arange(len(source), dtype=np.int32)[:, None], 2, axis=1))
    found = registration.registration_ransac_based_on_correspondence(
        *clouds,
        matches,
        5.0 * noise,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [registration.CorrespondenceCheckerBasedOnEdgeLength(0.9)],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    )
    return np.array(found.transformation), None


def kiss_solve(source: Array, target: Array, noise: float, seed: int) -> Answer:
    """KISS-Matcher's outlier pruning and solver, with a noise bound of five standard deviations."""
    import kiss_matcher

    matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(5.0 * noise))
    found = matcher.solve(source.T, target.T)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = found.rotation, np.ravel(found.translation)
    return T, bool(found.valid)


def on_sample(method: Method, source: Array, target: Array, noise: float, seed: int) -> Answer:
    """A method on 2,000 random rows: what is done today where there are too many."""
    rows = np.random.default_rng(seed).permutation(len(source))[:SAMPLE]
    return method(source[rows], target[rows], noise, seed)


# Name in the tables, the module it needs, the function.
METHODS: dict[str, tuple[str, str, Method]] = {
    "nonsac": ("nonsac `register_pairs`", "nonsac", nonsac_pairs),
    "open3d_sample": ("Open3D RANSAC, 2,000 random rows", "open3d", partial(on_sample, open3d_ransac)),
    "open3d": ("Open3D RANSAC, all rows", "open3d", open3d_ransac),
    "kiss_sample": ("KISS-Matcher `solve`, 2,000 random rows", "kiss_matcher", partial(on_sample, kiss_solve)),
    "kiss": ("KISS-Matcher `solve`, all rows", "kiss_matcher", kiss_solve),
}


def main() -> None:
    arguments = parse()
    results = []
    for ratio in arguments.ratios:
        data = partial(registration, arguments.rows, ratio, arguments.noise)
        for name, calls in run(data, arguments).items():
            results.append({"outlier_ratio": ratio, "method": name} | summary(calls, data))
            say(json.dumps(results[-1]))
    kept = ("rows", "noise", "seeds", "limit", "budget")
    settings = {name: getattr(arguments, name) for name in kept} | {"right_degrees": RIGHT}
    write(arguments.json, "pairs", settings=settings, results=results)


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    available = [name for name, (_, module, _) in METHODS.items() if installed(module)]
    parser.add_argument("--rows", type=int, default=20_000)
    parser.add_argument("--ratios", nargs="+", type=float, default=[0.99, 0.995])
    parser.add_argument("--noise", type=float, default=0.01)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--methods", nargs="+", choices=available, default=available)
    parser.add_argument("--limit", type=float, default=60.0, help="seconds after which one call is given up")
    parser.add_argument("--budget", type=float, default=60.0, help="seconds for a method at one outlier ratio")
    parser.add_argument("--json", type=Path, default=RESULTS / "pairs.json")
    return parser.parse_args()


def run(data: Callable[[int], Pairs], arguments: argparse.Namespace) -> dict[str, list[Call | None]]:
    """The calls of each method, which take turns on each seed."""
    workers = {name: Worker(partial(warm_up, name), arguments.limit) for name in arguments.methods}
    calls: dict[str, list[Call | None]] = {name: [] for name in workers}
    for seed in range(arguments.seeds):
        pairs = data(seed)
        for name, worker in workers.items():
            if stopped(calls[name], arguments.budget):
                continue
            calls[name].append(worker.call(METHODS[name][2], pairs.source, pairs.target, arguments.noise, seed))
    for worker in workers.values():
        worker.close()
    return calls


def stopped(calls: list[Call | None], budget: float) -> bool:
    return None in calls or sum(call.seconds for call in calls if call) > budget


def warm_up(name: str) -> None:
    pairs = registration(3000, 0.5, 0.01, 0)
    METHODS[name][2](pairs.source, pairs.target, 0.01, 0)


def summary(calls: list[Call | None], data: Callable[[int], Pairs]) -> dict[str, Any]:
    answers = [call.value if call and call.value else (np.full((4, 4), np.nan), False) for call in calls]
    errors = np.array([rotation_error(T[:3, :3], data(i).T[:3, :3]) for i, (T, _) in enumerate(answers)])
    right = errors <= RIGHT
    claims = [claimed for _, claimed in answers]
    return {
        "trials": len(calls),
        "mean_average_accuracy": mean_average_accuracy(errors),
        "right": int(right.sum()),
        "false_claims": None if None in claims else int(np.sum(np.array(claims) & ~right)),
        "silent": None if None in claims else int(np.sum(right & ~np.array(claims))),
        "given_up": None in calls,
        "median_milliseconds": median([1000.0 * call.seconds for call in calls if call]),
        "peak_megabytes": max((call.megabytes for call in calls if call), default=None),
        "errors": sorted({call.error for call in calls if call and call.error}),
        "degrees": [None if np.isnan(e) else round(float(e), 4) for e in errors],
    }


if __name__ == "__main__":
    main()
