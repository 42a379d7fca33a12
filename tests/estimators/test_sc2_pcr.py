"""SC2-PCR, against its steps done row by row."""

import numpy as np
import pytest

import naive
from nonsac.estimators.consistency_graph import ConsistencyGraph
from nonsac.estimators.sc2_pcr import Sc2Pcr, _spectral_weights
from nonsac.layouts import Rows
from nonsac.problems import Noise, Registration
from nonsac.simulate import registration


@pytest.fixture
def pairs(rng):
    rows = naive.matching_rows(rng, 120, naive.random_model(rng), noise=0.01)
    rows[40:, 3:] = rng.standard_normal((80, 3))
    return rows / 0.05


def test_consensus_sets_are_those_chosen_one_by_one(pairs):
    core, graph = Sc2Pcr(first=10, second=6), ConsistencyGraph.of(pairs, 0.6)
    seeds = np.array([3, 17, 60])
    sets = core._first_sets(graph, seeds)
    chosen, used = core._second_sets(graph, sets)
    edges = graph.connected(np.arange(120))
    for seed, members, second, right in zip(seeds, sets, chosen, used, strict=True):
        assert members[0] == second[0] == seed
        compatible = [edges[seed, i] * (edges[seed] & edges[i]).sum() for i in range(120)]
        assert sorted(compatible)[-10:] == sorted(compatible[i] for i in members[1:])
        local = [edges[seed, i] * sum(edges[seed, j] and edges[i, j] for j in members) for i in members]
        assert sorted(local)[-5:] == sorted(local[list(members).index(i)] for i in second[1:])
        assert right[1:].tolist() == [local[list(members).index(i)] > 0 for i in second[1:]]


def test_no_seed_is_beside_a_better_one(pairs):
    pairs[1] = pairs[0] + 0.1
    graph = ConsistencyGraph.of(pairs, 0.6)
    seeds, scores = Sc2Pcr()._seeds(pairs, graph), graph.leading_eigenvector()
    assert len(seeds) == 24
    assert len({0, 1} & set(seeds.tolist())) <= 1
    assert (np.diff(scores[seeds]) <= 0).all()
    assert set(seeds.tolist()) <= set(range(40))


def test_weights_are_the_leading_eigenvector_of_the_agreements(pairs):
    for chosen in (np.arange(12), np.r_[:9, 60:63]):
        first, second = (np.linalg.norm(h[:, None] - h[None], axis=2) for h in (pairs[chosen, :3], pairs[chosen, 3:]))
        agreement = np.maximum(0, 1 - (first - second) ** 2 / 0.36)
        expected = np.abs(np.linalg.eigh(agreement)[1][:, -1])
        np.testing.assert_allclose(_spectral_weights(pairs[chosen][None], 0.6)[0], expected, atol=0.02)


def test_solves_what_first_order_consistency_does_not(rng):
    """Second-order consistency tells right rows from wrong ones of which 99 % are (Chen et al., Sec. 3.2)."""
    right = 0
    for seed in range(5):
        data = registration(1000, 0.99, 0.01, rng=seed)
        rows = Rows(np.ascontiguousarray(np.hstack([data.source, data.target])))
        found = Sc2Pcr().estimate(Registration(), rows, Noise.given(0.01), rng)
        right += naive.angle_between(found.model, data.T) < 5.0
    assert right >= 4
