"""RANSAC: minimal samples, the model with the most inliers; with early stopping and local optimisation on request."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import Self

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.any_noise import Octaves
from nonsac.estimators.contract import Estimator
from nonsac.kernels.minimal_samples import distinct_rows, gather_rows
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, solved
from nonsac.problems.fits import RANKED_ON, SPARE, biweight_costs, cheapest, reweighted_fit, trials_needed
from nonsac.problems.ladder import Ladder
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis

_FIRST_BATCH, _LARGEST_BATCH = 64, 2048
_COMPARED = 5
_INNER = 300
_PREVIEW, _PROMISING = 512, 8


@dataclass(frozen=True)
class Ransac(Estimator):
    """Random sample consensus (Fischler and Bolles 1981) for any problem.

    As it stands, the standard loop of the paper: a fixed number of minimal samples, the model with the most inliers
    wins. Two options make it the one that the pose functions use.

    Parameters
    ----------
    iterations : int
        Minimal samples; at most so many if `confidence` is given.
    confidence : float or None
        Stop once a minimal sample of inliers only has been drawn with this probability, going by the most inliers seen
        so far. None never stops early.
    local_optimisation : bool
        Improve every new best model by a robust fit to the rows near it, and keep what has the least biweight
        cost (LO-RANSAC, Chum, Matas and Kittler 2003). Of the models with the most inliers the one with the least cost
        is the best: if nearly every model has nearly all inliers, their number tells little.
    least_iterations : int
        Minimal samples before `confidence` may end the loop.
    """

    iterations: int = 1000
    confidence: float | None = None
    local_optimisation: bool = False
    least_iterations: int = 1

    def __post_init__(self) -> None:
        if not isinstance(self.iterations, Integral) or isinstance(self.iterations, bool) or self.iterations < 1:
            raise ValueError(f"iterations must be an integer of at least 1, got {self.iterations!r}")
        least = self.least_iterations
        if not isinstance(least, Integral) or isinstance(least, bool) or least < 1:
            raise ValueError(f"least_iterations must be an integer of at least 1, got {least!r}")
        if self.confidence is None:
            return
        if not isinstance(self.confidence, Real) or not 0.0 < self.confidence < 1.0:
            raise ValueError(f"confidence must be None or between 0 and 1, got {self.confidence!r}")

    def estimate(self, problem: Problem, rows: Rows, noise: Noise, rng: np.random.Generator) -> Hypothesis:
        threshold, weights = noise.threshold, rows.mean_weights
        total = len(rows) if weights is None else weights.sum()
        model, cost, support, tested = problem.no_model, np.inf, 0.0, 0
        highest = -np.inf if self.local_optimisation else 0.0
        drawn, needed, batch = 0, self.iterations if len(rows) >= problem.minimal_size else 0, _FIRST_BATCH
        while drawn < needed:
            size = min(batch, needed - drawn)
            numbers = minimal_samples(len(rows), problem.minimal_size, size, rng, weights)
            models = solved(problem, gathered(rows.values, numbers))
            drawn, batch, tested = drawn + size, min(2 * batch, _LARGEST_BATCH), tested + len(models)
            if not len(models):
                continue
            candidate, score = self._best(problem, models, rows, threshold)
            if not score > highest:
                continue
            highest = score
            if self.local_optimisation:
                candidate = self._optimised(problem, candidate, rows, threshold)
                before, cost = cost, min(cost, biweight_costs(problem, candidate[None], rows, threshold)[0])
                if not cost < before:
                    continue
            model = candidate
            if self.confidence is not None:
                support = max(support, float(problem.count_inliers(model[None], rows.values, threshold, weights)[0]))
                trials = trials_needed(support / total, problem.minimal_size, self.confidence)
                needed = min(needed, max(trials, self.least_iterations))
        if not np.isfinite(model).all():
            return Hypothesis(model, np.full(len(rows), np.inf), threshold, tested=tested)
        return Hypothesis(model, problem.residuals(model[None], rows.values)[0], threshold, tested=tested)

    def estimate_at_any_noise(self, problem: Problem, rows: Rows, rng: np.random.Generator) -> Hypothesis | None:
        """The model and the threshold that are together least likely by chance (see `any_noise`)."""
        ladder = None if rows.weights is not None else Ladder.of(problem, rows, rng)
        if ladder is None or not self.local_optimisation:
            return None
        octaves = Octaves(
            problem, rows, ladder, lambda model, threshold: self._optimised(problem, model, rows, threshold)
        )
        drawn, needed, batch, tested = 0, self.iterations, _FIRST_BATCH, 0
        while drawn < needed:
            size = min(batch, needed - drawn)
            numbers = minimal_samples(len(rows), problem.minimal_size, size, rng)
            models = solved(problem, gathered(rows.values, numbers))
            drawn, batch, tested = drawn + size, min(2 * batch, _LARGEST_BATCH), tested + len(models)
            if not len(models):
                continue
            octaves.take(models)
            if self.confidence is not None:
                trials = trials_needed(octaves.support / len(rows), problem.minimal_size, self.confidence)
                needed = min(self.iterations, max(trials, self.least_iterations))
        chosen = octaves.chosen()
        if chosen is None:
            return None
        model, threshold, score = chosen
        residuals = problem.residuals(model[None], rows.values)[0]
        return Hypothesis(model, residuals, threshold, tested=tested, log_chance=-score)

    def _best(self, problem: Problem, models: Array, rows: Rows, threshold: float) -> tuple[Array, float]:
        """The best of some models, and its score: the number of inliers, or less the cost."""
        models = _promising(problem, models, rows, threshold)
        counts = problem.count_inliers(models, rows.values, threshold, rows.mean_weights)
        if not self.local_optimisation:
            best = int(np.argmax(counts))
            return models[best], float(counts[best])
        first = models[np.argsort(-counts, kind="stable")[:_COMPARED]]
        costs = biweight_costs(problem, first, rows, threshold)
        best = int(np.argmin(costs))
        return first[best], -float(costs[best]) if counts.max() > 0 else -np.inf

    def with_budget(self, factor: int) -> Self:
        return replace(self, iterations=self.iterations * factor)

    def search_jointly(
        self,
        problem: Problem,
        hypotheses: Sequence[Hypothesis],
        rows: Rows,
        noise: Noise,
        rng: np.random.Generator,
    ) -> Hypothesis | None:
        """The best model of minimal samples among the inliers of the best hypotheses (inner RANSAC, Chum et al. 2003).

        A hypothesis that is right in part has a larger share of right rows among its inliers, over all samples. Of many
        rows some tell which models are worth counting the inliers of among all.
        """
        threshold, few = noise.threshold, rows.some(RANKED_ON)
        models = np.stack([h.model for h in hypotheses if h.found])
        best, cost, tested = models[0], np.inf, 0
        for model in models[cheapest(problem, models, rows, threshold, _COMPARED)]:
            inliers = rows[problem.residuals(model[None], rows.values)[0] < threshold]
            if len(inliers) <= problem.minimal_size:
                continue
            numbers = minimal_samples(len(inliers), problem.minimal_size, _INNER, rng, inliers.mean_weights)
            found = solved(problem, gathered(inliers.values, numbers))
            if not len(found):
                continue
            tested += len(found)
            if len(few) < len(rows):
                found = _with_most_inliers(problem, found, few, threshold, SPARE * _COMPARED)
            first = _with_most_inliers(problem, found, rows, threshold, _COMPARED)
            costs = biweight_costs(problem, first, rows, threshold)
            if costs.min() < cost:
                best, cost = first[int(np.argmin(costs))], float(costs.min())
        return Hypothesis(best, problem.residuals(best[None], rows.values)[0], threshold, tested=tested)

    def _optimised(self, problem: Problem, model: Array, rows: Rows, threshold: float) -> Array:
        """The model after a fit to all rows near it, first from twice as far."""
        wide = reweighted_fit(problem, model, rows, 2.0 * threshold, 4)
        fitted = reweighted_fit(problem, wide, rows, threshold, 6)
        both = np.stack([model, fitted])
        return both[int(np.argmin(biweight_costs(problem, both, rows, threshold)))]


def default(problem: Problem) -> Ransac:
    """RANSAC with local optimisation and early stopping.

    With a small baseline nearly every relative pose has nearly all inliers, and a good one needs a longer search.
    """
    least = 1000 if problem.minimal_size > 4 else 100
    return Ransac(20_000, confidence=0.9999, local_optimisation=True, least_iterations=least)


def _promising(problem: Problem, models: Array, rows: Rows, threshold: float) -> Array:
    """Those of some models, an eighth, that have the most inliers among a part of the rows; all, if rows are few.

    A bail-out test by rank (Capel 2005, Nister 2005): a model that could win is hardly ever among the lower ones.
    """
    most = max(len(models) // _PROMISING, _COMPARED)
    step = len(rows) // _PREVIEW
    if step < 3 or most >= len(models):
        return models
    some = rows[::step]
    counts = problem.count_inliers(models, np.ascontiguousarray(some.values), threshold, some.mean_weights)
    return models[np.sort(np.argsort(-counts, kind="stable")[:most])]


def _with_most_inliers(problem: Problem, models: Array, rows: Rows, threshold: float, most: int) -> Array:
    counts = problem.count_inliers(models, rows.values, threshold, rows.mean_weights)
    return models[np.argsort(-counts, kind="stable")[:most]]


def minimal_samples(
    rows: int, size: int, count: int, rng: np.random.Generator, weights: Array | None = None
) -> NDArray[np.int64]:
    """Row numbers of minimal samples, (count, size): distinct within a sample, independent between samples.

    Weighted rows are drawn with a probability in proportion to their weight; a sample that drew a row twice is drawn
    again a few times, and may in the end hold it twice, which solvers take for degenerate.
    """
    if weights is None:
        return _distinct(rows, size, count, rng)
    cumulative = np.cumsum(weights)
    drawn = np.empty((count, size), np.int64)
    waiting = np.arange(count)
    for _ in range(20):
        drawn[waiting] = np.searchsorted(cumulative, rng.random((len(waiting), size)) * cumulative[-1], side="right")
        ordered = np.sort(drawn[waiting], axis=1)
        waiting = waiting[(ordered[:, 1:] == ordered[:, :-1]).any(axis=1)]
        if not len(waiting):
            break
    return np.minimum(drawn, rows - 1)


def _distinct(rows: int, size: int, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    drawn = np.empty((count, size), np.int64)
    distinct_rows(rng.random((count, size)), rows, drawn)
    return drawn


def gathered(rows: Array, numbers: NDArray[np.int64]) -> Array:
    samples = np.empty((*numbers.shape, rows.shape[1]))
    gather_rows(rows, numbers, samples)
    return samples
