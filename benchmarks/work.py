"""How much work an answer takes: samples as needed against given numbers of them, and PoseLib on one sample.

    python benchmarks/work.py [--seeds 200] [--json FILE]

Data as in the paper (`nonsac.simulate`), easy and hard. All methods see the same data, one after the other, in one
process that has been warmed up; times are medians with all cores.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pose_methods
from common import RESULTS, installed, say, write
from numpy.typing import NDArray

import nonsac
from nonsac.evaluation import mean_average_accuracy, rotation_error
from nonsac.reproduce.experiments import EXPERIMENTS

Array = NDArray[np.float64]

SAMPLE = 1000  # rows that PoseLib sees
METHODS: dict[str, tuple[str, dict[str, Any]]] = {
    "auto": ("as needed", {}),
    "unknown": ("as needed, noise unknown", {"noise": None}),
    "auto_size": ("as needed, 1,000 rows each", {"sample_size": 1000}),
    "m10": ("10 samples", {"samples": 10}),
    "m30": ("30 samples", {"samples": 30}),
    "poselib": ("PoseLib, 1,000 random rows", {}),
}


@dataclass(frozen=True)
class Case:
    """What is drawn."""

    problem: str
    rows: int
    outlier_ratio: float
    noise: float

    def data(self, seed: int) -> tuple[Array, Array, Array]:
        """Both halves of the rows, and the true transform."""
        experiment = EXPERIMENTS[self.problem]
        rows, truth = experiment.simulate(self.rows, self.outlier_ratio, self.noise, np.random.default_rng([seed, 17]))
        first, second = experiment.problem.layout.parts(rows)
        return first, second, truth


CASES = (
    Case("relative-pose", 10_000, 0.5, 0.0025),
    Case("relative-pose", 10_000, 0.9, 0.0025),
    Case("absolute-pose", 10_000, 0.5, 0.01),
    Case("absolute-pose", 10_000, 0.97, 0.01),
    Case("registration", 20_000, 0.9, 0.01),
    Case("registration", 20_000, 0.995, 0.01),
)
CALLS: dict[str, Callable[..., nonsac.Result]] = {
    "relative-pose": nonsac.relative_pose,
    "absolute-pose": nonsac.absolute_pose,
    "registration": nonsac.register_pairs,
}


def estimated(method: str, case: Case, first: Array, second: Array, seed: int) -> tuple[Array, bool | None, int]:
    """A transform, whether it is trusted, and the samples it took."""
    if method != "poselib":
        settings = {"noise": case.noise} | METHODS[method][1]
        result = CALLS[case.problem](first, second, rng=seed, **settings)
        return result.T, result.success, result.info["samples"]
    rows = np.random.default_rng(seed).choice(len(first), SAMPLE, replace=False)
    cameras = [np.eye(3)] * (2 if case.problem == "relative-pose" else 1)
    return *pose_methods.poselib_pose(first[rows], second[rows], cameras, case.noise, seed), 1


def measured(case: Case, seeds: int) -> list[dict[str, Any]]:
    """One entry for each method."""
    methods = [m for m in METHODS if m != "poselib" or (installed("poselib") and case.problem != "registration")]
    outcomes: dict[str, list[tuple[float, float, bool | None, int]]] = {method: [] for method in methods}
    for seed in range(-1, seeds):  # the first is the warm-up
        first, second, truth = case.data(seed + 1)
        for method in methods:
            start = perf_counter()
            T, trusted, samples = estimated(method, case, first, second, seed + 1)
            elapsed = perf_counter() - start
            if seed >= 0:
                outcomes[method].append((float(rotation_error(T[:3, :3], truth[:3, :3])), elapsed, trusted, samples))
    return [summary(case, method, outcomes[method]) for method in methods]


def summary(case: Case, method: str, outcomes: list[tuple[float, float, bool | None, int]]) -> dict[str, Any]:
    errors, seconds, trusted, samples = (np.array(column) for column in zip(*outcomes, strict=True))
    wrong = ~(errors < 10.0)
    line = {
        "problem": case.problem,
        "rows": case.rows,
        "outlier_ratio": case.outlier_ratio,
        "noise": case.noise,
        "method": method,
        "trials": len(outcomes),
        "mean_average_accuracy": round(float(mean_average_accuracy(errors)), 4),
        "median_degrees": round(float(np.nanmedian(errors)), 5),
        "median_milliseconds": round(1000 * float(np.median(seconds)), 2),
        "mean_milliseconds": round(1000 * float(np.mean(seconds)), 2),
        "mean_samples": round(float(np.mean(samples)), 2),
        "false_claims": None if trusted[0] is None else int((wrong & trusted.astype(bool)).sum()),
        "silent": None if trusted[0] is None else int((~wrong & ~trusted.astype(bool)).sum()),
    }
    say(f"{line}")
    return line


def main() -> None:
    """Measure and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--json", type=Path, default=RESULTS / "work.json")
    options = parser.parse_args()
    results = [line for case in CASES for line in measured(case, options.seeds)]
    write(options.json, "work", results=results)


if __name__ == "__main__":
    main()
