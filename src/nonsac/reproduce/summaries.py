"""Numbers that sum up many trials, ready for JSON."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib.metadata import version
from itertools import chain
from typing import Any

import numpy as np

from nonsac.evaluation import mean_average_accuracy
from nonsac.reproduce.cells import RULES, Trial
from nonsac.values.version import VERSION

__all__ = [
    "PERCENTILES",
    "WRONG_ABOVE",
    "accuracies",
    "claims",
    "environment",
    "mean_accuracies",
    "percentiles",
    "times",
]

PERCENTILES = (5, 25, 50, 75, 95)
# Beyond the largest threshold of the mAA.
WRONG_ABOVE = 10.0


def accuracies(trials: Sequence[Trial], m: int) -> dict[str, float]:
    """mAA by rule of the trials of one cell."""
    return {rule: mean_average_accuracy([t.errors[m][rule] for t in trials]) for rule in RULES}


def mean_accuracies(cells: Sequence[Sequence[Trial]], m: int) -> dict[str, float]:
    """mAA by rule, averaged over cells."""
    found = [accuracies(trials, m) for trials in cells]
    return {rule: float(np.mean([accuracy[rule] for accuracy in found])) for rule in RULES}


def percentiles(cells: Sequence[Sequence[Trial]], m: int) -> dict[str, list[float]]:
    """`PERCENTILES` of all errors in degrees by rule; an estimate that failed counts as 180."""
    trials = list(chain.from_iterable(cells))
    errors = {rule: np.nan_to_num([t.errors[m][rule] for t in trials], nan=180.0) for rule in RULES}
    return {rule: [float(x) for x in np.percentile(values, PERCENTILES)] for rule, values in errors.items()}


def times(cells: Sequence[Sequence[Trial]], m: int) -> dict[str, float]:
    """Median seconds of all trials by stage."""
    trials = list(chain.from_iterable(cells))
    stages = trials[0].seconds[m]
    return {stage: float(np.median([t.seconds[m][stage] for t in trials])) for stage in stages}


def claims(cells: Sequence[Sequence[Trial]], m: int) -> dict[str, int]:
    """How `refined` judged its own answers in all trials: right and wrong ones (`WRONG_ABOVE`), trusted and not."""
    trials = list(chain.from_iterable(cells))
    right = np.array([t.errors[m]["refined"] < WRONG_ABOVE for t in trials])
    claimed = np.array([t.claimed[m] for t in trials])
    return {
        "trusted_right": int((claimed & right).sum()),
        "trusted_wrong": int((claimed & ~right).sum()),
        "untrusted_right": int((~claimed & right).sum()),
        "untrusted_wrong": int((~claimed & ~right).sum()),
    }


def environment(*more_packages: str) -> dict[str, Any]:
    """Machine and versions."""
    packages = ("numpy", "scipy", "numba", *more_packages)
    return {
        "version": VERSION,
        "machine": {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count()},
        "python": platform.python_version(),
        "packages": {name: version(name) for name in packages},
    }
