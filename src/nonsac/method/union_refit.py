"""The default refiner: search where the samples' findings meet, compare, and fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nonsac.estimators.contract import checked_hypothesis
from nonsac.layouts import Array, Rows
from nonsac.method.mixture import mixture_fit
from nonsac.method.refine import Refinement, Refiner
from nonsac.method.residuals import Residuals, measured_noise
from nonsac.method.search import Search
from nonsac.problems.contract import ContractBroken, Problem
from nonsac.problems.fits import biweight_costs, cheapest, reweighted_fit
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis

_NEARLY = 0.98


@dataclass(frozen=True)
class UnionRefit(Refiner):
    """All hypotheses rescored on the union of the samples' rows, the best refitted there, the best of these chosen.

    Before that, the estimator searches once more where the samples' findings meet, if it can (`search_jointly`).
    Scores and fits use Tukey's biweight at the inlier threshold, so that what is compared is what the fits make small.
    The winner may then be fitted to more rows than the samples hold, which costs little and makes it more accurate. If
    the data allow a second model (two poses of a planar scene), that one is tried, too. The last fit weights each row
    by its probability of being an inlier.

    Parameters
    ----------
    candidates : int
        Hypotheses that are refitted.
    iterations : int
        Of a refit.
    polish_rows : int
        Rows that the winner is fitted to in the end, at least; all rows if there are fewer.
    """

    candidates: int = 4
    iterations: int = 20
    polish_rows: int = 0

    def refine(self, search: Search, winner: int) -> Refinement:
        problem, noise, rows = search.problem, search.noise, search.union()
        hypotheses = [*search.hypotheses, *_found_jointly(search)]
        models = np.stack([h.model for h in hypotheses if h.found])
        chosen = models[cheapest(problem, models, rows, noise.threshold, self.candidates)]
        fitted = [reweighted_fit(problem, model, rows, noise.threshold, self.iterations) for model in chosen]
        both = np.concatenate([chosen, np.stack(fitted)])
        best = both[int(np.argmin(biweight_costs(problem, both, rows, noise.threshold)))]
        best = self._best_twin(problem, self._converged(problem, best, rows, noise.threshold), rows, noise)
        more = search.union(self.polish_rows)
        if len(more) > len(rows):
            best = reweighted_fit(problem, best, more, noise.threshold, self.iterations)
        return Refinement.of(search, _finished(problem, best, more, noise), hypotheses, self.polish_rows)

    def _best_twin(self, problem: Problem, model: Array, rows: Rows, noise: Noise) -> Array:
        """The model, or one of those that a special case of the data allows besides, whichever fits best."""
        for _ in range(3):
            inliers = rows.values[problem.residuals(model[None], rows.values)[0] < noise.threshold]
            if len(inliers) < problem.minimal_size:
                break
            twins = problem.twins(model, inliers, noise)
            if not len(twins):
                break
            both = np.stack([model, *(self._converged(problem, twin, rows, noise.threshold) for twin in twins)])
            best = int(np.argmin(biweight_costs(problem, both, rows, noise.threshold)))
            if best == 0:
                break
            model = both[best]
        return model

    def _converged(self, problem: Problem, model: Array, rows: Rows, threshold: float) -> Array:
        """The model fitted again, to the rows that are near it now, until that gains nothing."""
        cost = biweight_costs(problem, model[None], rows, threshold)[0]
        for _ in range(5):
            fitted = reweighted_fit(problem, model, rows, threshold, self.iterations)
            before, cost = cost, biweight_costs(problem, fitted[None], rows, threshold)[0]
            if not cost < before:
                break
            model = fitted
            if before - cost < 1e-6 * before:
                break
        return model


def _found_jointly(search: Search) -> list[Hypothesis]:
    """What the estimator finds in one more search, over all samples, if it can search like this."""
    task = search.task
    rng = np.random.default_rng([task.seed, task.number, 1])
    try:
        found = task.estimator.search_jointly(search.problem, search.hypotheses, search.union(), search.noise, rng)
    except ContractBroken:
        raise
    except Exception:  # of somebody's estimator: the samples' own findings are there
        return []
    return [] if found is None else [checked_hypothesis(found, search.problem, task.estimator, "search_jointly")]


def _finished(problem: Problem, model: Array, rows: Rows, noise: Noise) -> Array:
    """The model after a last fit, at the noise that its inliers show; as it was if they lose by that."""
    residuals = Residuals.of(problem, model, rows)
    sigma = min(measured_noise(residuals, noise.threshold, problem.residual_dimension), noise.sigma)
    if not sigma > 0.0:
        return model
    fitted = mixture_fit(problem, model, rows, residuals, sigma)
    support = len(rows) - biweight_costs(problem, np.stack([model, fitted]), rows, noise.threshold)
    return fitted if support[1] > _NEARLY * support[0] else model
