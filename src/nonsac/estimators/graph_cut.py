"""GC-RANSAC: rows are labelled together with their neighbours, by a minimum cut, and models fitted to the inliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow
from scipy.spatial import cKDTree

from nonsac.estimators.scores import Truncated
from nonsac.estimators.usac import Consensus, LocalOptimiser, Usac
from nonsac.layouts import Array, Layout, Rows
from nonsac.problems.contract import Problem
from nonsac.values.numeric import as_real, as_whole, shown

_FINENESS, _LARGEST_SUM = 10_000, 10**9  # capacities are whole numbers of 32 bits


@dataclass(frozen=True)
class GraphCut(LocalOptimiser):
    """Graph-cut local optimisation (Barath and Matas, "Graph-cut RANSAC", CVPR 2018, Sec. 3 and Algorithm 2).

    Rows are labelled inliers or outliers so that an energy of single rows and of neighbours is least; models are
    fitted to samples of the inliers; and both go on while that raises the score. Weights count in the fits and the
    score, not in the labels.

    Neighbours are the nearest rows, with the two things that a row matches scaled to the same spread: the paper takes
    all within 20 pixels, which means nothing for points and other units.

    Parameters
    ----------
    coherence : float
        Weight of the energy of neighbours, 0.14 as published.
    neighbours : int
        Of each row.
    sample_size : float
        Rows fitted at once, in minimal samples. The paper has 7; from a model that is off, many of whose inliers are
        wrong, fewer rows find the right one more often (docs/cores.md).
    samples : int
        Fitted for one labelling; the paper's algorithm takes one, its authors' code up to fifty.
    rounds : int
        Labellings at most.
    """

    coherence: float = 0.14
    neighbours: int = 6
    sample_size: float = 1.5
    samples: int = 10
    rounds: int = 10

    def __post_init__(self) -> None:
        if not 0.0 <= as_real(self.coherence) < np.inf:
            raise ValueError(f"coherence must be a number of at least 0, got {shown(self.coherence)}")
        if not 1.0 <= as_real(self.sample_size) < np.inf:
            raise ValueError(f"sample_size must be a number of at least 1, got {shown(self.sample_size)}")
        for name in ("neighbours", "samples", "rounds"):
            whole = as_whole(getattr(self, name))
            if whole is None or whole < 1:
                raise ValueError(f"{name} must be a whole number of at least 1, got {shown(getattr(self, name))}")

    def models(self, consensus: Consensus, model: Array, rng: np.random.Generator) -> Array:
        found, highest = [], float(consensus.scores(model[None])[0])
        edges = self._edges(consensus)
        for _ in range(self.rounds):
            inliers = np.flatnonzero(labels(consensus.ratios(model), edges, self.coherence))
            near = self._fitted(consensus, model, inliers, rng)
            best = consensus.best(near, highest) if len(near) else None
            if best is None:
                break
            found.append(near)
            model, highest = near[best[0]], best[1]
        return np.concatenate([np.empty((0, *consensus.problem.model_shape)), *found])

    def _fitted(
        self, consensus: Consensus, model: Array, inliers: NDArray[np.int64], rng: np.random.Generator
    ) -> Array:
        """The models of samples of inliers, and of all of them; those that are determined."""
        least = consensus.problem.minimal_size
        size, chosen = int(np.ceil(self.sample_size * least)), [inliers] if len(inliers) >= least else []
        if size < len(inliers):
            chosen += [rng.choice(inliers, size, replace=False) for _ in range(self.samples)]
        fitted = [consensus.fitted_to(model, numbers) for numbers in chosen]
        return np.reshape([each for each in fitted if np.isfinite(each).all()], (-1, *consensus.problem.model_shape))

    def _edges(self, consensus: Consensus) -> NDArray[np.int64]:
        rows, layout = consensus.rows, consensus.problem.layout
        return rows.kept(self, "edges", lambda: neighbourhood(rows, layout, self.neighbours))


def neighbourhood(rows: Rows, layout: Layout, most: int) -> NDArray[np.int64]:
    """Pairs (E, 2) of rows of which one is among the nearest of the other, each once."""
    if len(rows) < 2:
        return np.empty((0, 2), np.int64)
    points = np.hstack([part / (np.sqrt(part.var(axis=0).sum()) or 1.0) for part in layout.parts(rows.values)])
    nearest = cKDTree(points).query(points, min(most + 1, len(points)))[1]
    pairs = np.column_stack([np.repeat(np.arange(len(points)), nearest.shape[1]), nearest.ravel()])
    pairs = np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1)
    return np.unique(pairs, axis=0)


def labels(ratios: Array, edges: NDArray[np.int64], coherence: float) -> NDArray[np.bool_]:
    """Which rows are inliers in the labelling with the least energy (Sec. 3.1, eq. 4 to 6).

    With K = exp(-r^2 / 2), r in thresholds, an inlier costs 1 - K and an outlier K. A pair of neighbours costs 1 if
    their labels differ, the mean of K if both are outliers, and one minus the mean of K if both are inliers.

    All of it but a constant is a cost for each inlier, which may be negative, and one for labels that differ.
    """
    kernel, n = np.exp(-0.5 * np.square(np.where(np.isfinite(ratios), ratios, np.inf))), len(ratios)
    costs = 1.0 - 2.0 * kernel
    shared = 0.5 * coherence * (1.0 - kernel[edges].sum(axis=1))
    costs += np.bincount(edges.ravel(), np.repeat(shared, 2), minlength=n)
    source, sink, row = n, n + 1, np.arange(n)
    start = np.concatenate([np.where(costs < 0.0, source, row), edges[:, 0], edges[:, 1]])
    end = np.concatenate([np.where(costs < 0.0, row, sink), edges[:, 1], edges[:, 0]])
    capacity = np.concatenate([np.abs(costs), np.full(2 * len(edges), 0.5 * coherence)])
    fineness = min(_FINENESS, _LARGEST_SUM / max(float(capacity.sum()), 1.0))
    whole = np.rint(fineness * capacity).astype(np.int32)
    graph = csr_array(coo_array((whole, (start, end)), shape=(n + 2, n + 2)))
    left = csr_array(graph - maximum_flow(graph, source, sink).flow)
    left.eliminate_zeros()
    inliers = np.zeros(n + 2, np.bool_)
    inliers[breadth_first_order(left, source, return_predecessors=False)] = True
    return inliers[:n]


def gc_ransac(problem: Problem) -> Usac:
    """GC-RANSAC: the truncated quadratic score, and graph cuts for the best model of every batch."""
    return Usac(score=Truncated(), optimiser=GraphCut(), eager=True)
