"""Motions from pairs of oriented rows, ranked by how well they make two raw clouds overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from nonsac.clouds.overlap import Overlap, distinct
from nonsac.clouds.problem import OrientedRegistration
from nonsac.estimators.contract import Estimator
from nonsac.kernels.oriented_pairs import consistent_pairs
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, solved
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis


@dataclass(frozen=True)
class OrientedPairs(Estimator):
    """All pairs of a sample's rows that one rigid motion could explain become motions; the clouds decide among them.

    A row of all-to-all correspondences is right about once in a thousand times, so counting inlier rows says little.
    But every motion can be tested on the clouds themselves: the source's points, moved, should lie on the target.
    With a grid of nearest points that takes a fraction of a microsecond, so every candidate is tested. The best
    distinct ones are aligned further, and the one with the smallest truncated distances in both directions wins.
    The hypothesis' residuals are those distances, so that any scoring rule of the paper applies to them.

    Parameters
    ----------
    overlap : Overlap
        The two clouds.
    tolerance : float
        Largest difference of two chords' lengths, in the clouds' unit.
    smallest_distance : float
        Shorter chords are not used.
    max_pairs : int
        Pairs of rows that are turned into motions, at most.
    candidates : int
        Distinct motions that are aligned further.
    """

    overlap: Overlap
    tolerance: float
    smallest_distance: float
    max_pairs: int = 50_000
    candidates: int = 12

    @classmethod
    def for_overlap(cls, overlap: Overlap) -> OrientedPairs:
        """Tolerances from the spacing of the coarse points: matched points lie up to about half of it apart."""
        spacing = overlap.source.spacing
        return cls(overlap, tolerance=0.6 * spacing, smallest_distance=3.0 * spacing)

    def with_budget(self, factor: int) -> Self:
        return replace(self, max_pairs=self.max_pairs * factor, candidates=self.candidates * factor)

    def check(self, problem: Problem) -> None:
        self._registration(problem)

    def _registration(self, problem: Problem) -> OrientedRegistration:
        if not isinstance(problem, OrientedRegistration):
            raise TypeError(f"OrientedPairs needs the problem OrientedRegistration, got {type(problem).__name__}")
        return problem

    def estimate(self, problem: Problem, rows: Rows, noise: Noise, rng: np.random.Generator) -> Hypothesis:
        registration, threshold = self._registration(problem), noise.threshold
        values = rng.permutation(rows.values)  # the search may end early, and must not favour one side of the cloud
        motions = solved(registration, values[self._pairs(registration, values)])
        if not len(motions):
            size = len(self.overlap.source.coarse) + len(self.overlap.target.coarse)
            return Hypothesis(problem.no_model, np.full(size, np.inf), threshold, tested=0)
        best = self.overlap.best(motions, 10 * self.candidates)
        reach = self.overlap.reach
        best = best[distinct(best, 12.0, reach)[: self.candidates]]
        best = self.overlap.aligned(best)
        residuals = np.stack([self.overlap.residuals(model) for model in best])
        order = np.argsort(residuals.sum(axis=1), kind="stable")
        others = best[order]
        others = others[distinct(others, 12.0, reach)]
        first = order[0]
        return Hypothesis(best[first], residuals[first], threshold, alternatives=others[1:], tested=len(motions))

    def _pairs(self, problem: OrientedRegistration, rows: Array) -> np.ndarray:
        """Row numbers (P, 2) of the consistent pairs."""
        columns = np.ascontiguousarray(rows.T, np.float32)
        pairs = np.empty((self.max_pairs, 2), np.int32)
        tolerance, angle, smallest = (np.float32(x) for x in (self.tolerance, problem.angle, self.smallest_distance))
        return pairs[: consistent_pairs(columns, tolerance, angle, smallest, pairs)]


# Answers nearer to each other than this are one answer.
SAME_ANGLE = 8.0


@dataclass(frozen=True)
class Agreement:
    """Stop when several samples found the lowest-cost answer by themselves and nothing else comes near it.

    Parameters
    ----------
    reach : float
        Distance, in the clouds' unit, below which two answers are the same.
    count : int
        Samples that must agree.
    lead : float
        By how much the mean residual, as a share of the threshold, must be below that of any other answer.
    """

    reach: float
    count: int = 3
    lead: float = 0.03

    def __call__(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> bool:
        found = [h for h in hypotheses if h.found]
        if len(found) < self.count:
            return False
        models = np.stack([h.model for h in found])
        costs = np.array([h.residuals.mean() for h in found]) / found[0].threshold
        best = models[int(np.argmin(costs))]
        near = (problem.distance(models, best) < SAME_ANGLE) & (
            np.linalg.norm(models[:, :, 3] - best[:, 3], axis=1) < self.reach
        )
        others = costs[~near]
        return bool(near.sum() >= self.count and (others.size == 0 or others.min() - costs.min() > self.lead))
