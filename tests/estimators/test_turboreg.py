import numpy as np
import pytest

import naive
from graph_samples import random_edges, words_of
from nonsac.estimators.consistency_graph import ConsistencyGraph
from nonsac.estimators.turboreg import TurboReg, pivoted_triangles
from nonsac.layouts import Rows
from nonsac.problems import Noise, Registration
from nonsac.simulate import registration


@pytest.mark.parametrize(("pivots", "each"), [(1, 1), (7, 2), (40, 3), (10_000, 1000)])
def test_triangles_are_the_best_ones_on_the_best_edges(rng, pivots, each):
    graph = ConsistencyGraph(words_of(random_edges(rng, 70, 0.3)))
    common = graph.common.astype(int)
    edges = [(-common[i, j], i, j) for i in range(70) for j in range(i + 1, 70) if common[i, j]]
    chosen = sorted(edges)[:pivots]
    found = [tuple(triangle) for triangle in pivoted_triangles(graph, pivots, each)]
    assert len(set(found)) == len(found)
    for _, i, j in chosen:
        thirds = [k for k in range(j + 1, 70) if common[i, k] and common[j, k]]
        best = sorted(thirds, key=lambda k: -(common[i, k] + common[j, k]))[:each]
        assert [triangle for triangle in found if triangle[:2] == (i, j)] == [(i, j, k) for k in best]
    assert {triangle[:2] for triangle in found} <= {(i, j) for _, i, j in chosen}


def test_work_is_linear_in_the_pivots(rng):
    data = registration(500, 0.9, 0.01, rng)
    pairs = np.hstack([data.source, data.target]) / 0.05
    for pivots in (10, 100, 1000):
        models, tested = TurboReg(pivots=pivots).candidates(pairs, False, rng)
        assert pivots < len(models) <= 2 * pivots
        assert tested <= 500 * 499 // 2 + 2 * pivots


def test_solves_ninety_nine_wrong_of_a_hundred(rng):
    for seed in range(3):
        data = registration(1000, 0.99, 0.01, rng=seed)
        rows = Rows(np.ascontiguousarray(np.hstack([data.source, data.target])))
        found = TurboReg().estimate(Registration(), rows, Noise.given(0.01), rng)
        assert naive.angle_between(found.model, data.T) < 3.0
