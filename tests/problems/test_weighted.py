import pickle

import numpy as np
import pytest

import naive
from nonsac import AbsolutePose, Ransac, Registration, RelativePose, Weighted, simulate
from nonsac.clouds.problem import OrientedRegistration

THRESHOLD = 0.05


@pytest.fixture
def scene(rng):
    """Rows of a registration, half of them wrong, weights, and models near the truth."""
    truth = naive.random_model(rng)
    rows = naive.matching_rows(rng, 300, truth, noise=0.01)
    rows[:150, 3:] = rng.uniform(-2, 2, (150, 3))
    models = np.stack([truth, truth + 0.01, naive.random_model(rng)])
    return rows, rng.uniform(0, 3, 300), models


def test_inliers_count_by_their_weight(scene):
    rows, weights, models = scene
    counts = Weighted(Registration()).count_inliers(models, np.column_stack([rows, weights]), THRESHOLD)
    expected = [sum(w for w, r in zip(weights, naive.residuals(m, rows), strict=True) if r < THRESHOLD) for m in models]
    np.testing.assert_allclose(counts, np.array(expected) / weights.mean())


def test_the_unit_of_the_weights_does_not_matter(scene):
    rows, weights, models = scene
    problem = Weighted(Registration())
    counts = [problem.count_inliers(models, np.column_stack([rows, f * weights]), THRESHOLD) for f in (1.0, 1e6)]
    np.testing.assert_allclose(*counts)


def test_a_weight_of_two_is_a_row_that_is_there_twice(scene):
    rows, _, models = scene
    weights = np.where(np.arange(300) % 2, 1.0, 2.0)
    twice = np.repeat(rows, weights.astype(int), axis=0)
    once = np.ones(300)
    fitted = Weighted(Registration()).refit(models[0], np.column_stack([rows, weights]), once)
    np.testing.assert_allclose(fitted, Registration().refit(models[0], twice, np.ones(len(twice))), atol=1e-12)


@pytest.mark.parametrize("problem", [RelativePose(), AbsolutePose(2.0)])
def test_a_robust_fit_is_weighted_too(problem, rng):
    if isinstance(problem, RelativePose):
        data = simulate.relative_pose(200, 0.3, 0.002, rng)
        rows = np.hstack([data.points1, data.points2])
    else:
        data = simulate.absolute_pose(200, 0.3, 0.002, rng)
        rows = np.hstack([data.points2d, data.points3d])
    weights = np.where(np.arange(200) % 2, 1.0, 2.0)
    twice = np.repeat(rows, weights.astype(int), axis=0)
    fitted = Weighted(problem).refit_robustly(data.T[:3], np.column_stack([rows, weights]), np.ones(200), 0.02, 50)
    expected = problem.refit_robustly(data.T[:3], twice, np.ones(len(twice)), 0.02, 50)
    np.testing.assert_allclose(fitted, expected, atol=1e-8)
    covariance = Weighted(problem).covariance(fitted, np.column_stack([rows, weights]), 0.02)
    np.testing.assert_array_equal(covariance, problem.covariance(fitted, rows, 0.02))


def test_has_what_the_problem_has_and_nothing_else():
    assert hasattr(Weighted(RelativePose()), "simpler_models")
    assert not hasattr(Weighted(Registration()), "simpler_models")
    assert hasattr(Weighted(Registration()), "covariance")
    assert not hasattr(Weighted(OrientedRegistration()), "covariance")
    assert not hasattr(Weighted(Registration()), "refit_robustly")


def test_rows_without_weight_are_never_drawn(scene, rng):
    rows, _, _ = scene
    weights = (np.arange(300) >= 150).astype(float)  # the right ones
    hypothesis = Ransac(3).estimate(Weighted(Registration()), np.column_stack([rows, weights]), THRESHOLD, rng)
    assert hypothesis.num_inliers > 140


def test_survives_pickling():
    assert pickle.loads(pickle.dumps(Weighted(RelativePose(2.0, 3.0)))) == Weighted(RelativePose(2.0, 3.0))
