"""What a core estimator has to do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np

from nonsac.layouts import Rows
from nonsac.problems.contract import ContractBroken, Problem
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis


class Estimator(ABC):
    """Finds one model in one non-minimal sample; derive a class from it to add a core estimator.

    `estimate` is needed; everything else has a default. An estimator travels to workers, so it must pickle.
    """

    @abstractmethod
    def estimate(self, problem: Problem, rows: Rows, noise: Noise, rng: np.random.Generator) -> Hypothesis:
        """The best model of a sample of usable rows.

        Parameters
        ----------
        problem : Problem
        rows : Rows
            N rows, of which few may be inliers; none is NaN, and no weight is 0.
        noise : Noise
        rng : numpy Generator
            The only source of randomness, so that the same input gives the same answer.

        Returns
        -------
        Hypothesis
            Its model is NaN (`problem.no_model`) if there is none, and `tested` None if it is not known. An exception
            costs this sample only: it is kept in `Hypothesis.fault`, and the result says so.
        """

    @property
    def needs_weights(self) -> bool:
        """Whether rows must have weights; by default not."""
        return False

    def check(self, problem: Problem) -> None:
        """Raise TypeError or ValueError if this estimator cannot work on the problem; by default it can."""
        return None

    def estimate_at_any_noise(self, problem: Problem, rows: Rows, rng: np.random.Generator) -> Hypothesis | None:
        """The same if the noise is not known: `Hypothesis.threshold` is then what this found.

        None, the default, if this estimator needs a noise; it is then called with several.
        """
        return None

    def with_budget(self, factor: int) -> Self:
        """The same estimator allowed to work `factor` times as much on one sample; by default it has one budget."""
        return self

    def search_jointly(
        self,
        problem: Problem,
        hypotheses: Sequence[Hypothesis],
        rows: Rows,
        noise: Noise,
        rng: np.random.Generator,
    ) -> Hypothesis | None:
        """One more search after the samples, where their findings meet, given all their rows; by default none."""
        return None

    def search_jointly_at_any_noise(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], rng: np.random.Generator
    ) -> Hypothesis | None:
        """The same if the noise is not known: some rows, the best model of them and its threshold; by default none."""
        return None


def checked_hypothesis(
    hypothesis: object, problem: Problem, estimator: Estimator, method: str = "estimate"
) -> Hypothesis:
    """What an estimator gave, if it is what its contract says."""
    name, shape = f"{type(estimator).__name__}.{method}", tuple(problem.model_shape)
    if not isinstance(hypothesis, Hypothesis):
        raise ContractBroken(f"{name} must give a nonsac.Hypothesis, got {type(hypothesis).__name__}")
    if np.shape(hypothesis.model) != shape:
        raise ContractBroken(
            f"{name} gave a model of the shape {np.shape(hypothesis.model)}; "
            f"{type(problem).__name__} has models of the shape {shape}"
        )
    if np.ndim(hypothesis.residuals) != 1:
        raise ContractBroken(f"{name} gave residuals of the shape {np.shape(hypothesis.residuals)}, not (N,)")
    if isinstance(hypothesis.model, np.ndarray) and hypothesis.model.dtype == np.float64:
        return hypothesis
    return replace(hypothesis, model=np.asarray(hypothesis.model, np.float64))
