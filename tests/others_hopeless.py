"""A program that gives an estimator of another library what nobody can solve, which might end its process.

python tests/others_hopeless.py poselib
"""

import sys
from dataclasses import replace

import numpy as np

from nonsac import AbsolutePose, Noise, Registration, RelativePose, Rows, simulate
from nonsac.estimators.named import ESTIMATORS, chosen_estimator

FUZZED, ITERATIONS = 150, 2000


def problems():
    views, view = simulate.relative_pose(200, 0.5, 0.001, rng=0), simulate.absolute_pose(200, 0.5, 0.001, rng=0)
    pairs = simulate.registration(200, 0.5, 0.01, rng=0)
    return {
        "RelativePose": (RelativePose(), np.hstack([views.points1, views.points2])),
        "AbsolutePose": (AbsolutePose(), np.hstack([view.points2d, view.points3d])),
        "Registration": (Registration(), np.hstack([pairs.source, pairs.target])),
    }


def hopeless(rows):
    """Rows and thresholds."""
    line = np.linspace(-1, 1, len(rows))[:, None] * rows[0] + rows[1]
    for some in (*(rows[:n] for n in range(3, 9)), 0 * rows, line, rows * 1e200, rows * 1e-200):
        yield some, 0.005
    for different in (1, 2, 3, 5):
        yield np.repeat(rows[:different], 40, axis=0), 0.005
    yield np.vstack([rows, rows[:3] * 1e150]), 0.005
    nearly_zero = np.where(np.arange(len(rows))[:, None] % 3, rows, 1e-44 * rows)
    yield nearly_zero[:18], 1e-8
    for threshold in (1e-300, 1e-160, 1e-30, 1e-9, 1e9, 1e30, 1e160, 1e300):
        yield rows, threshold
    for seed in range(FUZZED):
        yield fuzzed(np.random.default_rng(seed), rows.shape[1])


def fuzzed(rng, width):
    rows, kind = rng.standard_normal((int(rng.integers(3, 60)), width)), rng.integers(6)
    if kind == 1:
        rows = rows[rng.integers(max(1, len(rows) // 4), size=len(rows))]
    elif kind == 2:
        rows = np.round(rows)
    elif kind == 3:
        rows[:, rng.integers(width)] = 0.0
    elif kind == 4:
        rows *= 10.0 ** rng.uniform(-30, 30)
    elif kind == 5:
        rows[rng.integers(len(rows), size=len(rows) // 3)] *= 10.0 ** rng.uniform(-200, 200)
    return rows, 10.0 ** (rng.uniform(-8, 3) if rng.random() < 0.7 else rng.uniform(-300, 300))


def main(name):
    for kind, (problem, rows) in problems().items():
        if kind not in ESTIMATORS[name].problems:
            continue
        estimator, tried = replace(chosen_estimator(name, problem), iterations=ITERATIONS), 0
        for some, threshold in hopeless(rows):
            try:
                found = estimator.estimate(
                    problem, Rows(np.ascontiguousarray(some)), Noise.within(threshold), np.random.default_rng(0)
                )
                assert not found.found or np.isfinite(found.model).all()
            except (AssertionError, ImportError):
                raise
            except Exception:  # costs the sample
                pass
            tried += 1
        print(kind, tried)  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1])
