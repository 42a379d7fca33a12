"""What the cores for matched 3D points share: units, the choice among candidates, the last fit."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.contract import Estimator
from nonsac.kernels.kabsch import fit_similarity
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, refitted
from nonsac.problems.fits import biweight_costs, reweighted_fit
from nonsac.problems.noise import Noise
from nonsac.problems.registration import Registration, centre
from nonsac.result import Hypothesis

MOST_ROWS = 10_000
_BLOCK = 2_000_000  # residuals at a time
_COMPARED = 10


class PairCore(Estimator):
    """A core that finds candidates for the motion of matched 3D points; derive a class to add one.

    Of more than 10,000 rows, so many are searched, and the model is fitted to all. The candidate with the most inliers
    is refitted to them, then with Tukey's biweight; if they determine no motion, there is none. Weights count there,
    not in the search.
    """

    finds_scale: ClassVar[bool] = False

    @abstractmethod
    def candidates(self, pairs: Array, free_scale: bool, rng: np.random.Generator) -> tuple[Array, int]:
        """Models (K, 3, 4) of at least three pairs (N, 6), and how many candidates they were chosen from.

        The pairs are near the origin, in units of the inlier threshold, and of the same scale unless it is free.
        """

    def check(self, problem: Problem) -> None:
        self._registration(problem)

    def _registration(self, problem: Problem) -> Registration:
        name = type(self).__name__
        if not isinstance(problem, Registration):
            raise TypeError(f"{name} estimates 3D registrations only, got {type(problem).__name__}")
        if problem.scale is None and not self.finds_scale:
            raise ValueError(f"{name} needs a known scale; pcr99, teaser and ransac, for three, find a free one")
        return problem

    def estimate(self, problem: Problem, rows: Rows, noise: Noise, rng: np.random.Generator) -> Hypothesis:
        registration, threshold = self._registration(problem), noise.threshold
        models, tested = np.empty((0, 3, 4)), 0
        if len(rows) >= problem.minimal_size:
            models, tested = self._in_its_units(registration, rows.some(MOST_ROWS), threshold, rng)
            models = models[np.isfinite(models).all(axis=(1, 2))]
        model = problem.no_model
        if len(models):
            best = self._best(problem, models, rows, threshold)
            inliers = problem.residuals(best[None], rows.values)[0] < threshold
            model = refitted(problem, best, rows.values, rows.times(inliers.astype(np.float64)))
        if not np.isfinite(model).all():
            return Hypothesis(problem.no_model, np.full(len(rows), np.inf), threshold, tested=tested)
        model = reweighted_fit(problem, model, rows, threshold, 10)
        return Hypothesis(model, problem.residuals(model[None], rows.values)[0], threshold, tested=tested)

    def _in_its_units(
        self, problem: Registration, rows: Rows, threshold: float, rng: np.random.Generator
    ) -> tuple[Array, int]:
        """The candidates for rows as they are."""
        middle = centre(rows.values)
        pairs = (rows.values - middle) / threshold
        scale = problem.scale or _size(pairs[:, 3:]) / _size(pairs[:, :3])
        pairs[:, :3] *= scale
        found, tested = self.candidates(pairs, problem.scale is None, rng)
        models = np.array(found)
        models[:, :, :3] *= scale
        models[:, :, 3] = threshold * models[:, :, 3] + middle[3:] - models[:, :, :3] @ middle[:3]
        return models, tested

    def _best(self, problem: Problem, models: Array, rows: Rows, threshold: float) -> Array:
        """The candidate with the highest score; of equal ones, that with the least biweight cost."""
        size = max(1, _BLOCK // len(rows))
        scores = np.concatenate(
            [self.scores(problem, models[k : k + size], rows, threshold) for k in range(0, len(models), size)]
        )
        first = np.flatnonzero(scores == scores.max())[:_COMPARED]
        return models[first[int(np.argmin(biweight_costs(problem, models[first], rows, threshold)))]]

    def scores(self, problem: Problem, models: Array, rows: Rows, threshold: float) -> Array:
        """By which candidates are compared (K,): the number of inliers."""
        return problem.count_inliers(models, rows.values, threshold, rows.mean_weights).astype(np.float64)


def absolute_scores(problem: Problem, models: Array, rows: Rows, threshold: float) -> Array:
    """Scores that fall linearly from 1 for an exact row to 0 at the threshold (Zhang et al., MAC, Eq. 10: MAE)."""
    near = np.maximum(0.0, 1.0 - problem.residuals(models, rows.values) / threshold)
    weights = rows.mean_weights
    return near.sum(axis=1) if weights is None else near @ weights


def fitted_motions(pairs: Array, sets: list[NDArray[np.int64]], weights: list[Array] | None = None) -> Array:
    """The least-squares motion of each set of row numbers that determines one (K, 3, 4)."""
    models, count = np.empty((len(sets), 3, 4)), 0
    for k, members in enumerate(sets):
        share = np.ones(len(members)) if weights is None else weights[k]
        count += bool(fit_similarity(pairs[members], share, False, 1.0, models[count]))
    return models[:count]


def _size(points: Array) -> float:
    """Median distance of points (N, 3) from their middle, the origin; 1 if more than half of them are there."""
    size = float(np.median(np.linalg.norm(points, axis=1)))
    return size if size > 0.0 else 1.0
