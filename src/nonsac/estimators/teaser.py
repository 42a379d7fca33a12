"""TEASER++: scale by voting, the largest clique of consistent rows, then rotation and translation of it, robustly."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.consistency_graph import ConsistencyGraph
from nonsac.estimators.pair_core import PairCore
from nonsac.kernels.max_clique import largest_clique, peel
from nonsac.layouts import Array
from nonsac.problems.contract import Problem

_VOTES = 500_000  # distances that vote for the scale
_TURNED = 2000  # differences of points that the rotation is found from
_MOST_CONNECTED = 2000
_GROWTH, _ITERATIONS, _CONVERGED = 1.4, 100, 1e-6


@dataclass(frozen=True)
class Teaser(PairCore):
    """TEASER++ (Yang, Shi and Carlone, "TEASER: fast and certifiable point cloud registration", T-RO 2021), from the
    paper; without the certificate of Sec. VII.

    Differences of points do not depend on the translation, and their lengths not on the rotation (Sec. IV). If the
    scale is free, the ratios of lengths vote for it (Sec. V.A). The rows of the largest clique in the graph of equal
    lengths are kept (Sec. V.B); the rotation of their differences is found by graduated non-convexity with truncated
    least squares (Sec. VI; Yang et al., RA-L 2020), and each coordinate of the translation by a vote (Sec. V.C).

    The largest clique is searched by branch and bound with a budget; the largest one found by then is taken, as is a
    greedy one if each row of it has more than 2,000 neighbours (the authors', too, then take a bound for it). Rows
    vote with at most 500,000 distances. Memory grows with the square of the rows searched: 10,000 at most, 60 MB.

    Parameters
    ----------
    tolerance : float
        Rows are consistent if their distances differ by less, in inlier thresholds: the bound for the noise of a
        length.
    budget : int
        Words of 64 edges that the search for the clique may look at: a second takes some 10^9.
    """

    tolerance: float = 0.85
    budget: int = 200_000_000
    finds_scale: ClassVar[bool] = True

    def with_budget(self, factor: int) -> Self:
        return replace(self, budget=self.budget * factor)

    def candidates(self, pairs: Array, free_scale: bool, rng: np.random.Generator) -> tuple[Array, int]:
        none, scale = np.empty((0, 3, 4)), 1.0
        if free_scale:
            scale = self._scale(pairs, rng)
            pairs = pairs * [scale, scale, scale, 1.0, 1.0, 1.0]
        graph = ConsistencyGraph.of(pairs, self.tolerance)
        clique = pairs[maximum_clique(graph, self.budget)[0]]
        if len(clique) < 3:
            return none, graph.compared
        rotation = _rotation(clique, np.sqrt(2.0))
        if rotation is None:
            return none, graph.compared
        shifts = clique[:, 3:] - clique[:, :3] @ rotation.T
        translation = [vote(shift, np.ones(len(shift))) for shift in shifts.T]
        return np.column_stack([scale * rotation, translation])[None], graph.compared

    def _scale(self, pairs: Array, rng: np.random.Generator) -> float:
        """The scale that most ratios of distances are near, each within what the noise can do to it; 1 if none is."""
        first, second = np.triu_indices(len(pairs), 1)
        if len(first) > _VOTES:
            some = rng.choice(len(first), _VOTES, replace=False, shuffle=False)
            first, second = first[some], second[some]
        before, after = (np.linalg.norm((half[first] - half[second]), axis=1) for half in (pairs[:, :3], pairs[:, 3:]))
        before, after = before[before > 0.0], after[before > 0.0]
        return vote(after / before, self.tolerance / before) or 1.0 if len(before) else 1.0


def maximum_clique(graph: ConsistencyGraph, budget: int) -> tuple[NDArray[np.int64], bool]:
    """Rows of the largest clique that a budget of words finds, and whether it is proven that none is larger."""
    order, cores = np.empty(len(graph), np.int64), np.empty(len(graph), np.int64)
    peel(graph.words, order, cores)
    clique = np.empty(len(graph), np.int64)
    size, proven = largest_clique(graph.ordered(order).words, cores, _MOST_CONNECTED, budget, clique)
    return np.sort(order[clique[:size]]), bool(proven)


def vote(values: Array, bounds: Array) -> float:
    """The x of least sum of min(((value - x) / bound)^2, 1), by adaptive voting (Yang et al., Algorithm 2).

    The values within their bounds of x change where an interval begins or ends, and in between x is their mean.
    """
    middle = np.median(values)
    values = values - middle
    ends = np.concatenate([values - bounds, values + bounds])
    order = np.argsort(ends, kind="stable")
    step = np.where(order < len(values), 1.0, -1.0)
    at = order % len(values)
    weight = step * bounds[at] ** -2.0
    number, total = np.cumsum(step), np.cumsum(weight)
    first, second = np.cumsum(weight * values[at]), np.cumsum(weight * values[at] ** 2)
    inside = np.flatnonzero((number > 0.5) & (total > 0.0))
    mean = first[inside] / total[inside]
    best = int(np.argmin(second[inside] - mean * first[inside] - number[inside]))
    return float(middle + mean[best])


def _rotation(pairs: Array, bound: float) -> Array | None:
    """The rotation of least truncated squares between differences of the points of pairs; None if they have none."""
    n = len(pairs)
    offsets = range(1, min((n - 1) // 2, -(-_TURNED // n)) + 1)
    differences = np.concatenate([np.roll(pairs, -offset, axis=0) - pairs for offset in offsets])
    return graduated_rotation(differences[:, :3], differences[:, 3:], bound)


def graduated_rotation(first: Array, second: Array, bound: float) -> Array | None:
    """The R of least sum of min(|second - R first|^2 / bound^2, 1), by graduated non-convexity.

    Yang, Antonante, Tzoumas and Carlone, "Graduated non-convexity for robust spatial perception", RA-L 2020, Sec. III:
    from a convex surrogate of the loss on.
    """
    weights, mu, before = np.ones(len(first)), 0.0, np.inf
    rotation = None
    for iteration in range(_ITERATIONS):
        rotation = _aligned(first, second, weights)
        if rotation is None:
            return None
        squares = ((second - first @ rotation.T) ** 2).sum(axis=1) / bound**2
        cost = weights @ squares
        largest = squares.max()
        if largest <= 1.0 or abs(cost - before) < _CONVERGED * max(cost, _CONVERGED):
            break
        mu = 1.0 / (2.0 * largest - 1.0) if iteration == 0 else _GROWTH * mu
        weights = surrogate_weights(squares, mu)
        before = cost
    return rotation


def surrogate_weights(squares: Array, mu: float) -> Array:
    """The weights w that make w r^2 + mu (1 - w) / (mu + w) small (Yang et al. 2020, Eq. 13 and 14), bounds being 1.

    With mu near 0 the loss is convex, with a large one it is that of truncated least squares.
    """
    return np.clip(np.sqrt(mu * (mu + 1.0) / np.maximum(squares, 1e-30)) - mu, 0.0, 1.0)


def _aligned(first: Array, second: Array, weights: Array) -> Array | None:
    """The rotation of least weighted squares (Wahba's problem); None if vectors on one line leave it open."""
    left, strengths, right = np.linalg.svd((second * weights[:, None]).T @ first)
    if not strengths[1] > 1e-9 * strengths[0]:
        return None
    left[:, 2] *= np.linalg.det(left) * np.linalg.det(right)
    return np.asarray(left @ right)


def default(problem: Problem) -> Teaser:
    return Teaser()
