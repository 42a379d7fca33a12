"""GORE: rows that cannot be among the most inliers are removed, with a guarantee, before the search."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.consistency_graph import ConsistencyGraph
from nonsac.estimators.pair_core import PairCore
from nonsac.estimators.ransac import minimal_samples
from nonsac.kernels.consistency_graph import count_common_neighbours
from nonsac.kernels.guaranteed_removal import bound_edges, rows_left
from nonsac.kernels.kabsch import fit_each
from nonsac.layouts import Array
from nonsac.problems.contract import Problem

_ERROR = 2.0  # of the difference of two inliers, in thresholds


@dataclass(frozen=True)
class Gore(PairCore):
    """GORE (Parra Bustos and Chin, "Guaranteed outlier removal for point cloud registration with correspondences",
    TPAMI 2018), from the paper: the variant for rotation and translation, then RANSAC.

    If a row is an inlier, its points fix the translation, and if another one is, the rotation but for an angle. Each
    row that may agree with both does so within an arc of angles, which is bounded from the errors of the three; the
    most arcs that overlap bound the inliers that hold both (Sec. 3: stabbing, within the bounds of spherical regions).
    The best motion met on the way is a lower bound, and rows that no bound above it leaves are removed: none of them
    is an inlier of the motion with the most. Minimal samples of the rows that are left make the candidates.

    For a known scale. Arcs beyond the budget are not looked at, and their rows stay. Memory grows with the square of
    the rows searched: 10,000 at most, 215 MB.

    Parameters
    ----------
    budget : int
        Arcs to look at: a second takes some 10^7.
    iterations : int
        Minimal samples of the rows that are left.
    """

    budget: int = 10_000_000
    iterations: int = 1000

    def with_budget(self, factor: int) -> Self:
        return replace(self, budget=self.budget * factor, iterations=self.iterations * factor)

    def candidates(self, pairs: Array, free_scale: bool, rng: np.random.Generator) -> tuple[Array, int]:
        graph = ConsistencyGraph.of(pairs, _ERROR)
        is_left, model, tested = guaranteed_removal(pairs, graph, self.budget)
        models = np.empty((self.iterations + 1, 3, 4))
        models[0], count = model, 1
        if is_left.sum() >= 3:
            left = pairs[is_left]
            samples = left[minimal_samples(len(left), 3, self.iterations, rng)]
            count += fit_each(samples, False, 1.0, models[1:])
        return models[:count], graph.compared + tested + self.iterations


def guaranteed_removal(pairs: Array, graph: ConsistencyGraph, budget: int) -> tuple[NDArray[np.bool_], Array, int]:
    """Which rows may be inliers of the motion with the most, the best motion met (NaN if none), and how many were."""
    pairs, bounds = np.ascontiguousarray(pairs), np.empty((len(pairs), len(pairs)), np.uint16)
    count_common_neighbours(graph.words, bounds)
    bounds += np.uint16(2)
    model, is_left = np.full((3, 4), np.nan), np.empty(len(pairs), np.bool_)
    order = np.argsort(-graph.degrees, kind="stable")
    lower, met = bound_edges(pairs, graph.words, order, _ERROR, budget, bounds, model)
    rows_left(graph.words, bounds, lower, is_left)
    return is_left, model, met


def default(problem: Problem) -> Gore:
    return Gore()
