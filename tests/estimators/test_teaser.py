"""The parts of TEASER++, against searches over a grid, and the whole against its published properties."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.estimators.consistency_graph import ConsistencyGraph
from nonsac.estimators.teaser import Teaser, graduated_rotation, maximum_clique, surrogate_weights, vote
from nonsac.layouts import Rows
from nonsac.problems import Noise, Registration
from nonsac.simulate import registration


def rows_of(data):
    return Rows(np.ascontiguousarray(np.hstack([data.source, data.target])))


def truncated_squares(x, values, bounds):
    return np.minimum(((values[:, None] - x) / bounds[:, None]) ** 2, 1.0).sum(axis=0)


@pytest.mark.parametrize("n", [1, 2, 3, 50])
def test_a_vote_has_the_least_truncated_squares_of_a_grid(rng, n):
    for _ in range(10):
        values, bounds = 1000.0 + 3.0 * rng.standard_normal(n), rng.uniform(0.1, 1.0, n)
        grid = 1000.0 + np.linspace(-10, 10, 20_001)
        found = np.array([vote(values, bounds)])
        best = truncated_squares(grid, values, bounds).min()
        assert truncated_squares(found, values, bounds)[0] <= best + 1e-6


def test_a_vote_is_the_mean_of_those_that_agree(rng):
    values = np.r_[5.0 + 0.01 * rng.standard_normal(30), rng.uniform(-100, 100, 70)]
    assert vote(values, np.full(100, 0.1)) == pytest.approx(values[:30].mean(), abs=0.01)


def test_the_rotation_withstands_outliers(rng):
    """Graduated non-convexity stands up to 70 to 80 % of them (Yang et al. 2020, Sec. V.A)."""
    truth = Rotation.random(random_state=rng).as_matrix()
    first = rng.standard_normal((200, 3))
    second = first @ truth.T + 0.01 * rng.standard_normal((200, 3))
    second[:140] = rng.standard_normal((140, 3))
    found = graduated_rotation(first, second, 0.05)
    assert naive.angle_between(found, truth) < 0.5
    plain = Rotation.align_vectors(second[140:], first[140:])[0].as_matrix()
    assert naive.angle_between(found, plain) < 0.2


def test_without_outliers_the_rotation_is_that_of_least_squares(rng):
    truth = Rotation.random(random_state=rng).as_matrix()
    first = rng.standard_normal((50, 3))
    second = first @ truth.T + 0.01 * rng.standard_normal((50, 3))
    expected = Rotation.align_vectors(second, first)[0].as_matrix()
    np.testing.assert_allclose(graduated_rotation(first, second, 0.1), expected, atol=1e-9)
    mirrored = graduated_rotation(first, -first, 10.0)
    assert np.linalg.det(mirrored) == pytest.approx(1.0)


@pytest.mark.parametrize("mu", [0.01, 1.0, 50.0])
def test_weights_are_those_of_least_surrogate_loss(rng, mu):
    squares, grid = rng.uniform(0, 3, 100), np.linspace(0, 1, 2001)
    losses = squares[:, None] * grid + mu * (1 - grid) / (mu + grid)
    np.testing.assert_allclose(surrogate_weights(squares, mu), grid[losses.argmin(axis=1)], atol=6e-4)


def test_vectors_on_one_line_have_no_rotation():
    line = np.outer(np.arange(1.0, 9.0), [1.0, 2.0, 3.0])
    assert graduated_rotation(line, line, 1.0) is None
    assert graduated_rotation(0.0 * line, line, 1.0) is None


def test_the_clique_holds_right_rows(rng):
    data = registration(800, 0.97, 0.01, rng)
    graph = ConsistencyGraph.of(rows_of(data).values / 0.05, 0.85)
    clique, proven = maximum_clique(graph, Teaser().budget)
    assert proven
    assert data.inliers[clique].mean() > 0.9
    assert len(clique) > 15
    connected = graph.connected(clique)
    assert connected.sum() == len(clique) * (len(clique) - 1)


def test_solves_ninety_nine_wrong_of_a_hundred(rng):
    """The published breakdown point: 99 % outliers at a known scale (Yang et al. 2021, Fig. 4)."""
    for seed in range(5):
        data = registration(1000, 0.99, 0.01, rng=seed)
        found = Teaser().estimate(Registration(), rows_of(data), Noise.given(0.01), rng)
        assert naive.angle_between(found.model, data.T) < 3.0


def test_finds_a_scale_among_eighty_wrong_of_a_hundred(rng):
    for scale in (0.2, 1.0, 7.0):
        data = registration(500, 0.8, 0.01 * scale, rng, scale=scale)
        problem, noise = Registration(None), Noise.given(0.01 * scale)
        found = Teaser().estimate(problem, rows_of(data), noise, np.random.default_rng(0))
        assert naive.angle_between(found.model, data.T) < 2.0
        assert np.linalg.norm(found.model[:, 0]) == pytest.approx(scale, rel=0.02)


def test_a_scale_is_found_from_some_of_the_distances(rng, monkeypatch):
    monkeypatch.setattr("nonsac.estimators.teaser._VOTES", 5000)
    data = registration(500, 0.5, 0.01, rng, scale=2.0)
    found = Teaser().estimate(Registration(None), rows_of(data), Noise.given(0.01), np.random.default_rng(0))
    assert np.linalg.norm(found.model[:, 0]) == pytest.approx(2.0, rel=0.02)
