"""SC2-PCR: seeds by spectral score, and the rows that share the most neighbours with them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.consistency_graph import ConsistencyGraph
from nonsac.estimators.pair_core import PairCore, fitted_motions
from nonsac.kernels.consistency_graph import local_maxima
from nonsac.layouts import Array
from nonsac.problems.contract import Problem

_POWER_ITERATIONS = 10
_BLOCK = 200  # seeds at a time


@dataclass(frozen=True)
class Sc2Pcr(PairCore):
    """SC2-PCR (Chen, Sun, Yang and Tao, "SC2-PCR: a second order spatial compatibility for efficient and robust point
    cloud registration", CVPR 2022), from the paper.

    Two rows are as compatible as they have common neighbours in the graph of equal distances (Eq. 5). Seeds are the
    local maxima of the leading eigenvector (Sec. 3.3). The rows most compatible with a seed make its first set, those
    most compatible within that set the second one (Sec. 3.4), which is fitted with the leading eigenvector of its
    own compatibilities as weights (Sec. 3.5). The motion with the most inliers wins.

    For a known scale. Memory grows with the square of the rows searched (10,000 at most, 260 MB), time with its product
    with the mean number of neighbours.

    Parameters
    ----------
    tolerance : float
        Rows are consistent if their distances differ by less, in inlier thresholds.
    seeds : float
        Share of the rows that are seeds, at most.
    first, second : int
        Rows of the two consensus sets of a seed.
    """

    tolerance: float = 0.6
    seeds: float = 0.2
    first: int = 30
    second: int = 20

    def with_budget(self, factor: int) -> Self:
        """More seeds."""
        return replace(self, seeds=min(1.0, self.seeds * factor))

    def candidates(self, pairs: Array, free_scale: bool, rng: np.random.Generator) -> tuple[Array, int]:
        graph = ConsistencyGraph.of(pairs, self.tolerance)
        seeds = self._seeds(pairs, graph)
        if not len(seeds):
            return np.empty((0, 3, 4)), graph.compared
        blocks = [seeds[start : start + _BLOCK] for start in range(0, len(seeds), _BLOCK)]
        members = np.vstack([self._first_sets(graph, block) for block in blocks])
        members, used = self._second_sets(graph, members)
        weights = _spectral_weights(pairs[members], self.tolerance) * used
        return fitted_motions(pairs, list(members), list(weights)), graph.compared + len(seeds)

    def _seeds(self, pairs: Array, graph: ConsistencyGraph) -> NDArray[np.int64]:
        """Rows of high spectral score, of which none has a higher one beside it."""
        scores = graph.leading_eigenvector()
        order = np.argsort(-scores, kind="stable")
        order = order[scores[order] > 0.0]
        is_maximum = np.zeros(len(pairs), np.bool_)
        local_maxima(np.ascontiguousarray(pairs[:, :3]), order, 1.0, is_maximum)
        return order[is_maximum[order]][: max(1, round(self.seeds * len(pairs)))]

    def _first_sets(self, graph: ConsistencyGraph, seeds: NDArray[np.int64]) -> NDArray[np.int64]:
        """Each seed and the rows most compatible with it (S, k)."""
        k = min(self.first, len(graph) - 1)
        compatible = graph.common[seeds]
        nearest = np.argpartition(compatible, len(graph) - k, axis=1)[:, len(graph) - k :]
        order = np.argsort(-np.take_along_axis(compatible, nearest, axis=1).astype(np.int64), axis=1, kind="stable")
        return np.column_stack([seeds, np.take_along_axis(nearest, order, axis=1)])

    def _second_sets(
        self, graph: ConsistencyGraph, members: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """The members most compatible with their seed within its set, and which of them are so at all."""
        connected = graph.connected(members).astype(np.float64)
        common = connected[:, 0] * (connected[:, :1] @ connected)[:, 0]
        common[:, 0] = np.inf  # the seed itself
        order = np.argsort(-common, axis=1, kind="stable")[:, : self.second]
        return np.take_along_axis(members, order, axis=1), np.take_along_axis(common, order, axis=1) > 0.0


def _spectral_weights(pairs: Array, tolerance: float) -> Array:
    """Leading eigenvectors (S, k) of how well the distances within sets of pairs (S, k, 6) agree (Eq. 1)."""
    first, second = (
        np.linalg.norm(half[:, :, None] - half[:, None], axis=-1) for half in (pairs[..., :3], pairs[..., 3:])
    )
    agreement = np.maximum(0.0, 1.0 - ((first - second) / tolerance) ** 2)
    weights = np.ones(pairs.shape[:2])
    for _ in range(_POWER_ITERATIONS):
        weights = (agreement @ weights[..., None])[..., 0]
        weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return weights


def default(problem: Problem) -> Sc2Pcr:
    return Sc2Pcr()
