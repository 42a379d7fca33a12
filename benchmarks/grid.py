"""The whole grid of Table 2: samples as needed against 30 of them, and the error beside that of least squares.

    python benchmarks/grid.py [--trials 10] [--json FILE]

In each cell, data of 300 samples of the paper's size: at most 300 samples as needed, and 30 given ones, in the same
process. And data of 30 such samples, all of which are fitted in the end: the error beside that of least squares on the
true inliers of the same rows, over the answers that are right.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from common import RESULTS, say, write

import nonsac
from nonsac import simulate
from nonsac.evaluation import mean_average_accuracy, rotation_error
from nonsac.layouts import Array
from nonsac.reproduce.experiments import EXPERIMENTS

MOST, FEWER = 300, 30
RIGHT = 10.0  # degrees
CASES: dict[str, tuple[Callable[..., Any], tuple[str, str], Callable[..., nonsac.Result]]] = {
    "relative-pose": (simulate.relative_pose, ("points1", "points2"), nonsac.relative_pose),
    "absolute-pose": (simulate.absolute_pose, ("points2d", "points3d"), nonsac.absolute_pose),
    "registration": (simulate.registration, ("source", "target"), nonsac.register_pairs),
}


def trial(problem: str, outlier_ratio: float, noise: float, seed: int) -> dict[str, Any]:
    """What came of one data set of either size."""
    simulated, halves, call = CASES[problem]
    size = EXPERIMENTS[problem].sample_size
    rng = np.random.default_rng([seed, 23])
    settings = {"noise": noise, "sample_size": size, "rng": seed}
    data = simulated(MOST * size, outlier_ratio, noise, rng)
    points = [getattr(data, half) for half in halves]
    start = perf_counter()
    needed = call(*points, max_samples=MOST, **settings)
    middle = perf_counter()
    given = call(*points, samples=FEWER, **settings)
    end = perf_counter()

    few = simulated(FEWER * size, outlier_ratio, noise, rng)
    rows = np.hstack([getattr(few, half) for half in halves])
    fitted = call(*EXPERIMENTS[problem].problem.layout.parts(rows), max_samples=FEWER, **settings)
    least = EXPERIMENTS[problem].problem.refit(few.T[:3].copy(), rows, few.inliers.astype(float))
    return {
        "needed": error(needed.T, data.T),
        "trusted": needed.success,
        "samples": needed.info["samples"],
        "given": error(given.T, data.T),
        "fitted": error(fitted.T, few.T),
        "least_squares": error(least, few.T),
        "needed_seconds": middle - start,
        "given_seconds": end - middle,
    }


def error(T: Array, truth: Array) -> float:
    """Of the rotation, in degrees."""
    return float(rotation_error(T[:3, :3], truth[:3, :3]))


def summary(problem: str, trials: list[dict[str, Any]]) -> dict[str, Any]:
    """Over all cells of a problem, and the cell with the largest error beside least squares."""
    columns = {name: np.array([t[name] for t in trials]) for name in trials[0]}
    ratios = columns["fitted"] / columns["least_squares"]
    right = columns["fitted"] < RIGHT
    wrong = ~(columns["needed"] < RIGHT)
    return {
        "problem": problem,
        "trials": len(trials),
        "mean_average_accuracy": round(mean_average_accuracy(columns["needed"]), 4),
        "mean_average_accuracy_given": round(mean_average_accuracy(columns["given"]), 4),
        "false_claims": int((wrong & columns["trusted"]).sum()),
        "silent": int((~wrong & ~columns["trusted"]).sum()),
        "mean_samples": round(float(columns["samples"].mean()), 2),
        "mean_milliseconds": round(1000.0 * float(columns["needed_seconds"].mean()), 2),
        "mean_milliseconds_given": round(1000.0 * float(columns["given_seconds"].mean()), 2),
        "median_ratio_to_least_squares": round(float(np.median(ratios[right])), 4),
        "ratio_of_medians_to_least_squares": round(
            float(np.median(columns["fitted"][right]) / np.median(columns["least_squares"][right])), 4
        ),
    }


def measured(problem: str, trials: int) -> dict[str, Any]:
    """All cells."""
    experiment = EXPERIMENTS[problem]
    cells = [(ratio, noise) for ratio in experiment.outlier_ratios for noise in experiment.noises]
    trial(problem, *cells[0], seed=10**6)  # warm-up
    line = summary(problem, [trial(problem, *cell, seed) for cell in cells for seed in range(trials)])
    say(f"{line}")
    return line


def main() -> None:
    """Measure and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--json", type=Path, default=RESULTS / "grid.json")
    options = parser.parse_args()
    write(options.json, "grid", results=[measured(problem, options.trials) for problem in CASES])


if __name__ == "__main__":
    main()
