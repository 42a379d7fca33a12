"""Improving on the selected hypothesis, and judging what came out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from nonsac.fitting import reweighted_fit
from nonsac.problems import Problem
from nonsac.result import Alternative, Array, Hypothesis, Status
from nonsac.verdict import judge_rows

_BLOCK = 8192

# Reads the rows that all samples hold together, each once; only where they are needed.
Rows = Callable[[], Array]


@dataclass(frozen=True)
class Refinement:
    """The improved model, what supports it, and whether to trust it.

    `noise` and `threshold` are given where the refiner has its own, measured ones.
    """

    model: Array
    status: Status
    confidence: float
    num_inliers: int
    num_rows: int
    alternatives: tuple[Alternative, ...] = ()
    noise: float | None = None
    threshold: float | None = None


@runtime_checkable
class Refiner(Protocol):
    """Improves the winner, given all hypotheses and the union of their samples' rows."""

    def refine(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], winner: int, union: Rows, threshold: float
    ) -> Refinement: ...


@dataclass(frozen=True)
class AsSelected:
    """The selected hypothesis as it is, for studies of the rules; judged on the union of the samples."""

    def refine(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], winner: int, union: Rows, threshold: float
    ) -> Refinement:
        return judged(problem, hypotheses, hypotheses[winner].model, union(), threshold)


@dataclass(frozen=True)
class UnionRefit:
    """Score the hypotheses on the union of all samples, fit the best few there, and keep the best fit.

    A hypothesis is thereby compared on rows that it was not fitted to, and the winner is as accurate as all sampled
    inliers allow, not only those of its own sample.

    Parameters
    ----------
    candidates : int
        How many hypotheses are fitted.
    iterations : int
        Reweighted least-squares steps for each, at most.
    """

    candidates: int = 4
    iterations: int = 20

    def refine(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], winner: int, union: Rows, threshold: float
    ) -> Refinement:
        rows = union()
        models = np.stack([h.model for h in hypotheses if h.found])
        costs = truncated_costs(problem, models, rows, threshold)
        chosen = models[np.argsort(costs, kind="stable")[: self.candidates]]
        fitted = [reweighted_fit(problem, model, rows, threshold, self.iterations) for model in chosen]
        both = np.concatenate([chosen, np.stack(fitted)])
        best = both[int(np.argmin(truncated_costs(problem, both, rows, threshold)))]
        again = reweighted_fit(problem, best, rows, threshold, self.iterations)
        best = min((again, best), key=lambda model: truncated_costs(problem, model[None], rows, threshold)[0])
        return judged(problem, hypotheses, best, rows, threshold)


def by_name(name: object) -> Refiner:
    """The refiner with this name: "union" or "none"."""
    refiners: dict[str, Refiner] = {"union": UnionRefit(), "none": AsSelected()}
    if not isinstance(name, str) or name not in refiners:
        raise ValueError(f'refine must be "union", "none" or a Refiner, got {name!r}')
    return refiners[name]


def judged(
    problem: Problem, hypotheses: Sequence[Hypothesis], model: Array, rows: Array, threshold: float
) -> Refinement:
    """A model with its inliers among `rows` and the verdict on it."""
    tested = sum(h.tested for h in hypotheses)
    verdict = judge_rows(problem, model, rows, threshold, tested)
    inliers = int((problem.residuals(model[None], rows)[0] < threshold).sum())
    return Refinement(model, verdict.status, verdict.confidence, inliers, len(rows))


def truncated_costs(problem: Problem, models: Array, rows: Array, threshold: float) -> Array:
    """Sum of min(r^2, threshold^2) over the rows, for each model; infinite for a model of NaN."""
    costs = np.zeros(len(models))
    for start in range(0, len(rows), _BLOCK):
        residuals = problem.residuals(models, rows[start : start + _BLOCK])
        costs += (np.minimum(residuals, threshold) ** 2).sum(axis=1)
    return np.where(np.isfinite(costs), costs, np.inf)
