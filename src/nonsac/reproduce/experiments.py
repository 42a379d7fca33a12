"""The simulations of Sec. 4.1 to 4.3: what is drawn, at which noise and outlier ratios, and how samples are estimated.

The paper states the outlier ranges, the thresholds (5 noise) and the sample sizes, and the noise levels of PnP. Its
other noise levels and the iterations of RANSAC are the values of a search that bring the averages of its rules closest
to its Table 2 (docs/reproduction.md); its outlier ratios are taken in six equal steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from nonsac import simulate
from nonsac.calls.pairs import register_pairs
from nonsac.calls.poses import absolute_pose, relative_pose
from nonsac.estimators import Pcr99, Ransac
from nonsac.estimators.contract import Estimator
from nonsac.layouts import Array
from nonsac.problems import AbsolutePose, Registration, RelativePose
from nonsac.problems.contract import Problem
from nonsac.result import Result

__all__ = ["EXPERIMENTS", "Experiment", "chosen"]

# n, outlier ratio, noise, generator -> rows, true transform
Simulation = Callable[[int, float, float, np.random.Generator], tuple[Array, Array]]


@dataclass(frozen=True)
class Experiment:
    """One of the three problems of Table 2.

    Attributes
    ----------
    name, title : str
        As in files and on the command line; for people.
    problem, estimator
        What is estimated from each sample, and how.
    simulate : callable
        `simulate(n, outlier_ratio, noise, generator)` gives rows and the true (4, 4) transform.
    refined : callable
        `refined(rows, noise=..., max_samples=..., sample_size=...)` is the default pipeline of this package.
    outlier_ratios, noises, sample_size
        The grid of the table, and the paper's N.
    residual_power : int
        2 if the rules of the paper see squared residuals, as with Sampson errors (Sec. 4.1).
    """

    name: str
    title: str
    problem: Problem
    estimator: Estimator
    simulate: Simulation
    refined: Callable[..., Result]
    outlier_ratios: tuple[float, ...]
    noises: tuple[float, ...]
    sample_size: int
    residual_power: int = 1

    def settings(self) -> dict[str, Any]:
        """What another run needs to give the same numbers, ready for JSON."""
        return {
            "outlier_ratios": list(self.outlier_ratios),
            "noises": list(self.noises),
            "sample_size": self.sample_size,
            "residual_power": self.residual_power,
            "estimator": {"name": type(self.estimator).__name__, **asdict(self.estimator)},  # type: ignore[call-overload]
        }


def relative_rows(
    n: int, outlier_ratio: float, noise: float, rng: np.random.Generator, make: Any = simulate.relative_pose
) -> tuple[Array, Array]:
    """Rows of matches, and the true pose."""
    data = make(n, outlier_ratio, noise, rng)
    return np.concatenate([data.points1, data.points2], axis=1), data.T


def absolute_rows(
    n: int, outlier_ratio: float, noise: float, rng: np.random.Generator, make: Any = simulate.absolute_pose
) -> tuple[Array, Array]:
    """The same of points of the world."""
    data = make(n, outlier_ratio, noise, rng)
    return np.concatenate([data.points2d, data.points3d], axis=1), data.T


def _pairs(n: int, outlier_ratio: float, noise: float, rng: np.random.Generator) -> tuple[Array, Array]:
    data = simulate.registration(n, outlier_ratio, noise, rng)
    return np.concatenate([data.source, data.target], axis=1), data.T


def _by_default(call: Callable[..., Result], split: int, rows: Array, **settings: Any) -> Result:
    return call(rows[:, :split], rows[:, split:], workers=1, **settings)


EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (
        Experiment(
            "relative-pose",
            "Relative pose",
            RelativePose(),
            Ransac(5000),
            relative_rows,
            partial(_by_default, relative_pose, 2),
            outlier_ratios=(0.65, 0.7, 0.75, 0.8, 0.85, 0.9),
            noises=(0.002, 0.0025, 0.01),
            sample_size=1000,
            residual_power=2,
        ),
        Experiment(
            "absolute-pose",
            "Perspective-n-Point",
            AbsolutePose(),
            Ransac(2000),
            absolute_rows,
            partial(_by_default, absolute_pose, 2),
            outlier_ratios=(0.92, 0.93, 0.94, 0.95, 0.96, 0.97),
            noises=(0.005, 0.01, 0.02),
            sample_size=1000,
        ),
        Experiment(
            "registration",
            "Registration of pairs",
            Registration(),
            replace(Pcr99.for_pairs(), refit="once"),
            _pairs,
            partial(_by_default, register_pairs, 3),
            outlier_ratios=(0.99, 0.991, 0.992, 0.993, 0.994, 0.995),
            noises=(0.01, 0.0125, 0.02),
            sample_size=2000,
        ),
    )
}


def chosen(names: Iterable[str], literal: bool = False) -> tuple[Experiment, ...]:
    """The experiments with these names, in the order of Table 2; as the paper's text has them if `literal`."""
    wanted = tuple(names)
    unknown = [name for name in wanted if name not in EXPERIMENTS]
    if unknown or not wanted:
        known = ", ".join(EXPERIMENTS)
        raise ValueError(f"problems must be some of {known}, got {', '.join(map(repr, unknown)) or 'none'}")
    experiments = EXPERIMENTS
    if literal:
        from nonsac.reproduce.literal import LITERAL as experiments
    return tuple(experiment for name, experiment in experiments.items() if name in wanted)
