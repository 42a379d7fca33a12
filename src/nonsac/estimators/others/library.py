"""A search of another library as a core estimator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self

import numpy as np

from nonsac.estimators.contract import Estimator
from nonsac.estimators.external import External
from nonsac.layouts import Array, Rows
from nonsac.problems.absolute_pose import AbsolutePose
from nonsac.problems.contract import Problem
from nonsac.problems.noise import Noise
from nonsac.problems.registration import Registration
from nonsac.problems.relative_pose import RelativePose
from nonsac.result import Hypothesis

# A function of (problem, values, threshold, seed, iterations) that gives what a function of `External` gives.
Solve = Callable[[Any, Array, float, int, int], Any]

ITERATIONS = 100_000
CONFIDENCE = 0.9999
_MOST = 2**31 - 1


@dataclass(frozen=True)
class Library(Estimator):
    """A search of another library: an `External` that knows the problem, and how many iterations it may make.

    Parameters
    ----------
    solve : callable
        `solve(problem, values, threshold, seed, iterations)`, a function of a module, gives one or more models or
        None. `values` are at least `problem.minimal_size` different rows.
    iterations : int
        Minimal samples at most, if the library counts any.
    needs_scale : bool
        Whether it cannot estimate the scale of a registration.
    """

    solve: Solve
    iterations: int = ITERATIONS
    needs_scale: bool = False

    def check(self, problem: Problem) -> None:
        if self.needs_scale and isinstance(problem, Registration) and problem.scale is None:
            name = self.solve.__module__.split(".")[-1].replace("_", "-")
            raise ValueError(
                f"{name} needs a known scale, and the scale is to be estimated: use pcr99, teaser or ransac"
            )

    def estimate(self, problem: Problem, rows: Rows, noise: Noise, rng: np.random.Generator) -> Hypothesis:
        self.check(problem)
        return External(partial(self._models, problem)).estimate(problem, rows, noise, rng)

    def _models(self, problem: Problem, values: Array, threshold: float, seed: int) -> Any:
        if len(np.unique(values, axis=0)) < problem.minimal_size:
            return None
        return self.solve(problem, values, threshold, seed, self.iterations)

    def with_budget(self, factor: int) -> Self:
        return replace(self, iterations=min(self.iterations * factor, _MOST))


def normalised(problem: RelativePose | AbsolutePose, threshold: float) -> float:
    """A threshold in pixels as one in normalised image coordinates; two cameras share their mean."""
    focals = (problem.focal1, problem.focal2) if isinstance(problem, RelativePose) else (problem.focal,)
    return threshold * float(np.mean(1.0 / np.array(focals)))
