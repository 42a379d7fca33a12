"""What comes after the samples: improving on the selected hypothesis, and judging what came out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nonsac.layouts import Array, Rows
from nonsac.method.judgement import Judgement
from nonsac.method.search import Search
from nonsac.problems.contract import ContractBroken, Problem
from nonsac.result import Alternative, Hypothesis, Remark, Status, Uncertainty

_MANY_COPIES = 0.1


@dataclass(frozen=True)
class Refinement:
    """The improved model, what supports it, and whether to trust it.

    Attributes
    ----------
    model : float64
        In the problem's own shape.
    status : Status
    confidence : float
        In [0, 1]; below 0.5 it is not to be trusted.
    num_inliers, num_rows : int
        Rows that support the model, of those that it was tested on.
    alternatives : tuple of Alternative
    covariance : (p, p) float64 or None
    uncertainty : Uncertainty or None
    noise, threshold : float or None
        Those of the refiner, if it has its own.
    measured_noise : float or None
        The noise that the inliers show, if it was measured.
    remarks : tuple of str
        Special cases of the data, such as "planar"; see `nonsac.result.Remark`.
    info : dict
        What else the result's `info` is to hold.
    """

    model: Array
    status: Status
    confidence: float
    num_inliers: int
    num_rows: int
    alternatives: tuple[Alternative, ...] = ()
    covariance: Array | None = None
    uncertainty: Uncertainty | None = None
    noise: float | None = None
    threshold: float | None = None
    measured_noise: float | None = None
    remarks: tuple[str, ...] = ()
    info: dict[str, Any] = field(default_factory=dict)

    @property
    def is_chance(self) -> bool:
        """Whether the model explains no more than one that is wrong would."""
        return self.status is Status.LOW_SUPPORT and not self.remarks

    @classmethod
    def of(
        cls, search: Search, model: Array, hypotheses: Sequence[Hypothesis] | None = None, at_least: int = 0
    ) -> Refinement:
        """A model with the usual verdict on it, from the rows that the samples hold together.

        Parameters
        ----------
        search : Search
        model : float64
        hypotheses : sequence of Hypothesis, optional
            That it was chosen from; by default those of the samples.
        at_least : int
            Rows that it is judged on at least; all rows if there are fewer.
        """
        if np.shape(model) != tuple(search.problem.model_shape):
            raise ContractBroken(
                f"Refinement.of got a model of the shape {np.shape(model)} instead of {search.problem.model_shape}"
            )
        model = np.asarray(model, np.float64)
        rows, compared = search.union(at_least), search.hypotheses if hypotheses is None else hypotheses
        judgement = Judgement.of(search.problem, model, rows, search.noise, compared)
        verdict = judgement.verdict
        return cls(
            model,
            verdict.status,
            verdict.confidence,
            judgement.num_inliers,
            len(rows),
            verdict.alternatives,
            judgement.covariance,
            judgement.uncertainty,
            measured_noise=judgement.noise,
            remarks=(*judgement.remarks, *_on_copies(rows)),
            info={"tests": verdict.tests} if verdict.tests else {},
        )


def _on_copies(rows: Rows) -> tuple[str, ...]:
    """What is said if many rows are equal to others."""
    given = len(rows) + rows.copies
    return (Remark.COPIES.detailed(f"{rows.copies:,} of {given:,}"),) if rows.copies > _MANY_COPIES * given else ()


def refined(refiner: Refiner, search: Search, winner: int) -> Refinement:
    """`Refiner.refine`, if it gave what the contract says."""
    refinement: object = refiner.refine(search, winner)
    name, problem = type(refiner).__name__, search.problem
    if not isinstance(refinement, Refinement):
        raise ContractBroken(f"{name}.refine must give a nonsac.Refinement, got {type(refinement).__name__}")
    if np.shape(refinement.model) != tuple(problem.model_shape):
        raise ContractBroken(
            f"{name}.refine gave a model of the shape {np.shape(refinement.model)}; {type(problem).__name__} has "
            f"models of the shape {problem.model_shape}"
        )
    if not isinstance(refinement.status, Status):
        raise ContractBroken(f"{name}.refine gave the status {refinement.status!r}, which is no nonsac.Status")
    return refinement


class Refiner(ABC):
    """Improves the selected hypothesis, and says whether to trust the outcome; derive a class from it to add one.

    `refine` is needed; everything else has a default.
    """

    @abstractmethod
    def refine(self, search: Search, winner: int) -> Refinement:
        """What is made of the hypotheses so far, after each round of samples.

        Parameters
        ----------
        search : Search
            Its `hypotheses`, one for each sample; `problem`, `noise` and `task.estimator`; and `union(at_least)`, the
            rows that all samples hold together and as many more as are asked for.
        winner : int
            Number of the hypothesis that the scoring rule selected; it has a model.
        """

    def check(self, problem: Problem) -> None:
        """Raise ValueError if this refiner cannot work on the problem; by default it can."""
        return None

    def finish(self, search: Search, refinement: Refinement) -> Refinement:
        """A last step, after all samples; by default none."""
        return refinement


@dataclass(frozen=True)
class AsSelected(Refiner):
    """The selected hypothesis as it is, for studies of the rules; judged on the union of the samples."""

    def refine(self, search: Search, winner: int) -> Refinement:
        return Refinement.of(search, search.hypotheses[winner].model)
