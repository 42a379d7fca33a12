"""Rows with weights: everything that is done with rows counts a row of twice the weight as if it were there twice."""

import numpy as np
import pytest

import naive
import nonsac
from nonsac import AbsolutePose, ArraySource, Noise, Pcr99, Ransac, Registration, RelativePose, Rows, simulate
from nonsac.kernels.losses import likely_inliers
from nonsac.problems.contract import rows_of
from nonsac.problems.fits import biweight_costs, inlier_fit, reweighted_fit
from nonsac.problems.normal_equations import LikelyInliers, weighted

THRESHOLD = 0.05
PROBLEMS = [Registration(), RelativePose(), AbsolutePose(2.0), naive.Line()]


@pytest.fixture
def scene(rng):
    """Rows of a registration, half of them wrong, weights, and models near the truth."""
    truth = naive.random_model(rng)
    rows = naive.matching_rows(rng, 300, truth, noise=0.01)
    rows[:150, 3:] = rng.uniform(-2, 2, (150, 3))
    models = np.stack([truth, truth + 0.01, naive.random_model(rng)])
    return rows, rng.uniform(0, 3, 300), models


def noisy_rows(problem, rng):
    """Rows of which a third is wrong, and their model."""
    if isinstance(problem, RelativePose):
        data = simulate.relative_pose(200, 0.3, 0.002, rng)
        return np.hstack([data.points1, data.points2]), data.T[:3]
    if isinstance(problem, AbsolutePose):
        data = simulate.absolute_pose(200, 0.3, 0.002, rng)
        return np.hstack([data.points2d, data.points3d]), data.T[:3]
    if isinstance(problem, Registration):
        data = simulate.registration(200, 0.3, 0.002, rng)
        return np.hstack([data.source, data.target]), data.T[:3]
    line, rows = naive.line_model(rng.uniform(10, 170), 0.3), rng.uniform(-1, 1, (200, 2))
    rows[:140] += (0.3 + 0.002 * rng.standard_normal((140, 1)) - rows[:140] @ line[:2, None]) * line[:2]
    return rows, line


def doubled(rows):
    """The rows with a weight of 1 or 2, and the rows with the latter there twice."""
    weights = np.where(np.arange(len(rows)) % 2, 1.0, 2.0)
    return Rows(rows, weights), Rows(np.repeat(rows, weights.astype(int), axis=0))


def test_inliers_count_by_their_weight(scene):
    rows, weights, models = scene
    counts = Registration().count_inliers(models, rows, THRESHOLD, Rows(rows, weights).mean_weights)
    expected = [sum(w for w, r in zip(weights, naive.residuals(m, rows), strict=True) if r < THRESHOLD) for m in models]
    np.testing.assert_allclose(counts, np.array(expected) / weights.mean())


def test_the_unit_of_the_weights_does_not_matter(scene):
    rows, weights, models = scene
    problem, all_rows = Registration(), [Rows(rows, unit * weights) for unit in (1.0, 1e6)]
    np.testing.assert_allclose(*(problem.count_inliers(models, rows, THRESHOLD, r.mean_weights) for r in all_rows))
    np.testing.assert_allclose(*(biweight_costs(problem, models, r, THRESHOLD) for r in all_rows))
    np.testing.assert_allclose(*(reweighted_fit(problem, models[1], r, THRESHOLD, 20) for r in all_rows))
    np.testing.assert_allclose(*(inlier_fit(problem, models[1], r, THRESHOLD) for r in all_rows))
    ranks = [Pcr99.for_pairs().estimate(problem, r, Noise.within(THRESHOLD), None).rank_scores for r in all_rows]
    np.testing.assert_allclose(*ranks)


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda problem: type(problem).__name__)
def test_a_weight_of_two_is_a_row_that_is_there_twice(problem, rng):
    rows, truth = noisy_rows(problem, rng)
    once, twice = doubled(rows)
    costs = [biweight_costs(problem, truth[None], r, 0.02)[0] / len(r) for r in (once, twice)]
    assert costs[0] == pytest.approx(costs[1])
    for fit in (inlier_fit, lambda *rest: reweighted_fit(*rest, 50)):
        fitted, expected, even = (fit(problem, truth, r, 0.02) for r in (once, twice, Rows(rows)))
        np.testing.assert_allclose(fitted, expected, atol=1e-7)
        assert np.abs(fitted - even).max() > 1e-6
    fitted = problem.fit_robustly(truth, rows, once.weights, 0.02, 50)
    np.testing.assert_allclose(
        fitted, problem.fit_robustly(truth, twice.values, np.ones(len(twice)), 0.02, 50), atol=1e-8
    )


@pytest.mark.parametrize("problem", PROBLEMS[:3], ids=lambda problem: type(problem).__name__)
def test_sums_over_rows_are_weighted_too(problem, rng):
    rows, truth = noisy_rows(problem, rng)
    once, twice = doubled(rows)
    weigher, pivot = LikelyInliers(0.002, 0.1, problem.residual_dimension), problem.pivot(rows)
    sums, residuals = problem.normal_equations(truth, rows, weighted(weigher, once.weights), pivot)
    expected, _ = problem.normal_equations(truth, twice.values, weighted(weigher, None), pivot)
    np.testing.assert_allclose(sums.step(), expected.step(), rtol=1e-6)
    np.testing.assert_allclose(sums.hessian, expected.hessian, rtol=1e-6, atol=1e-9 * np.abs(sums.hessian).max())
    np.testing.assert_array_equal(residuals, problem.residuals(truth[None], rows)[0])


def test_rows_that_weigh_alike_are_weighed_by_their_residual_alone(rng):
    residuals = rng.uniform(0, 1, 20)
    weigher = LikelyInliers(0.1, 0.5, 2)
    assert weighted(weigher, None) is weigher
    expected = np.empty((2, 20))
    likely_inliers(residuals, 0.1, 0.5, 2, *expected)
    np.testing.assert_array_equal(weighted(weigher, np.full(20, 3.0))(residuals), 3.0 * expected)


def test_rows_without_weight_are_never_drawn(scene):
    """Exact rows beside wrong ones: a single minimal sample of the former explains them all."""
    rows, _, models = scene
    rows[150:, 3:] = naive.moved(models[0], rows[150:, :3])
    weights = (np.arange(300) >= 150).astype(float)
    for some in (Rows(rows, weights), rows_of(Registration(), np.column_stack([rows, weights]))):
        for seed in range(10):
            found = Ransac(1).estimate(Registration(), some, Noise.within(THRESHOLD), np.random.default_rng(seed))
            assert found.num_inliers >= 150


def test_a_table_with_one_column_more_than_the_problem_holds_weights(scene):
    rows, weights, _ = scene
    weights[:3] = 0.0, -1.0, np.nan
    rows[3, 2] = np.inf
    usable = rows_of(Registration(), np.column_stack([rows, weights]))
    np.testing.assert_array_equal(usable.values, rows[4:])
    np.testing.assert_array_equal(usable.weights, weights[4:])
    even = rows_of(Registration(), rows)
    np.testing.assert_array_equal(even.values, np.delete(rows, 3, axis=0))
    assert even.weights is None


def test_rows_that_weigh_nothing_hold_no_answer(scene):
    rows, _, _ = scene
    source = ArraySource(np.column_stack([rows, np.zeros(300)]))
    with pytest.raises(ValueError, match="weights must not all be zero; the last column of source is taken as weights"):
        nonsac.estimate(source, Registration(), noise=0.01, rng=0)


def test_the_verdict_counts_rows_and_gives_no_covariance(scene):
    rows, weights, models = scene
    weights = np.maximum(weights, 0.5)
    results = [
        nonsac.estimate(ArraySource(table), Registration(), noise=0.01, rng=0)
        for table in (rows, np.column_stack([rows, weights]))
    ]
    for result in results:
        assert result.success
        assert naive.angle_between(result.T, models[0]) < 1.0
        assert result.num_rows == 300
        assert result.num_inliers == np.count_nonzero(result.inliers)
    assert results[0].covariance.shape == (6, 6)
    assert results[1].covariance is None


def test_the_heavier_of_two_motions_is_found(rng):
    """With fewer rows, but more weight; by each of the estimators."""
    models = [naive.random_model(rng) for _ in range(2)]
    rows = np.vstack([naive.matching_rows(rng, n, m, 0.005) for n, m in zip((200, 100), models, strict=True)])
    weights = np.repeat([1.0, 9.0], [200, 100])
    for estimator in (Ransac(300), Ransac(300, local_optimisation=True), Pcr99.for_pairs(), Pcr99(max_valid=1000)):
        for expected, some in zip(models, (Rows(rows), Rows(rows, weights)), strict=True):
            found = estimator.estimate(Registration(), some, Noise.within(0.025), np.random.default_rng(0))
            assert naive.angle_between(found.model, expected) < 2.0
