"""Throughput of the two kernels that matter most, and of the search for motions, on one thread.

python benchmarks/kernels.py [--repeats 20] [--json FILE]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from common import RESULTS, median, write

from nonsac.clouds.frame import CommonFrame
from nonsac.clouds.overlap import Overlap
from nonsac.clouds.problem import OrientedRegistration
from nonsac.clouds.refine import coarse_overlap
from nonsac.clouds.search import OrientedPairs
from nonsac.clouds.surfaces import Surface
from nonsac.kernels.consistency import count_consistent_distances
from nonsac.kernels.nearest_field import score_models
from nonsac.layouts import Rows
from nonsac.problems import Noise
from nonsac.result import Hypothesis
from nonsac.simulate import demo_scans, random_rotation, registration
from nonsac.sources import AllPairsSource

ROWS = 2000
MODELS = 20_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--json", type=Path, default=RESULTS / "kernels.json")
    arguments = parser.parse_args()
    overlap = elephant()
    results = {
        "consistency_ns_per_pair": consistency(arguments.repeats),
        "score_models_ns_per_lookup": lookups(overlap, arguments.repeats),
        "motions_per_second": motions(overlap, arguments.repeats),
    }
    settings = {"repeats": arguments.repeats, "rows": ROWS, "models": MODELS, "points": len(overlap.source.coarse)}
    write(arguments.json, "kernels", settings=settings, results=results)


def elephant() -> Overlap:
    pair = demo_scans(0)
    frame = CommonFrame.of(pair.source, pair.target)
    source = Surface.from_points((pair.source - frame.source_origin) / frame.unit)
    target = Surface.from_points((pair.target - frame.target_origin) / frame.unit)
    return coarse_overlap(source, target)


def consistency(repeats: int) -> float:
    """Nanoseconds for each pair of rows that is tested for equal distances."""
    pairs = registration(ROWS, 0.99, 0.01, 0)
    columns = np.ascontiguousarray(np.hstack([pairs.source, pairs.target]).T, np.float32)
    counts = np.empty(ROWS, np.int32)
    seconds = timed(lambda: count_consistent_distances(columns, np.float32(0.05), counts), repeats)
    return 1e9 * seconds / (ROWS * (ROWS - 1) / 2)


def lookups(overlap: Overlap, repeats: int) -> float:
    """Nanoseconds for each point that is moved and looked up in the grid of nearest points."""
    rng = np.random.default_rng(0)
    models = np.zeros((MODELS, 3, 4))
    models[:, :, :3] = [random_rotation(rng) for _ in range(MODELS)]
    models[:, :, 3] = 0.1 * rng.standard_normal((MODELS, 3))
    points = np.ascontiguousarray(overlap.source.points[overlap.source.coarse].T, np.float32)
    field = overlap.target_field
    scores = np.empty(MODELS, np.int32)
    arguments = (models, points, field.corner, field.cells_per_unit, field.cost, scores)
    return 1e9 * timed(lambda: score_models(*arguments), repeats) / (MODELS * points.shape[1])


def motions(overlap: Overlap, repeats: int) -> float:
    """Motions per second that one sample of `OrientedPairs` makes, scores and ranks, aligning the best included."""
    source = AllPairsSource(overlap.source.oriented, overlap.target.oriented)
    rows = Rows(source.take(np.random.default_rng(0).choice(len(source), ROWS, replace=False)))
    estimator, problem = OrientedPairs.for_overlap(overlap), OrientedRegistration()

    def hypothesis() -> Hypothesis:
        return estimator.estimate(problem, rows, Noise.within(overlap.reach), np.random.default_rng(0))

    tested = hypothesis().tested or 0
    return tested / timed(hypothesis, repeats)


def timed(function: Callable[[], object], repeats: int) -> float:
    """Median seconds of a call, after one that is not timed."""
    function()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - start)
    return median(seconds) or 0.0


if __name__ == "__main__":
    main()
