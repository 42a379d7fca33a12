"""MAC: a motion from each of the heaviest maximal cliques of consistent rows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.consistency_graph import ConsistencyGraph
from nonsac.estimators.pair_core import PairCore, absolute_scores, fitted_motions
from nonsac.kernels.max_clique import peel
from nonsac.kernels.maximal_cliques import heaviest_cliques
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem

_NOTED, _MEMBERS = 50_000, 2_000_000  # cliques, and their rows in all


@dataclass(frozen=True)
class Mac(PairCore):
    """MAC (Zhang, Yang, Zhang and Zhang, "3D registration with maximal cliques", CVPR 2023), from the paper.

    The graph is that of equal distances, its edges weighted by the common neighbours of their rows (Sec. 3.2). Maximal
    cliques, of at least three rows, are searched (Sec. 3.3), and of those that hold a row the heaviest is kept
    (node-guided selection, Eq. 5). Each of the heaviest of them is fitted, rows counting alike, and the motion with the
    least mean absolute error within the threshold wins (Sec. 3.4, MAE).

    A dense graph has too many cliques for any computer, and the authors thin it; here the search has a budget, for all
    and for each row, and begins at the most connected rows. For a known scale. Memory grows with the square of the
    rows searched: 10,000 at most, 250 MB.

    Parameters
    ----------
    tolerance : float
        Rows are consistent if their distances differ by less, in inlier thresholds.
    cliques : int
        How many are fitted, at most.
    budget : int
        Words of 64 edges that the search may look at: a second takes some 10^9.
    """

    tolerance: float = 0.6
    cliques: int = 1000
    budget: int = 100_000_000

    def with_budget(self, factor: int) -> Self:
        return replace(self, budget=self.budget * factor, cliques=self.cliques * factor)

    def candidates(self, pairs: Array, free_scale: bool, rng: np.random.Generator) -> tuple[Array, int]:
        graph = ConsistencyGraph.of(pairs, self.tolerance)
        cliques, met = node_guided_cliques(graph, self.budget)
        models = fitted_motions(pairs, cliques[: self.cliques])
        return models, graph.compared + met

    def scores(self, problem: Problem, models: Array, rows: Rows, threshold: float) -> Array:
        return absolute_scores(problem, models, rows, threshold)


def node_guided_cliques(graph: ConsistencyGraph, budget: int) -> tuple[list[NDArray[np.int64]], int]:
    """Of each row the heaviest maximal clique that was met with it, the heaviest first; and how many were met."""
    n = len(graph)
    order, cores = np.empty(n, np.int64), np.empty(n, np.int64)
    peel(graph.words, order, cores)
    graph = graph.ordered(order)
    heaviest, owners = np.empty(n, np.int64), np.empty(n, np.int64)
    starts, rows = np.empty(_NOTED, np.int64), np.empty(_MEMBERS, np.int64)
    met = heaviest_cliques(graph.words, graph.common, budget, budget // n, heaviest, owners, starts, rows)
    kept, first = np.unique(owners[owners >= 0], return_index=True)
    ranked = kept[np.argsort(-heaviest[owners >= 0][first], kind="stable")]
    return [np.sort(order[rows[starts[k] : starts[k + 1]]]) for k in ranked], met


def default(problem: Problem) -> Mac:
    return Mac()
