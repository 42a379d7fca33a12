"""What all cores for matched 3D points do; each by itself is tested in a file of its own."""

import numpy as np
import pytest

import naive
import nonsac
from nonsac.estimators.named import ESTIMATORS
from nonsac.estimators.pair_core import PairCore, absolute_scores, fitted_motions
from nonsac.layouts import Rows
from nonsac.problems import Noise, Registration
from nonsac.result import Status
from nonsac.simulate import registration

NOISE = 0.01
CORES = [
    name
    for name, named in ESTIMATORS.items()
    if named.needs is None and isinstance(named.made_for(Registration()), PairCore)
]
cores = pytest.mark.parametrize("name", CORES)


def core_of(name, problem):
    return ESTIMATORS[name].made_for(problem)


def rows_of(data):
    return Rows(np.ascontiguousarray(np.hstack([data.source, data.target])))


def found_by(name, rows, scale=1.0, noise=NOISE):
    problem = Registration(scale)
    return core_of(name, problem).estimate(problem, rows, Noise.given(noise), np.random.default_rng(0))


@cores
def test_solves_nine_wrong_of_ten(name, rng):
    for _ in range(3):
        data = registration(500, 0.9, NOISE, rng)
        found = found_by(name, rows_of(data))
        assert naive.angle_between(found.model, data.T) < 2.0
        assert found.num_inliers > 45


@cores
def test_any_unit_place_and_known_scale_will_do(name, rng):
    data = registration(400, 0.8, NOISE, rng, scale=2.5)
    rows = rows_of(data)
    shift = np.array([1e5, -2e5, 500, 3e5, 0, -1e5])
    found = found_by(name, Rows(1000.0 * rows.values + shift), scale=2.5, noise=1000.0 * NOISE)
    assert naive.angle_between(found.model, data.T) < 2.0
    np.testing.assert_allclose(np.linalg.norm(found.model[:, 0]), 2.5)


@cores
def test_a_free_scale_is_found_or_refused(name, rng):
    core, data = core_of(name, Registration(None)), registration(300, 0.5, NOISE, rng, scale=3.0)
    if core.finds_scale:
        found = found_by(name, rows_of(data), scale=None)
        assert naive.angle_between(found.model, data.T) < 2.0
        np.testing.assert_allclose(np.linalg.norm(found.model[:, 0]), 3.0, rtol=0.02)
    else:
        with pytest.raises(ValueError, match=rf"{type(core).__name__} needs a known scale"):
            core.check(Registration(None))


@cores
@pytest.mark.parametrize("n", [0, 1, 2, 3, 4, 5, 70])
def test_wrong_rows_give_nothing_and_no_error(name, n, rng):
    far = rng.uniform(-1, 1, (n, 6)) * [1, 1, 1, 1e3, 1e3, 1e3]
    found = found_by(name, Rows(far))
    assert len(found.residuals) == n
    assert not found.found or found.num_inliers <= 4


@cores
def test_collinear_rows_give_nothing_or_a_motion_of_them(name, rng):
    line = np.outer(rng.random(60), [1.0, 2.0, 3.0, 3.0, -1.0, 2.0])
    found = found_by(name, Rows(line))
    assert not found.found or found.num_inliers >= 30


@cores
def test_random_rows_are_not_trusted(name, rng):
    """The number of candidates that each tells enters the verdict."""
    points = rng.random((500, 3)), rng.random((500, 3))
    result = nonsac.register_pairs(*points, noise=NOISE, estimator=name, max_samples=2, sample_size=250)
    assert result.status is not Status.OK


@cores
def test_right_answers_are_trusted(name, rng):
    data = registration(3000, 0.8, NOISE, rng)
    result = nonsac.register_pairs(data.source, data.target, noise=NOISE, estimator=name, max_samples=6)
    assert result.status is Status.OK
    assert naive.angle_between(result.T, data.T) < 0.5


def test_absolute_scores_fall_linearly():
    model = np.eye(3, 4)
    rows = Rows(np.zeros((4, 6)))
    rows.values[:, 3] = [0.0, 0.25, 0.75, 2.0]
    np.testing.assert_allclose(absolute_scores(Registration(), model[None], rows, 1.0), [2.0])
    weighted = Rows(rows.values, np.array([1.0, 3.0, 0.0, 0.0]))
    np.testing.assert_allclose(absolute_scores(Registration(), model[None], weighted, 1.0), [1.0 + 3 * 0.75])


def test_sets_that_determine_no_motion_are_left_out(rng):
    truth = naive.random_model(rng)
    pairs = naive.matching_rows(rng, 20, truth)
    found = fitted_motions(pairs, [np.arange(5), np.array([1, 1, 1]), np.arange(9, 20)])
    assert found.shape == (2, 3, 4)
    np.testing.assert_allclose(found, np.stack([truth, truth]), atol=1e-9)
    one = fitted_motions(
        pairs + [[0, 0, 0, 1, 0, 0]] * (np.arange(20) == 4)[:, None], [np.arange(5)], [np.array([1, 1, 1, 1, 0])]
    )
    np.testing.assert_allclose(one[0], truth, atol=1e-9)


class OneHundred(PairCore):
    """Fits the first hundred rows."""

    def candidates(self, pairs, free_scale, rng):
        assert len(pairs) <= 10_000
        return fitted_motions(pairs, [np.arange(100)]), 1


def test_of_many_rows_some_are_searched_and_all_are_fitted(rng):
    truth = naive.random_model(rng)
    rows = Rows(naive.matching_rows(rng, 12_000, truth, noise=0.01))
    found = OneHundred().estimate(Registration(), rows, Noise.given(0.01), rng)
    assert found.num_inliers == 12_000
    assert naive.angle_between(found.model, truth) < 0.05


def test_weights_count_in_the_choice_and_the_fit(rng):
    rows = naive.matching_rows(rng, 60, naive.random_model(rng))
    other = naive.random_model(rng)
    rows[30:, 3:] = naive.moved(other, rows[30:, :3])

    class Both(PairCore):
        def candidates(self, pairs, free_scale, rng):
            return fitted_motions(pairs, [np.arange(30), np.arange(30, 60)]), 2

    for heavy, inside in ((slice(0, 30), np.arange(30)), (slice(30, 60), np.arange(30, 60))):
        weights = np.ones(60)
        weights[heavy] = 3.0
        found = Both().estimate(Registration(), Rows(rows, weights), Noise.given(1e-3), rng)
        assert set(inside) <= set(np.flatnonzero(found.residuals < found.threshold))
