"""The largest clique, against a search that leaves nothing out."""

import numpy as np
import pytest

from graph_samples import is_clique, random_edges, words_of
from nonsac.kernels import max_clique as kernels


def size_of_largest(edges, chosen=0, candidates=None):
    """By trying every row in turn, with those after it."""
    candidates = np.ones(len(edges), bool) if candidates is None else candidates
    best = chosen
    for i in np.flatnonzero(candidates):
        best = max(best, size_of_largest(edges, chosen + 1, candidates & edges[i] & (np.arange(len(edges)) > i)))
    return best


def largest(edges, most=2000, budget=10**9):
    words, n = words_of(edges), len(edges)
    order, cores, clique = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    kernels.peel(words, order, cores)
    ordered = words_of(edges[np.ix_(order, order)])
    size, proven = kernels.largest_clique(ordered, cores, most, budget, clique)
    return order[clique[:size]], proven


def core_numbers(edges):
    """The largest k such that a row stays if all with fewer than k neighbours are left away until none has."""
    cores = np.zeros(len(edges), int)
    for k in range(len(edges)):
        left = np.ones(len(edges), bool)
        while (weak := left & (edges @ left.astype(int) < k)).any():
            left &= ~weak
        cores[left] = k
    return cores


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_rows_are_peeled_by_their_core_numbers(rng, share):
    edges = random_edges(rng, 70, share)
    order, cores = np.empty(70, np.int64), np.empty(70, np.int64)
    kernels.peel(words_of(edges), order, cores)
    assert sorted(order) == list(range(70))
    np.testing.assert_array_equal(np.minimum.accumulate(cores), cores)
    np.testing.assert_array_equal(cores, core_numbers(edges)[order])
    later = [edges[row, order[:place]].sum() for place, row in enumerate(order)]
    assert (later <= cores).all()


@pytest.mark.parametrize(("n", "share"), [(1, 0.5), (30, 0.0), (40, 0.2), (66, 0.3), (40, 0.7), (16, 0.95), (90, 0.2)])
def test_no_clique_is_larger(rng, n, share):
    for _ in range(4):
        edges = random_edges(rng, n, share)
        rows, proven = largest(edges)
        assert proven
        assert len(set(rows.tolist())) == len(rows) == size_of_largest(edges)
        assert is_clique(edges, rows)


def test_a_planted_clique_is_found_where_greedy_ones_miss_it(rng):
    edges = random_edges(rng, 400, 0.3)
    planted = np.sort(rng.choice(400, 16, replace=False))
    edges[np.ix_(planted, planted)] = ~np.eye(16, dtype=bool)
    rows, proven = largest(edges)
    assert proven
    np.testing.assert_array_equal(np.sort(rows), planted)


def test_a_search_without_time_gives_a_clique_that_is_not_proven(rng):
    edges = random_edges(rng, 200, 0.7)
    for most, budget in ((2000, 1000), (2000, 20_000), (5, 10**9)):
        rows, proven = largest(edges, most, budget)
        assert not proven
        assert is_clique(edges, rows)
        assert len(rows) >= 5


def test_a_complete_graph_is_one_clique():
    rows, proven = largest(~np.eye(130, dtype=bool))
    assert sorted(rows) == list(range(130))
    assert proven
