"""Thresholds to choose from if the noise is not known, and how often wrong rows are within each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.ladder import best_on_ladder, likelihood_ratios
from nonsac.kernels.minimal_samples import distinct_rows
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, background, residuals_of, solved
from nonsac.problems.facts import Facts, Places
from nonsac.problems.noise import Noise
from nonsac.values import special

_RUNGS, BEYOND = 21, 4
# Shares of the residuals of wrong rows, from a 4,096th to a quarter, and on to all of them.
LADDER = np.asarray(2.0 ** (0.5 * np.arange(1 - _RUNGS - BEYOND, 1)), np.float64)
_COARSE = 4
_MODELS, _WRONG_ROWS = 50, 500
_OWN_WRONG_ROWS, _FACTS = 4000, 500
_COUNTED = 0.005


@dataclass(frozen=True, eq=False)
class Ladder:
    """Thresholds, each the square root of two times the one before.

    Attributes
    ----------
    thresholds : (L + 4,) float64
        The last four are the surroundings of those that may be chosen.
    chance : (L,) float64
        How often rows that match nothing are within them, of an average model.
    """

    thresholds: Array
    chance: Array

    @classmethod
    def of(cls, problem: Problem, rows: Rows, rng: np.random.Generator) -> Self | None:
        """Thresholds for some rows; None if no minimal sample of them gives a model, or rows have no extent."""
        if len(rows) <= problem.minimal_size:
            return None
        samples = np.empty((_MODELS, problem.minimal_size), np.int64)
        distinct_rows(rng.random(samples.shape), len(rows), samples)
        models = solved(problem, rows.values[samples])
        if not len(models):
            return None
        wrong = background(problem, rows, _WRONG_ROWS)
        residuals = residuals_of(problem, models, wrong).ravel()
        finite = residuals[np.isfinite(residuals)]
        unit = float(np.median(finite)) if len(finite) else 0.0
        if not 0.0 < unit < np.inf:
            return None
        return cls(unit * LADDER, _rates(residuals, unit * LADDER[:_RUNGS]))

    def coarse(self) -> list[float]:
        """Every fourth of the thresholds that may be chosen, from the largest down."""
        return [float(threshold) for threshold in self.thresholds[_RUNGS - 1 :: -_COARSE]]

    def counts(self, problem: Problem, models: Array, rows: Rows) -> NDArray[np.int64]:
        """Rows within each threshold, (M, L + 4)."""
        return problem.count_on_ladder(models, rows.values, self.thresholds)

    def best(self, problem: Problem, counts: NDArray[np.int64], rows: int) -> tuple[Array, NDArray[np.int64]]:
        """For each threshold how unlikely the best count is by chance (L,), and which model's it is."""
        scores, best = np.empty(_RUNGS), np.empty(_RUNGS, np.int64)
        best_on_ladder(counts, rows, problem.minimal_size, self.chance, problem.residual_dimension, scores, best)
        return scores, best


class Level(NamedTuple):
    """What a model comes to at a threshold.

    Attributes
    ----------
    threshold : float
    score : float
        Minus the logarithm of a bound of its chance.
    facts, rows : int
        Beyond a minimal sample.
    rate : float
        How often a row is within the threshold by chance.
    """

    threshold: float
    score: float
    facts: int
    rows: int
    rate: float

    @property
    def chance(self) -> float:
        """Probability of as many facts or more (a binomial tail)."""
        if self.facts <= 0:
            return 1.0
        return float(special.betainc(self.facts, max(self.rows - self.facts, 0) + 1, self.rate))


@dataclass(frozen=True, eq=False)
class Telling:
    """At which threshold models of some rows are least likely by chance, if inliers that say the same count once.

    Parameters
    ----------
    problem : Problem
    rows : Rows
    """

    problem: Problem
    rows: Rows

    def of(self, model: Array, thresholds: Array) -> Level:
        """The threshold at which a model is least likely by its own chance.

        As `best_on_ladder`, but with facts, and the chance of this model. The threshold is one of every other of those
        given. No facts are counted where even as many as there are inliers would mean less.
        """
        problem, values, fitted = self.problem, self.rows.values, self.problem.minimal_size
        residuals = residuals_of(problem, model[None], values)[0]
        counts = np.searchsorted(np.sort(residuals), thresholds)
        rates, counts = self._rates(model, thresholds, counts).tolist(), counts.tolist()
        rungs = [rung for rung in range(0, len(rates), 2) if counts[rung] > fitted]
        bounds = {rung: -log_chance(counts[rung] - fitted, len(values) - fitted, rates[rung]) for rung in rungs}
        best = Level(float(thresholds[0]), 0.0, 0, len(values) - fitted, 1.0)
        for rung in sorted(rungs, key=lambda rung: (-bounds[rung], rung)):
            if bounds[rung] <= best.score:
                break
            threshold = float(thresholds[rung])
            inliers = values[residuals < threshold]
            facts = Facts.of(model, inliers, len(values), Noise.within(threshold), self._places, _FACTS)
            count, rows = facts.count - fitted, facts.rows - fitted
            score = -log_chance(count, rows, rates[rung])
            if score > best.score:
                best = Level(threshold, score, count, rows, rates[rung])
        return best

    def likelihood(self, model: Array, thresholds: Array) -> tuple[float, float]:
        """How much likelier the rows are with inliers of a model than without, as a logarithm, and at which threshold.

        The likelihood of MLESAC (Torr and Zisserman, CVIU 2000), with chance in place of an even distribution. The
        thresholds go down; where background rows become too few to be counted, they are taken to be as dense as before.
        """
        problem, d = self.problem, self.problem.residual_dimension
        residuals = residuals_of(problem, model[None], self.rows.values)[0]
        rates, sizes = _rates(residuals_of(problem, model[None], self._wrong)[0], thresholds), thresholds**d
        counted = max(int(np.count_nonzero(rates > _COUNTED)) - 1, 0)
        chance = np.append(rates[:counted], rates[counted] * sizes[counted:] / sizes[counted])
        volume = math.pi ** (d / 2) / math.gamma(d / 2 + 1)
        peak = volume * Noise.given(1.0).threshold ** d / (2.0 * math.pi) ** (d / 2)
        ratios = np.empty(len(thresholds))
        likelihood_ratios(residuals, thresholds, chance, peak, problem.minimal_size, ratios)
        best = int(np.argmax(ratios))
        return float(ratios[best]), float(thresholds[best])

    def _rates(self, model: Array, thresholds: Array, counts: NDArray[np.int64]) -> Array:
        """How often rows are within all but the last thresholds by chance, or by what lies beside them."""
        own = _rates(residuals_of(self.problem, model[None], self._wrong)[0], thresholds[:-BEYOND])
        dimension = self.problem.residual_dimension
        for further in (2, BEYOND):
            more = counts[further : len(counts) - BEYOND + further] - counts[:-BEYOND] + 0.5
            own = np.maximum(own, more / (2.0 ** (further * dimension / 2) - 1.0) / len(self.rows))
        return own

    @cached_property
    def _wrong(self) -> Array:
        return background(self.problem, self.rows, _OWN_WRONG_ROWS)

    @cached_property
    def _places(self) -> Places:
        return Places.of(self.problem, self.rows.values)


def log_chance(inliers: int, rows: int, rate: float) -> float:
    """Upper bound of the logarithm of a binomial tail (Hoeffding 1963): 0 if there are no more than expected."""
    share = inliers / rows
    if not rate < share <= 1.0:
        return 0.0
    beyond = share * math.log(share / rate)
    return -rows * (beyond if share == 1.0 else beyond + (1.0 - share) * math.log((1.0 - share) / (1.0 - rate)))


def _rates(residuals: Array, thresholds: Array) -> Array:
    return np.asarray((np.searchsorted(np.sort(residuals), thresholds) + 0.5) / (len(residuals) + 1))
