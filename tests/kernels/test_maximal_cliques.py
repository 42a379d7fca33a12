"""The heaviest maximal clique of each row, against all of them."""

import numpy as np
import pytest

from graph_samples import is_clique, random_edges, words_of
from nonsac.kernels.max_clique import peel
from nonsac.kernels.maximal_cliques import heaviest_cliques


def all_maximal_cliques(edges):
    """Every clique grown from its lowest row that no other row could join."""
    n, found = len(edges), []

    def grow(clique, shared):
        if not shared.any():
            found.append(tuple(clique))
        for i in np.flatnonzero(shared[clique[-1] + 1 :]) + clique[-1] + 1:
            grow([*clique, i], shared & edges[i])

    for i in range(n):
        grow([i], edges[i])
    return found


def weight_of(counts, clique):
    return int(counts[np.ix_(clique, clique)].sum()) // 2


def searched(edges, counts, budget=10**8, each=10**8, room=(10_000, 100_000)):
    n = len(edges)
    order, cores = np.empty(n, np.int64), np.empty(n, np.int64)
    peel(words_of(edges), order, cores)
    swapped = np.ix_(order, order)
    heaviest, owners = np.empty(n, np.int64), np.empty(n, np.int64)
    starts, rows = np.empty(room[0], np.int64), np.empty(room[1], np.int64)
    counts = np.ascontiguousarray(counts[swapped])
    met = heaviest_cliques(words_of(edges[swapped]), counts, budget, each, heaviest, owners, starts, rows)
    cliques = [order[rows[starts[k] : starts[k + 1]]] if k >= 0 else None for k in owners]
    back = np.argsort(order)
    return heaviest[back], [cliques[k] for k in back], met


def random_counts(rng, edges):
    counts = np.triu(rng.integers(1, 1000, edges.shape), 1)
    return ((counts + counts.T) * edges).astype(np.uint16)


@pytest.mark.parametrize(("n", "share"), [(3, 1.0), (20, 0.5), (40, 0.3), (70, 0.15), (18, 0.85), (30, 0.02)])
def test_each_row_has_the_heaviest_clique_that_holds_it(rng, n, share):
    edges = random_edges(rng, n, share)
    counts = random_counts(rng, edges)
    heaviest, cliques, met = searched(edges, counts)
    every = [clique for clique in all_maximal_cliques(edges) if len(clique) >= 3]
    assert met == len(every)
    for row in range(n):
        expected = max((weight_of(counts, clique) for clique in every if row in clique), default=0)
        assert heaviest[row] == expected
        assert (cliques[row] is None) == (expected == 0)
        if expected:
            assert row in cliques[row]
            assert weight_of(counts, cliques[row]) == expected


@pytest.mark.parametrize("limits", [{"budget": 100}, {"each": 0}, {"room": (3, 100_000)}, {"room": (10_000, 12)}])
def test_a_search_without_time_or_room_gives_some_cliques(rng, limits):
    edges = random_edges(rng, 60, 0.5)
    counts = random_counts(rng, edges)
    heaviest, cliques, _ = searched(edges, counts, **limits)
    some = [(weight, clique) for weight, clique in zip(heaviest, cliques, strict=True) if clique is not None]
    assert 0 < len(some) <= 60
    for weight, clique in some:
        assert is_clique(edges, clique)
        assert weight_of(counts, clique) == weight
        assert not edges[clique].all(axis=0).any()
