import numpy as np

import naive
from nonsac.estimators.tr_de import TrDe
from nonsac.layouts import Rows
from nonsac.problems import Noise, Registration
from nonsac.simulate import registration


def test_right_rows_move_alike_along_the_axis(rng):
    """The decomposition itself (Chen et al., Sec. 3.1), and that the motion found has the rows it was searched for."""
    data = registration(300, 0.8, 0.01, rng)
    pairs = np.hstack([data.source, data.target]) / 0.05
    models, tested = TrDe().candidates(pairs, False, rng)
    truth = data.T[:3] * [1, 1, 1, 20.0]
    assert 10 < tested < 10_100
    assert naive.angle_between(models[0], truth) < 3.0
    assert np.linalg.det(models[0][:, :3]) > 0.0
    near = naive.residuals(models[0], pairs) < 1.0
    assert near[data.inliers].mean() > 0.8


def test_a_motion_without_a_rotation_is_found(rng):
    rows = naive.matching_rows(rng, 200, np.column_stack([np.eye(3), [0.5, -1.0, 2.0]]), noise=0.01)
    rows[100:, 3:] = 2.0 * rng.standard_normal((100, 3))
    found = TrDe().estimate(Registration(), Rows(rows), Noise.given(0.01), rng)
    assert naive.angle_between(found.model, np.eye(3, 4)) < 1.0
    assert found.num_inliers >= 98


def test_a_search_without_time_still_ends(rng):
    data = registration(200, 0.5, 0.01, rng)
    rows = Rows(np.ascontiguousarray(np.hstack([data.source, data.target])))
    found = TrDe(cells=10).estimate(Registration(), rows, Noise.given(0.01), rng)
    assert found.tested < 40
