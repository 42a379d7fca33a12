"""Covariances against the errors e of many fits: the mean of e^T C^-1 e (NEES) is to be the number of parameters."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac import simulate
from nonsac.kernels.pose_math import tangents
from nonsac.layouts import Rows
from nonsac.problems import AbsolutePose, Noise, Registration, RelativePose
from nonsac.problems.covariance import robust_covariance
from nonsac.problems.fits import reweighted_fit

SURVEY = np.array([1e6, -2e6, 3e6])
BOTH = pytest.mark.parametrize("problem", [Registration(), Registration(None)], ids=["rigid", "free scale"])


def pairs_and_truth(n, outliers, noise, rng):
    data = simulate.registration(n, outliers, noise, rng)
    return np.hstack([data.source, data.target]), data.T[:3]


def points_and_truth(n, outliers, noise, rng):
    data = simulate.absolute_pose(n, outliers, noise, rng)
    return np.hstack([data.points2d, data.points3d]), data.T[:3]


def views_and_truth(n, outliers, noise, rng):
    data = simulate.relative_pose(n, outliers, noise, rng)
    return np.hstack([data.points1, data.points2]), data.T[:3]


def scale_of(model):
    return np.cbrt(np.linalg.det(model[:, :3]))


def motion_error(fitted, truth):
    """What w, t and log s of a fitted motion are off."""
    turn = truth[:, :3] @ fitted[:, :3].T / (scale_of(truth) * scale_of(fitted))
    ratio = np.log(scale_of(truth) / scale_of(fitted))
    return np.r_[Rotation.from_matrix(turn).as_rotvec(), truth[:, 3] - fitted[:, 3], ratio]


def direction_error(fitted, truth):
    """The same of a relative pose, with two coordinates in the tangent plane of t."""
    axes = np.reshape(tangents(*fitted[:, 3]), (2, 3))
    return np.r_[motion_error(fitted, truth)[:3], axes @ truth[:, 3] / (fitted[:, 3] @ truth[:, 3])]


def normalised_square(problem, rows, truth, noise):
    """e^T C^-1 e of the fit to rows with outliers, divided by the number of parameters."""
    model = truth
    for _ in range(3):
        model = reweighted_fit(problem, model, Rows(rows), noise.threshold, 50)
    inliers = rows[problem.residuals(model[None], rows)[0] < noise.threshold]
    covariance = problem.covariance(model, inliers, noise)
    error_of = direction_error if isinstance(problem, RelativePose) else motion_error
    error = error_of(model, truth)[: len(covariance)]
    return error @ np.linalg.solve(covariance, error) / len(error)


def mean_nees(rng, problem, make, inliers, outliers, noise, fits=400):
    """Over so many scenes, each with its own model; 1 is right, and 2 means a covariance of half the size.

    Without the worst of a hundred fits, where an outlier that fits by chance is on its own in a place that matters.
    """
    total, squares = round(inliers / (1.0 - outliers)), []
    for _ in range(fits):
        rows, truth = make(total, outliers, noise, rng)
        squares.append(normalised_square(problem, rows, truth, Noise.given(noise)))
    return np.sort(squares)[: fits * 99 // 100].mean()


CASES = {
    "rigid": (Registration(), pairs_and_truth, 0.05),
    "free scale": (Registration(None), pairs_and_truth, 0.05),
    "absolute pose": (AbsolutePose(), points_and_truth, 0.005),
    "relative pose": (RelativePose(), views_and_truth, 0.001),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("inliers", "outliers"), [(20, 0.0), (20, 0.5), (50, 0.9), (200, 0.0), (200, 0.5), (200, 0.9)])
@pytest.mark.slow
def test_errors_are_as_large_as_the_covariance_says(rng, case, inliers, outliers):
    problem, make, noise = CASES[case]
    assert 0.8 < mean_nees(rng, problem, make, inliers, outliers, noise) < 1.25


@pytest.mark.parametrize("case", ["rigid", "free scale", "absolute pose"])
def test_ten_rows_are_enough_to_know_the_noise(rng, case):
    """Of a relative pose they leave five degrees of freedom, with which the mean hardly converges."""
    problem, make, noise = CASES[case]
    assert 0.8 < mean_nees(rng, problem, make, 10, 0.0, noise) < 1.25


def test_most_inliers_may_be_there_by_chance(rng):
    """Six of seven here: a noise of a tenth of the cube makes a threshold of half of it."""
    assert 0.8 < mean_nees(rng, Registration(), pairs_and_truth, 100, 0.97, 0.1, fits=200) < 1.25


@BOTH
@pytest.mark.parametrize("n", [50, 200])
def test_the_noise_may_grow_with_the_distance(rng, problem, n):
    """As a depth camera's does, along the ray; a covariance of even noise would be too small by half for the scale."""
    squares = []
    for _ in range(400):
        truth = naive.random_model(rng)
        points = rng.random((n, 3))
        noise = 0.02 * (0.3 * rng.standard_normal((n, 3)) + rng.standard_normal((n, 1)) * points)
        rows = np.hstack([points, naive.moved(truth, points + noise)])
        squares.append(normalised_square(problem, rows, truth, Noise.within(0.2)))
    assert 0.8 < np.mean(squares) < 1.25


# --- registration -----------------------------------------------------------------------------------------------------


def numerical_slopes(model, points, p):
    """Derivatives (3 n, p) of the moved points by w, t and log s, by central differences."""

    def moved(step):
        turn = Rotation.from_rotvec(step[:3]).as_matrix() * np.exp(step[6])
        return (points @ (turn @ model[:, :3]).T + model[:, 3] + step[3:6]).ravel()

    return np.column_stack([(moved(1e-6 * step) - moved(-1e-6 * step)) / 2e-6 for step in np.eye(7)[:p]])


@BOTH
def test_with_many_even_rows_the_covariance_is_that_of_least_squares(rng, problem):
    model = naive.random_model(rng, 1.0 if problem.scale else 2.5)
    rows = naive.matching_rows(rng, 20_000, model, noise=0.01)
    fitted = reweighted_fit(problem, model, Rows(rows), 0.2, 50)
    covariance = problem.covariance(fitted, rows, Noise.within(0.2))
    slopes = numerical_slopes(model, rows[:, :3], len(covariance))
    expected = 0.01**2 * np.linalg.inv(slopes.T @ slopes)
    np.testing.assert_allclose(covariance, expected, rtol=0.05, atol=0.05 * np.diagonal(expected).min())
    assert covariance.shape == ((6, 6) if problem.scale else (7, 7))


@BOTH
def test_the_covariance_of_a_moved_point_does_not_depend_on_the_origin(rng, problem):
    model = naive.random_model(rng, problem.scale or 0.4)
    rows = naive.matching_rows(rng, 100, model, noise=0.02)
    far = model.copy()
    far[:, 3] += SURVEY[::-1] - model[:, :3] @ SURVEY
    points, offset = rows[:4, :3], np.r_[SURVEY, SURVEY[::-1]]
    near_covariance = problem.covariance(model, rows, Noise.within(0.1))
    far_covariance = problem.covariance(far, rows + offset, Noise.within(0.1))
    p = len(near_covariance)
    near_slopes, far_slopes = np.zeros((2, 4, 3, p))
    for slopes, moved in ((near_slopes, points @ model[:, :3].T), (far_slopes, (points + SURVEY) @ model[:, :3].T)):
        for slope, (x, y, z) in zip(slopes, moved, strict=True):
            slope[:, :6] = np.hstack([[[0, z, -y], [-z, 0, x], [y, -x, 0]], np.eye(3)])
            slope[:, 6:] = np.array([[x], [y], [z]])[:, : p - 6]
    of_points = [
        slopes @ covariance @ slopes.transpose(0, 2, 1)
        for slopes, covariance in ((near_slopes, near_covariance), (far_slopes, far_covariance))
    ]
    np.testing.assert_allclose(of_points[1], of_points[0], rtol=0, atol=0.01 * np.abs(of_points[0]).max())
    rotation = near_covariance[:3, :3]
    np.testing.assert_allclose(far_covariance[:3, :3], rotation, rtol=0, atol=1e-5 * rotation.max())


@BOTH
@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e6, 1e9])
def test_the_unit_of_length_scales_the_covariance(rng, problem, unit):
    model = naive.random_model(rng)
    rows = naive.matching_rows(rng, 50, model, noise=0.02)
    scaled = model.copy()
    scaled[:, 3] *= unit
    units = np.where(np.isin(np.arange(7), [3, 4, 5]), unit, 1.0)[: 6 if problem.scale else 7]
    expected = problem.covariance(model, rows, Noise.within(0.1)) * np.outer(units, units)
    size = np.sqrt(np.diagonal(expected))
    difference = problem.covariance(scaled, unit * rows, Noise.within(unit * 0.1)) - expected
    np.testing.assert_allclose(difference / np.outer(size, size), 0, atol=1e-6)


@BOTH
def test_the_covariance_of_what_is_not_determined_is_not_finite(rng, problem):
    model = naive.random_model(rng)
    on_a_line = np.linspace(-1, 1, 20)[:, None] * [1.0, 2.0, 2.0]
    for points in (on_a_line, np.ones((20, 3)), np.repeat(on_a_line[:2], 5, axis=0), np.empty((0, 3))):
        rows = np.hstack([points, naive.moved(model, points)])
        assert not np.isfinite(problem.covariance(model, rows, Noise.within(0.1))).any()


@BOTH
def test_exact_rows_have_no_uncertainty(problem):
    points = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0], [4.0, 4.0, 4.0]])
    np.testing.assert_array_equal(problem.covariance(np.eye(3, 4), np.hstack([points, points]), Noise.within(0.1)), 0.0)


# --- residuals of any kind --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [5, 6, 7])
def test_too_few_rows_to_know_the_noise_leave_everything_open(rng, n):
    jacobian, residuals = rng.standard_normal((n, 1, 5)), 0.1 * rng.standard_normal((n, 1))
    assert np.isposinf(robust_covariance(residuals, jacobian, 1.0)).all()


def test_a_straight_line_has_the_covariance_of_students_distribution(rng):
    """With a threshold far away, and rows that are alike: s^2 (J^T J)^-1 nu / (nu - 2), from a textbook."""
    jacobian = np.ones((12, 1, 1))
    residuals = rng.standard_normal((12, 1))
    residuals -= residuals.mean()
    covariance = robust_covariance(residuals, jacobian, 1e6)
    assert covariance[0, 0] == pytest.approx((residuals**2).sum() / 11 / 12 * 11 / 9)


def test_residuals_spread_evenly_up_to_the_threshold_give_a_large_covariance(rng):
    jacobian, residuals = rng.standard_normal((300, 1, 3)), rng.uniform(-1, 1, (300, 1))
    covariance = robust_covariance(residuals, jacobian, 1.0)
    certain = robust_covariance(0.2 * residuals, jacobian, 1.0)
    assert np.linalg.eigvalsh(covariance)[0] > 50 * np.linalg.eigvalsh(certain)[-1]
