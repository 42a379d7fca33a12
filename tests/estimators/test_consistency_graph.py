import numpy as np
import pytest

import naive
from nonsac.estimators.consistency_graph import ConsistencyGraph


@pytest.fixture
def graph(rng):
    rows = naive.matching_rows(rng, 150, naive.random_model(rng), noise=0.01)
    rows[50:, 3:] = rng.standard_normal((100, 3))
    return ConsistencyGraph.of(rows / 0.05, 1.0)


def test_right_rows_are_connected_and_share_their_neighbours(graph):
    right = np.arange(50)
    connected = graph.connected(right)
    assert connected.sum() > 0.99 * 50 * 49
    assert not connected.diagonal().any()
    assert graph.compared == 150 * 149 // 2
    assert graph.common[:50, :50][connected].min() > 35
    assert np.median(graph.common[50:, 50:]) < 10
    assert graph.degrees[:50].min() > graph.degrees[50:].max()


def test_connections_of_several_sets_are_those_of_each(graph, rng):
    sets = rng.integers(0, 150, (4, 7))
    together = graph.connected(sets)
    whole = graph.connected(np.arange(150))
    np.testing.assert_array_equal(whole, whole.T)
    for numbers, connected in zip(sets, together, strict=True):
        np.testing.assert_array_equal(connected, whole[np.ix_(numbers, numbers)])


def test_the_eigenvector_is_that_of_numpy(graph):
    vector = graph.leading_eigenvector()
    _, vectors = np.linalg.eigh(graph.common.astype(float))
    np.testing.assert_allclose(vector, np.abs(vectors[:, -1]), atol=1e-3)
    assert set(np.argsort(-vector)[:50]) == set(range(50))


def test_a_graph_without_edges_has_no_eigenvector(rng):
    graph = ConsistencyGraph.of(rng.uniform(-1e3, 1e3, (10, 6)), 1e-3)
    np.testing.assert_array_equal(graph.leading_eigenvector(), np.zeros(10))
