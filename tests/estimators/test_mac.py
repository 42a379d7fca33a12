import numpy as np

import naive
from nonsac.estimators.consistency_graph import ConsistencyGraph
from nonsac.estimators.mac import Mac, node_guided_cliques
from nonsac.layouts import Rows
from nonsac.problems import Noise, Registration
from nonsac.simulate import registration


def test_cliques_come_heaviest_first_and_each_once(rng):
    data = registration(300, 0.8, 0.01, rng)
    graph = ConsistencyGraph.of(np.hstack([data.source, data.target]) / 0.05, 0.6)
    cliques, met = node_guided_cliques(graph, 10**7)
    weights = [int(graph.common[np.ix_(clique, clique)].astype(int).sum()) for clique in cliques]
    assert weights == sorted(weights, reverse=True)
    assert len({tuple(clique) for clique in cliques}) == len(cliques)
    assert 20 < len(cliques) <= min(300, met)
    assert data.inliers[cliques[0]].all()
    for clique in cliques:
        assert len(clique) >= 3
        assert graph.connected(clique).sum() == len(clique) * (len(clique) - 1)


def test_finds_a_motion_that_the_largest_clique_does_not_hold(rng):
    """A looser constraint than the largest clique (Zhang et al., Sec. 1): every clique of it gives a candidate."""
    model, other = naive.random_model(rng, spread=0.5), naive.random_model(rng, spread=0.5)
    rows = np.vstack([naive.matching_rows(rng, 30, model, noise=0.01), naive.matching_rows(rng, 25, other, noise=0.01)])
    for first in (model, other):
        models, _ = Mac().candidates(rows / 0.05, False, rng)
        expected = np.column_stack([first[:, :3], first[:, 3] / 0.05])
        assert min(naive.angle_between(found, expected) for found in models) < 2.0


def test_solves_ninety_nine_wrong_of_a_hundred(rng):
    for seed in range(3):
        data = registration(1000, 0.99, 0.01, rng=seed)
        rows = Rows(np.ascontiguousarray(np.hstack([data.source, data.target])))
        found = Mac().estimate(Registration(), rows, Noise.given(0.01), rng)
        assert naive.angle_between(found.model, data.T) < 3.0


def test_a_dense_graph_is_searched_in_part(rng):
    data = registration(400, 0.1, 0.01, rng)
    rows = Rows(np.ascontiguousarray(np.hstack([data.source, data.target])))
    found = Mac(budget=10_000).estimate(Registration(), rows, Noise.given(0.01), rng)
    assert naive.angle_between(found.model, data.T) < 0.5
