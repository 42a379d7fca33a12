import numpy as np
import pytest

import naive
from nonsac.estimators.consistency_graph import ConsistencyGraph
from nonsac.estimators.gore import Gore, guaranteed_removal
from nonsac.layouts import Rows
from nonsac.problems import Noise, Registration
from nonsac.simulate import registration


@pytest.mark.parametrize("share", [0.6, 0.9, 0.95])
def test_no_inlier_is_removed_and_nearly_all_outliers_are(rng, share):
    """The guarantee (Parra Bustos and Chin, Sec. 1): the rows of the motion with the most inliers stay."""
    data = registration(400, share, 0.01, rng)
    pairs = np.hstack([data.source, data.target]) / 0.05
    is_left, model, met = guaranteed_removal(pairs, ConsistencyGraph.of(pairs, 2.0), 10**7)
    truth = data.T[:3] * [1, 1, 1, 20.0]
    inliers = naive.residuals(truth, pairs) < 1.0
    assert inliers.sum() >= (1 - share) * 390
    assert is_left[inliers].all()
    assert is_left.sum() < 1.3 * inliers.sum() + 5
    assert naive.angle_between(model, truth) < 5.0
    assert met > 0


def test_what_is_not_looked_at_stays(rng):
    data = registration(300, 0.9, 0.01, rng)
    pairs = np.hstack([data.source, data.target]) / 0.05
    is_left, model, met = guaranteed_removal(pairs, ConsistencyGraph.of(pairs, 2.0), -1)
    assert is_left.all()
    assert np.isnan(model).all()
    assert met == 0


def test_the_rows_left_are_searched_even_if_no_motion_was_met(rng):
    data = registration(300, 0.5, 0.01, rng)
    rows = Rows(np.ascontiguousarray(np.hstack([data.source, data.target])))
    found = Gore(budget=-1).estimate(Registration(), rows, Noise.given(0.01), rng)
    assert naive.angle_between(found.model, data.T) < 1.0
