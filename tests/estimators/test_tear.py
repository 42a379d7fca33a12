import numpy as np

import naive
from nonsac.estimators.tear import Tear, complement
from nonsac.layouts import Rows
from nonsac.problems import Noise, Registration
from nonsac.simulate import registration


def absolute_sum(model, pairs, width):
    """The sum of truncated absolute residuals of all coordinates."""
    return np.minimum(np.abs(naive.moved(model, pairs[:, :3]) - pairs[:, 3:]), width).sum()


def test_no_motion_nearby_has_less_truncated_absolute_residuals(rng):
    data = registration(300, 0.8, 0.01, rng)
    pairs = np.hstack([data.source, data.target]) / 0.05
    models, tested = Tear(gap=0.001).candidates(pairs, False, rng)
    truth = data.T[:3] * [1, 1, 1, 20.0]
    assert 100 < tested < 10_100
    assert naive.angle_between(models[0], truth) < 1.0
    found = absolute_sum(models[0], pairs, 0.6)
    assert found < absolute_sum(truth, pairs, 0.6) * 1.01
    for _ in range(20):
        other = naive.random_model(rng)
        assert found < absolute_sum(other, pairs, 0.6)


def test_a_complement_makes_a_right_handed_frame(rng):
    for direction in (*rng.standard_normal((5, 3)), np.array([0.0, 0.0, 1.0])):
        frame = np.vstack([direction / np.linalg.norm(direction), complement(direction / np.linalg.norm(direction))])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame) > 0.0


def test_a_search_without_time_still_ends(rng):
    data = registration(200, 0.5, 0.01, rng)
    rows = Rows(np.ascontiguousarray(np.hstack([data.source, data.target])))
    found = Tear(cells=10).estimate(Registration(), rows, Noise.given(0.01), rng)
    assert found.tested < 40
