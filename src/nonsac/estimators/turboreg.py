"""TurboReg: a motion from each of the best triangles on the best edges between consistent rows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.consistency_graph import ConsistencyGraph
from nonsac.estimators.pair_core import PairCore, absolute_scores
from nonsac.kernels.consistency_graph import best_triangles, strongest_edges
from nonsac.kernels.kabsch import fit_each
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem


@dataclass(frozen=True)
class TurboReg(PairCore):
    """TurboReg (Yan et al., "TurboReg: TurboClique for robust and efficient point cloud registration", ICCV 2025,
    arXiv 2507.01439), from the paper.

    Edges of the graph of equal distances weigh as much as their rows have common neighbours (Sec. 3.2). The heaviest
    ones are pivots, and each makes triangles with those later rows that add the most weight (Sec. 3.3). Each triangle
    gives a motion, and that with the least mean absolute error within the threshold wins (Sec. 3.4). After the graph,
    time is linear in the pivots.

    For a known scale. Memory grows with the square of the rows searched: 10,000 at most, 215 MB.

    Parameters
    ----------
    tolerance : float
        Rows are consistent if their distances differ by less, in inlier thresholds.
    pivots, triangles : int
        Edges, and triangles of each.
    """

    tolerance: float = 0.6
    pivots: int = 1000
    triangles: int = 2

    def with_budget(self, factor: int) -> Self:
        """More pivots."""
        return replace(self, pivots=self.pivots * factor)

    def candidates(self, pairs: Array, free_scale: bool, rng: np.random.Generator) -> tuple[Array, int]:
        graph = ConsistencyGraph.of(pairs, self.tolerance)
        found = pivoted_triangles(graph, self.pivots, self.triangles)
        models = np.empty((len(found), 3, 4))
        count = fit_each(pairs[found], False, 1.0, models)
        return models[:count], graph.compared + len(found)

    def scores(self, problem: Problem, models: Array, rows: Rows, threshold: float) -> Array:
        return absolute_scores(problem, models, rows, threshold)


def pivoted_triangles(graph: ConsistencyGraph, pivots: int, each: int) -> NDArray[np.int64]:
    """Row numbers (T, 3), ascending, of the heaviest triangles on each of the heaviest edges."""
    edges = np.empty((pivots, 2), np.int64)
    edges = edges[: strongest_edges(graph.common, edges)]
    triangles = np.empty((len(edges) * each, 3), np.int64)
    return triangles[: best_triangles(graph.words, graph.common, edges, each, triangles)]


def default(problem: Problem) -> TurboReg:
    return TurboReg()
