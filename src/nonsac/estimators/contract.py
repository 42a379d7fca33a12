"""What a core estimator has to do."""

from __future__ import annotations

from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from nonsac.problems.contract import Problem
from nonsac.result import Hypothesis


@runtime_checkable
class Estimator(Protocol):
    """Finds a model in one sample of rows (N, D). It travels to workers, so it must pickle.

    It may have a further method, `search_jointly(problem, hypotheses, rows, threshold, rng) -> Hypothesis`: one more
    search where the findings in several samples meet, given all their rows.
    """

    def estimate(
        self, problem: Problem, rows: NDArray[np.float64], threshold: float, rng: np.random.Generator
    ) -> Hypothesis:
        """The best model of the sample; a hypothesis whose model is NaN where there is none."""
        ...

    def with_budget(self, factor: int) -> Self:
        """The same estimator allowed to work `factor` times as much on one sample."""
        ...
