import numpy as np
import pytest
from scipy.stats import chi, norm

import naive
from nonsac import Registration, RelativePose, simulate
from nonsac.evaluation import rotation_error
from nonsac.layouts import Rows
from nonsac.method.mixture import Mixture, mixture_fit
from nonsac.method.residuals import Residuals
from nonsac.problems.fits import reweighted_fit

NOISE = 0.02


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_a_mixture_counts_inliers_and_others(rng, dimension):
    lengths = np.concatenate([NOISE * chi(dimension).rvs(500, random_state=rng), rng.uniform(0, 10, 100_000)])
    mixture = Mixture.seen_in(Residuals(lengths, rng.uniform(0, 10, 50_000)), NOISE, dimension)
    assert mixture.inliers == pytest.approx(500, abs=200)
    assert mixture.others == pytest.approx(1000, rel=0.2)


def test_weights_are_posterior_probabilities():
    """In one dimension: 100 inliers and 50 others, even within five sigma on both sides."""
    errors = np.array([0.0, 0.5, 1.0, 2.0, 3.0])
    of_inliers, of_others = 100 * norm.pdf(errors), 50 / 10
    expected = of_inliers / (of_inliers + of_others) * (1 - (errors / 10) ** 2) ** 2
    np.testing.assert_allclose(Mixture(NOISE, 1, 100, 50).weigher(NOISE * errors)[0], expected)
    assert (Mixture(NOISE, 3, 100, 50).weigher(np.array([10.0, 20.0, np.inf, np.nan]) * NOISE)[0] == 0.0).all()


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_without_others_inliers_weigh_the_same_near_the_model(dimension):
    weights = Mixture(NOISE, dimension, 100, 0).weigher(NOISE * np.array([0.0, 0.1]))[0]
    np.testing.assert_allclose(weights, 1.0, atol=1e-3)


def test_among_many_outliers_it_is_nearer_the_truth_than_a_robust_loss(rng):
    problem, errors = Registration(), []
    for _ in range(40):
        pairs = simulate.registration(20_000, 0.995, 0.04, rng)
        rows, truth = Rows(np.hstack([pairs.source, pairs.target])), pairs.T[:3]
        robust = reweighted_fit(problem, truth, rows, 0.2, 20)
        mixed = mixture_fit(problem, robust, rows, Residuals.of(problem, robust, rows), 0.04)
        errors.append([rotation_error(model[:, :3], truth[:, :3]) for model in (mixed, robust)])
    mixed, robust = np.sqrt(np.mean(np.square(errors), axis=0))
    assert mixed < 0.97 * robust


def test_with_few_outliers_it_is_as_accurate_as_least_squares_on_the_inliers(rng):
    ratios = []
    for _ in range(20):
        matches = simulate.relative_pose(2000, 0.5, 0.002, rng)
        rows, problem = Rows(np.hstack([matches.points1, matches.points2])), RelativePose()
        truth = matches.T[:3]
        fitted = mixture_fit(problem, truth, rows, Residuals.of(problem, truth, rows), 0.002)
        least = problem.refit(truth, rows.values, matches.inliers.astype(float))
        ratios.append([rotation_error(model[:, :3], truth[:, :3]) for model in (fitted, least)])
    fitted, least = np.median(ratios, axis=0)
    assert fitted < 1.15 * least


def test_rows_that_determine_nothing_leave_the_model_as_it_was():
    rows = Rows(np.zeros((50, 6)))
    model = np.eye(4)[:3]
    fitted = mixture_fit(Registration(), model, rows, Residuals(np.zeros(50), np.full(100, 9.0)), NOISE)
    np.testing.assert_array_equal(fitted, model)


def test_a_user_problem_needs_nothing_more(rng):
    rows = np.column_stack([rng.uniform(-1, 1, 400), rng.uniform(-9, 9, 400)])
    rows[:100, 1] = rows[:100, 0] + 3.0 + NOISE * rng.standard_normal(100)
    start, rows = naive.shift_model(3.0 + NOISE), Rows(rows)
    fitted = mixture_fit(naive.Shift(), start, rows, Residuals.of(naive.Shift(), start, rows), NOISE)
    assert abs(fitted[0, 3] - 3.0) < 4 * NOISE / 10


def test_a_row_of_twice_the_weight_counts_as_two(rng):
    """The mixture itself is that of rows, so both fits are given the same one."""
    values = np.column_stack([rng.uniform(-1, 1, 300), rng.uniform(2.5, 3.5, 300)])
    values[:200, 1] = values[:200, 0] + 3.0 + NOISE * rng.standard_normal(200)
    weights, start = rng.integers(1, 4, 300), naive.shift_model(3.0 + NOISE)
    once, often = Rows(values, weights.astype(float)), Rows(np.repeat(values, weights, axis=0))
    residuals = Residuals.of(naive.Shift(), start, Rows(values))
    repeated = Residuals(np.repeat(residuals.of_rows, weights), residuals.background)
    mixture = Mixture.seen_in(residuals, NOISE, 1)
    fitted = mixture_fit(naive.Shift(), start, once, residuals, NOISE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Mixture, "seen_in", lambda *_: mixture)
        expected = mixture_fit(naive.Shift(), start, often, repeated, NOISE)
    np.testing.assert_allclose(fitted, expected, atol=1e-9)
    assert abs(fitted[0, 3] - 3.0) < 4 * NOISE / 14
