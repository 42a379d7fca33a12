"""The graph of equal distances, against pairs looked at one by one."""

import numpy as np
import pytest

from graph_samples import random_edges, words_of
from nonsac.kernels import consistency_graph as kernels


def some_pairs(rng, n, share=0.3):
    """Pairs (N, 6) of which some are moved alike: in units of a tolerance of about 1."""
    pairs = rng.uniform(-5, 5, (n, 6))
    right = int(share * n)
    pairs[:right, 3:] = pairs[:right, [2, 0, 1]] + 0.2 * rng.standard_normal((right, 3))
    return pairs


def edges_one_by_one(pairs, tolerance):
    first, second = (np.linalg.norm(half[:, None] - half[None], axis=2) for half in (pairs[:, :3], pairs[:, 3:]))
    edges = np.abs(first - second) < tolerance
    np.fill_diagonal(edges, False)
    return edges


@pytest.mark.parametrize("n", [1, 2, 63, 64, 65, 511, 513, 1100])
def test_a_bit_is_an_edge(rng, n):
    pairs = some_pairs(rng, n).astype(np.float32).astype(np.float64)
    words = np.full((n, -(-n // 64)), 2**64 - 1, np.uint64)
    kernels.fill_consistency_graph(np.ascontiguousarray(pairs.T, np.float32), np.float32(1.0), words)
    expected = edges_one_by_one(pairs, 1.0)
    assert expected[:3].any() or n < 3
    difference = np.unpackbits(words.view(np.uint8), axis=1, bitorder="little")[:, :n] != expected
    assert difference.sum() <= 1e-5 * n * n  # single precision
    assert words_of(expected).shape == words.shape
    assert not np.unpackbits(words.view(np.uint8), axis=1, bitorder="little")[:, n:].any()


def test_infinite_rows_agree_with_none(rng):
    pairs = some_pairs(rng, 70)
    pairs[3, 1] = np.inf
    words = np.empty((70, 2), np.uint64)
    kernels.fill_consistency_graph(np.ascontiguousarray(pairs.T, np.float32), np.float32(1.0), words)
    assert not words[3].any()
    assert not (words[:, 0] >> np.uint64(3) & np.uint64(1)).any()


@pytest.mark.parametrize("n", [2, 64, 200])
def test_common_neighbours_are_those_of_the_matrix_product(rng, n):
    edges = random_edges(rng, n, 0.4)
    counts, degrees = np.full((n, n), 9, np.uint16), np.empty(n, np.int64)
    kernels.count_common_neighbours(words_of(edges), counts)
    kernels.count_edges(words_of(edges), degrees)
    np.testing.assert_array_equal(counts, edges * (edges.astype(int) @ edges.astype(int)))
    np.testing.assert_array_equal(degrees, edges.sum(axis=1))


def test_products_with_counts_are_those_of_numpy(rng):
    counts, vector = rng.integers(0, 60_000, (130, 130)).astype(np.uint16), rng.random(130, np.float32)
    product = np.empty(130, np.float32)
    kernels.multiply_counts(counts, vector, product)
    np.testing.assert_allclose(product, counts.astype(float) @ vector, rtol=1e-5)


def test_a_local_maximum_has_nothing_higher_beside_it(rng):
    points, order = rng.random((200, 3)), rng.permutation(200)
    found = np.zeros(200, np.bool_)
    kernels.local_maxima(points, order, 0.2, found)
    near = np.linalg.norm(points[:, None] - points[None], axis=2) < 0.2
    rank = np.argsort(order)
    expected = [not any(near[i, j] and rank[j] < rank[i] for j in range(200)) for i in range(200)]
    np.testing.assert_array_equal(found, expected)
    assert 10 < found.sum() < 190


def test_rows_in_another_order_are_the_same_graph(rng):
    edges, order = random_edges(rng, 130, 0.3), rng.permutation(130)
    ordered = np.full((130, 3), 2**64 - 1, np.uint64)
    kernels.order_rows(words_of(edges), order, ordered)
    np.testing.assert_array_equal(ordered, words_of(edges[np.ix_(order, order)]))
