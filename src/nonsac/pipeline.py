"""NONSAC on one page: sample, estimate in each sample, select, refine, judge (Lee, Vandewalle and Civera, Fig. 1)."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import Protocol

import numpy as np

from nonsac import refine as refiners
from nonsac import scoring
from nonsac.estimators import Estimator
from nonsac.executors import Workers, ordered_map
from nonsac.problems import Problem
from nonsac.refine import Refiner
from nonsac.result import VERSION, Array, Evidence, Hypothesis, Result, Status, failed, homogeneous, threshold_of
from nonsac.sampling import canonical_seed, sample_rows, union_rows
from nonsac.scoring import ScoringRule
from nonsac.sources import Source


class Stop(Protocol):
    """Says after each sample whether the hypotheses so far are enough."""

    def __call__(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> bool: ...


def estimate(
    source: Source,
    problem: Problem,
    estimator: Estimator,
    *,
    noise: float,
    samples: int = 10,
    sample_size: int = 1000,
    rule: str | ScoringRule = "tlp_0.1",
    refine: str | Refiner = "union",
    stop: Stop | None = None,
    workers: Workers = None,
    rng: int | np.random.Generator | None = 0,
    progress: Callable[[int, int], object] | None = None,
) -> Result:
    """Estimate a model from any amount of dirty data.

    Draws `samples` non-minimal samples of `sample_size` rows, runs the core estimator on each, selects one hypothesis
    by the scoring rule, refines it and says how far to trust it. Memory is set by the samples, not by the source.

    Parameters
    ----------
    source : Source
        The rows, one correspondence each.
    problem : Problem
        The mathematics, for instance `Registration()`.
    estimator : Estimator
        Finds a model in one sample, for instance `Pcr99.for_pairs()`.
    noise : float
        Standard deviation of an inlier, in the unit of the residual; the inlier threshold is 5 `noise`.
    samples, sample_size : int
        The paper's m and N. Samples do not overlap where the source has m N rows, else they are drawn independently.
    rule : str or ScoringRule
        How the hypothesis is selected: a name (see `nonsac.scoring`) or a rule object. It decides the answer with
        refine="none"; refiners that compare all hypotheses anew, as "union" does, overrule it.
    refine : "union", "polish", "none" or Refiner
        "union" rescores all hypotheses on all sampled rows and refits the best; "polish" then fits it to at least
        100,000 rows, or all; "none" returns the selected one.
    stop : callable, optional
        Called as `stop(hypotheses, problem)` after each sample; ends the sampling where it says so.
    workers : None, int or concurrent.futures.Executor
        One thread for each core, this many threads, or a pool. The answer is the same, bit for bit.
    rng : int, numpy Generator or None
        The seed; None takes fresh entropy, which is recorded in `info["seed"]`.
    progress : callable, optional
        Called as `progress(done, samples)`.

    Returns
    -------
    Result

    Raises
    ------
    ValueError
        Where an argument is out of its range; the message names it. Bad data do not raise: they end in a status.
    """
    for name, value, kind in (
        ("source", source, Source),
        ("problem", problem, Problem),
        ("estimator", estimator, Estimator),
    ):
        if not _is_object(value, kind):
            raise TypeError(f"{name} must be an object of the kind {kind.__module__}.{kind.__name__}, got {value!r}")
    _check(source, problem, noise, samples, sample_size)
    selector = scoring.by_name(rule) if isinstance(rule, str) or not _is_object(rule, ScoringRule) else rule
    refiner = refiners.by_name(refine) if isinstance(refine, str) or not _is_object(refine, Refiner) else refine
    budget, estimator = _plan(selector, samples, estimator)
    if sample_size >= len(source) and budget > 1:  # every sample would be all rows: one, with the budget of all
        budget, estimator = 1, estimator.with_budget(budget)
    clock = Stopwatch()
    task = SampleTask(source, problem, estimator, threshold_of(noise), budget, sample_size, canonical_seed(rng))
    info = {"seed": task.seed, "version": VERSION, "rule": selector.name, "sample_size": sample_size, "remarks": ()}
    evidence = Evidence(source, problem)
    if len(source) < problem.minimal_size:
        return failed(Status.TOO_FEW, noise, info | {"samples": 0, "seconds": clock.laps}, evidence=evidence)

    hypotheses: list[Hypothesis] = []
    for hypothesis in ordered_map(task, budget, workers):
        hypotheses.append(hypothesis)
        if progress is not None:
            progress(len(hypotheses), budget)
        if stop is not None and stop(hypotheses, problem):
            break
    clock.lap("hypotheses")

    winner, scores = scoring.select(selector, hypotheses, problem)
    clock.lap("selection")
    dropped = sum(h.dropped for h in hypotheses)
    info |= {"samples": len(hypotheses), "dropped_rows": dropped, "seconds": clock.laps}
    union = functools.cache(functools.partial(task.union, len(hypotheses)))
    if not hypotheses[winner].found:
        return failed(_reason(problem, union(), task.threshold), noise, info, tuple(hypotheses), evidence)
    refinement = refiner.refine(problem, hypotheses, winner, union, task.threshold)
    clock.lap("refinement")
    return Result(
        T=homogeneous(refinement.model),
        status=refinement.status,
        confidence=refinement.confidence,
        num_inliers=refinement.num_inliers,
        num_rows=refinement.num_rows,
        noise=float(noise) if refinement.noise is None else refinement.noise,
        threshold=task.threshold if refinement.threshold is None else refinement.threshold,
        hypotheses=scoring.scored(hypotheses, scores),
        alternatives=refinement.alternatives,
        covariance=refinement.covariance,
        info=info | {"remarks": refinement.remarks},
        evidence=evidence,
    )


@dataclass(frozen=True)
class SampleTask:
    """One sample from its number to its hypothesis; travels to any worker."""

    source: Source
    problem: Problem
    estimator: Estimator
    threshold: float
    samples: int
    sample_size: int
    seed: int

    def __call__(self, sample: int) -> Hypothesis:
        drawn = self.source.take(self._indices(sample))
        rows = drawn[np.isfinite(drawn).all(axis=1)]
        dropped = len(drawn) - len(rows)
        if len(rows) < self.problem.minimal_size:
            nothing = np.full((3, 4), np.nan)
            return Hypothesis(nothing, np.full(len(rows), np.inf), self.threshold, sample, dropped=dropped)
        rng = np.random.default_rng([self.seed, sample])
        hypothesis = self.estimator.estimate(self.problem, rows, self.threshold, rng)
        return replace(hypothesis, sample=sample, dropped=dropped)

    def union(self, samples: int, at_least: int = 0) -> Array:
        """The finite rows that the first samples hold together, each once, and further ones up to a number."""
        indices = union_rows(len(self.source), samples, self.samples, self.sample_size, self.seed, at_least)
        rows = self.source.take(indices)
        return rows[np.isfinite(rows).all(axis=1)]

    def _indices(self, sample: int) -> np.ndarray:
        return sample_rows(len(self.source), sample, self.samples, self.sample_size, self.seed)


class Stopwatch:
    """Seconds per stage, in the order of the stages."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.laps[stage] = self.laps.get(stage, 0.0) + now - self._last
        self._last = now


def _is_object(value: object, kind: type) -> bool:
    """Whether a value fulfils a contract, and is not merely the class of one that does."""
    return isinstance(value, kind) and not isinstance(value, type)


def _reason(problem: Problem, rows: Array, threshold: float) -> Status:
    """Why no sample gave a model."""
    if len(rows) < problem.minimal_size:
        return Status.TOO_FEW
    nothing = np.full((3, 4), np.nan)
    return Status.LOW_SUPPORT if problem.determined(nothing, rows, threshold) else Status.DEGENERATE


def _plan(rule: ScoringRule, samples: int, estimator: Estimator) -> tuple[int, Estimator]:
    """A rule may spend the budget in its own way, as `FixedSample` does."""
    return rule.plan(samples, estimator) if hasattr(rule, "plan") else (samples, estimator)


def _check(source: Source, problem: Problem, noise: float, samples: int, sample_size: int) -> None:
    if source.width != problem.width:
        raise ValueError(f"source has rows of {source.width} columns, {type(problem).__name__} needs {problem.width}")
    if not isinstance(noise, Real) or not 0 < noise < np.inf:
        raise ValueError(f"noise must be a positive number, the standard deviation of an inlier, got {noise!r}")
    for name, value, least in (("samples", samples, 1), ("sample_size", sample_size, problem.minimal_size)):
        if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
            raise ValueError(f"{name} must be an integer of at least {least}, got {value!r}")
