"""Answers that the data leave uncertain: a long lens looks at an object that turned a little."""

import json

import numpy as np
import pytest

import naive
import nonsac
from nonsac import Status, simulate

SIGMA = 0.004 * np.tan(np.radians(5.5))


@pytest.fixture(scope="module", params=[2, 3])
def views(request):
    return simulate.narrow_view(200, 0.3, 0.004, request.param)


def solved(views, **settings):
    return nonsac.relative_pose(views.points1, views.points2, **{"noise": SIGMA, "workers": 1} | settings)


@pytest.mark.parametrize("noise", [SIGMA, None])
def test_a_narrow_field_of_view_leaves_the_pose_uncertain(views, noise):
    result = solved(views, noise=noise)
    assert result.status in (Status.UNCERTAIN, Status.AMBIGUOUS)  # the pose reversed in depth may fit as well
    assert not result.success
    assert result.confidence <= 0.5
    assert result.found
    assert 5.0 < result.uncertainty.rotation < 20.0
    assert np.isfinite([result.uncertainty.translation, result.uncertainty.angle]).all()


def test_as_much_uncertainty_as_is_allowed_is_trusted(views):
    strict = solved(views)
    for allowed in (None, 90.0, 1.3 * strict.uncertainty.within(1.0)):
        result = solved(views, max_uncertainty=allowed)
        assert result.success
        np.testing.assert_array_equal(result.T, strict.T)
    confidences = [solved(views, max_uncertainty=allowed).confidence for allowed in (5.0, 12.0, 24.0, None)]
    assert confidences == sorted(confidences)
    assert confidences[0] < 0.5 < confidences[-1]


def test_a_certain_pose_can_be_asked_to_be_more_certain():
    views = simulate.relative_pose(400, 0.3, 0.002, 1)
    result = nonsac.relative_pose(views.points1, views.points2, noise=0.002)
    assert result.success
    bound = 0.5 * result.uncertainty.within(1.0)
    strict = nonsac.relative_pose(views.points1, views.points2, noise=0.002, max_uncertainty=bound)
    assert strict.status is Status.UNCERTAIN


def test_a_report_tells_the_uncertainty(views):
    result = solved(views)
    report = json.loads(json.dumps(result.to_dict()))
    assert report["status"] == "uncertain"
    assert "max_uncertainty" in report["explanation"]
    stated = result.uncertainty
    assert report["uncertainty"] == {
        "rotation": stated.rotation,
        "translation": stated.translation,
        "angle": stated.angle,
    }


def test_a_report_without_an_uncertainty_says_null(rng):
    points1, points2 = rng.uniform(-0.5, 0.5, (2, 100, 2))
    assert nonsac.relative_pose(points1, points2, noise=1e-3).to_dict()["uncertainty"] is None


@pytest.mark.parametrize("bound", [0, -1.0, np.nan, np.inf])
def test_a_bound_that_is_none_is_refused(views, bound):
    with pytest.raises(ValueError, match=r"^max_uncertainty must be"):
        solved(views, max_uncertainty=bound)


def test_what_says_the_same_again_makes_nothing_more_certain(rng):
    """Twenty detections of each of sixty things, which share its error."""
    rows = naive.matching_rows(rng, 60, naive.random_model(rng), noise=0.01)
    again = np.repeat(rows, 20, axis=0) + 1e-4 * rng.standard_normal((1200, 6))
    once, often = (nonsac.register_pairs(each[:, :3], each[:, 3:], noise=0.01) for each in (rows, again))
    assert once.success
    assert often.success
    assert often.uncertainty.rotation == pytest.approx(once.uncertainty.rotation, rel=0.25)
    assert often.uncertainty.translation == pytest.approx(once.uncertainty.translation, rel=0.25)
    assert (np.diagonal(often.covariance) < 0.1 * np.diagonal(once.covariance)).all()
