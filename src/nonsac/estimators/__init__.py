"""Core estimators: each finds one robust model in one non-minimal sample."""

from __future__ import annotations

from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.oriented_pairs import OrientedPairs
from nonsac.estimators.pcr99 import Pcr99
from nonsac.estimators.ransac import Ransac
from nonsac.problems import Problem
from nonsac.result import Hypothesis

__all__ = ["Estimator", "OrientedPairs", "Pcr99", "Ransac"]


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
