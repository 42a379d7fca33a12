"""Sample consensus put together from parts: how rows are drawn, what a model is worth, and how good ones are improved.

The parts are those of USAC (Raguram, Chum, Pollefeys, Matas and Frahm, "USAC: a universal framework for random sample
consensus", PAMI 2013). The published methods are settings of one class; parts of one go with those of another.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.contract import Estimator
from nonsac.estimators.ransac import gathered, minimal_samples
from nonsac.estimators.scores import Inliers, Marginalised, Score, Truncated
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, refitted, solved
from nonsac.problems.fits import trials_needed
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis
from nonsac.values.numeric import as_real, as_whole, shown

_BATCH = 64
_INLIERS, _MARGINALISED = Inliers(), Marginalised()


@dataclass(frozen=True)
class Consensus:
    """Rows, and what a model is worth to them."""

    problem: Problem
    rows: Rows
    threshold: float
    score: Score

    def ratios(self, model: Array) -> Array:
        """The residuals of all rows in units of the threshold (N,)."""
        return self.problem.residuals(model[None], self.rows.values)[0] / self.threshold

    def scores(self, models: Array) -> Array:
        """What models are worth (M,)."""
        return self.score.of(self.problem, models, self.rows, self.threshold)

    def best(self, models: Array, floor: float = 0.0) -> tuple[int, float] | None:
        """The number of the best model and its score; None if no score is above the floor."""
        return self.score.best(self.problem, models, self.rows, self.threshold, floor)

    def fitted(self, model: Array, factors: Array) -> Array:
        """The least-squares model of the rows, weighted by factors (N,) and their weights, from a start; or NaN."""
        some = np.flatnonzero(factors > 0.0)
        rows = self.rows[some]
        return refitted(self.problem, model, rows.values, rows.times(factors[some]))

    def fitted_to(self, model: Array, numbers: NDArray[np.int64]) -> Array:
        """The least-squares model of some rows, from a start; or NaN."""
        rows = self.rows[numbers]
        return refitted(self.problem, model, rows.values, rows.times(np.ones(len(rows))))


class Sampler(ABC):
    """How rows are drawn for minimal samples, and when there were enough."""

    @abstractmethod
    def draw(self, rows: Rows, size: int, before: int, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Row numbers (count, size) of the samples that come after so many others."""

    @abstractmethod
    def needed(self, consensus: Consensus, model: Array, confidence: float) -> int:
        """How many samples are enough if this is the best model so far."""

    needs_weights: bool = False

    def why_not(self, rows: Rows) -> str:
        """Why it cannot draw from these rows, in words; nothing if it can."""
        return ""


@dataclass(frozen=True)
class Uniform(Sampler):
    """All rows alike, or in proportion to their weights."""

    def draw(self, rows: Rows, size: int, before: int, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        return minimal_samples(len(rows), size, count, rng, rows.mean_weights)

    def needed(self, consensus: Consensus, model: Array, confidence: float) -> int:
        """Until a sample of inliers alone has come up with this probability."""
        weights = consensus.rows.mean_weights
        inliers = consensus.ratios(model) < 1.0
        share = float(inliers.mean() if weights is None else inliers @ weights / weights.sum())
        return trials_needed(share, consensus.problem.minimal_size, confidence)


_UNIFORM = Uniform()


class LocalOptimiser(ABC):
    """How a model that is better than all before is improved."""

    @abstractmethod
    def models(self, consensus: Consensus, model: Array, rng: np.random.Generator) -> Array:
        """Models (K, *shape) near this one, some of which may be NaN; the best of them is kept if it is as good."""


@dataclass(frozen=True)
class Reweighting(LocalOptimiser):
    """Iteratively reweighted least squares with the weights of MAGSAC++ (sigma-consensus++, Barath et al. 2020).

    The largest noise shrinks to that of the score in the first half of the steps, so that a model that is off is drawn
    in; the paper has one largest noise for all.

    Parameters
    ----------
    score : Marginalised
    steps : int
        Fits, at least 1.
    widest : float
        The first largest noise, in units of the score's; 1 as published.
    """

    score: Marginalised = _MARGINALISED
    steps: int = 10
    widest: float = 4.0

    def __post_init__(self) -> None:
        if not isinstance(self.score, Marginalised):
            raise TypeError(f"score must be a Marginalised, whose weights the fits have, got {shown(self.score)}")
        steps = as_whole(self.steps)
        if steps is None or steps < 1:
            raise ValueError(f"steps must be a whole number of at least 1, got {shown(self.steps)}")
        if not 1.0 <= as_real(self.widest) < np.inf:
            raise ValueError(f"widest must be a number of at least 1, got {shown(self.widest)}")

    def models(self, consensus: Consensus, model: Array, rng: np.random.Generator) -> Array:
        found, half = [model], self.steps // 2
        for width in (*np.geomspace(self.widest, 1.0, half), *np.ones(self.steps - half)):
            ratios = consensus.ratios(found[-1]) / width
            fitted = consensus.fitted(found[-1], np.where(ratios < 1.0, self.score.weights(ratios), 0.0))
            if not np.isfinite(fitted).all():
                break
            found.append(fitted)
        return np.stack(found)


@dataclass(frozen=True)
class Usac(Estimator):
    """Sample consensus of these parts; rows are drawn, and count in the score, by their weights if they have some.

    Minimal samples are drawn in batches of 64. If the best model of a batch is better than all that were drawn before,
    it is improved, and the best model of all is kept.

    Parameters
    ----------
    iterations : int
        Minimal samples; at most so many if `confidence` is given.
    confidence : float or None
        With which probability the best model has been found when the search ends before; None never ends it early.
    score : Score
        What makes a model the best.
    optimiser : LocalOptimiser or None
    sampler : Sampler
    eager : bool
        Improve the best model of every batch: several times the work, and a right model is found more often if few
        rows are inliers.

    Examples
    --------
    >>> Usac(score=Marginalised(), optimiser=InnerRansac(), sampler=Progressive())
    """

    iterations: int = 5000
    confidence: float | None = 0.99
    score: Score = _INLIERS
    optimiser: LocalOptimiser | None = None
    sampler: Sampler = _UNIFORM
    eager: bool = False

    def __post_init__(self) -> None:
        iterations = as_whole(self.iterations)
        if iterations is None or iterations < 1:
            raise ValueError(f"iterations must be a whole number of at least 1, got {shown(self.iterations)}")
        if self.confidence is not None and not 0.0 < as_real(self.confidence) < 1.0:
            raise ValueError(f"confidence must be None or between 0 and 1, got {shown(self.confidence)}")
        if not isinstance(self.eager, bool):
            raise TypeError(f"eager must be True or False, got {shown(self.eager)}")
        for name, kind in (("score", Score), ("optimiser", LocalOptimiser | None), ("sampler", Sampler)):
            if not isinstance(getattr(self, name), kind):
                word = name if name == "score" else "local optimiser" if name == "optimiser" else name
                raise TypeError(f"{name} must be a {word} of a class of nonsac, got {shown(getattr(self, name))}")

    @property
    def needs_weights(self) -> bool:
        return self.sampler.needs_weights

    def estimate(self, problem: Problem, rows: Rows, noise: Noise, rng: np.random.Generator) -> Hypothesis:
        consensus = Consensus(problem, rows, noise.threshold, self.score)
        why_not = self.sampler.why_not(rows)
        if why_not or len(rows) < problem.minimal_size:
            return _none(consensus, 0, why_not)
        model, score, highest, tested, drawn = problem.no_model, 0.0, 0.0, 0, 0
        needed = self.iterations
        while drawn < needed:
            size = min(_BATCH, needed - drawn)
            numbers = self.sampler.draw(rows, problem.minimal_size, drawn, size, rng)
            models = solved(problem, gathered(rows.values, numbers))
            drawn, tested = drawn + size, tested + len(models)
            found = consensus.best(models, 0.0 if self.eager else highest) if len(models) else None
            if found is None:
                continue
            highest, candidates = max(highest, found[1]), models[found[0]][None]
            if self.optimiser is not None:
                near = self.optimiser.models(consensus, candidates[0], rng)
                candidates, tested = np.concatenate([near, candidates]), tested + len(near)  # of equals the first wins
            better = consensus.best(_finite(candidates), score)
            if better is None:
                continue
            model, score = _finite(candidates)[better[0]], better[1]
            if self.confidence is not None:
                needed = min(needed, self.sampler.needed(consensus, model, self.confidence))
        if not np.isfinite(model).all():
            return _none(consensus, tested)
        return Hypothesis(model, problem.residuals(model[None], rows.values)[0], noise.threshold, tested=tested)

    def with_budget(self, factor: int) -> Self:
        return replace(self, iterations=self.iterations * factor)


def _none(consensus: Consensus, tested: int, fault: str = "") -> Hypothesis:
    residuals = np.full(len(consensus.rows), np.inf)
    return Hypothesis(consensus.problem.no_model, residuals, consensus.threshold, tested=tested, fault=fault)


def _finite(models: Array) -> Array:
    return models[np.isfinite(models.reshape(len(models), -1)).all(axis=1)]


def msac(problem: Problem) -> Usac:
    """MSAC (Torr and Zisserman 2000)."""
    return Usac(score=Truncated())


def magsac(problem: Problem) -> Usac:
    """MAGSAC++ (Barath, Noskova, Ivashechkin and Matas 2020)."""
    return Usac(score=Marginalised(), optimiser=Reweighting(), eager=True)
