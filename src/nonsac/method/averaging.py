"""Averages of hypotheses that wrong ones among them do not drag along."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nonsac.layouts import Array
from nonsac.problems.contract import Problem, sums_of_distances

REACH = 10.0  # degrees
_MOST_ROUNDS = 20


def l1_average(problem: Problem, models: Array, rows: Array) -> Array:
    """The least sum of distances to all models (of rotations: Hartley, Aftab and Trumpf, CVPR 2011)."""
    return problem.average(models, rows)


def trimmed_average(problem: Problem, models: Array, rows: Array) -> Array:
    """The L1 average of the models near it: within `REACH`, or the nearest quarter.

    As in Lee and Civera, "Robust single rotation averaging", 2020, who also leave far ones out, though after each step
    of Weiszfeld's algorithm, and start at the median of each number of a rotation matrix.
    """
    average = problem.average(models, rows)
    before: NDArray[np.int64] | None = None
    for _ in range(_MOST_ROUNDS):
        distances = problem.distance(models, average[None])
        near = np.flatnonzero(distances <= max(np.quantile(distances, 0.25), REACH))
        if before is not None and np.array_equal(near, before):
            break
        average, before = problem.average(models[near], rows), near
    return average


def truncated_average(problem: Problem, models: Array, rows: Array) -> Array:
    """The L1 average of the models around the one with the least sum of distances truncated at `REACH`.

    Lee and Civera, "Robust single rotation averaging revisited", 2023: right if more models agree on the right answer
    than on any wrong one, whatever their share.
    """
    sums = sums_of_distances(problem, models, REACH)
    if sums.min() >= REACH * (len(models) - 1):  # no two agree
        return problem.average(models, rows)
    centre = models[int(np.argmin(sums))]
    return problem.average(models[problem.distance(models, centre[None]) <= REACH], rows)


AVERAGES: dict[str, Callable[[Problem, Array, Array], Array]] = {
    "l1": l1_average,
    "trimmed": trimmed_average,
    "truncated": truncated_average,
}


def check_kind(kind: object) -> None:
    """Raise ValueError if there is no average of this name."""
    if not isinstance(kind, str) or kind not in AVERAGES:
        names = ", ".join(f'"{known}"' for known in AVERAGES)
        raise ValueError(f"kind must be one of {names}, got {kind!r}")
