import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.kernels.pose_fit import move
from nonsac.problems import AbsolutePose, Noise

FOCAL = 1000.0
PROBLEM = AbsolutePose(FOCAL)
SIGMA = 0.7  # pixels
NOISE = Noise.given(SIGMA)
THRESHOLD = NOISE.threshold
SURVEY = np.array([4.5e6, 5.2e5, 5e6])


def matching(rng, n=200, sigma=0.0, **depths):
    """A pose, and rows with so much noise in pixels."""
    model = naive.random_model(rng)
    return model, naive.one_view_rows(rng, n, model, sigma / FOCAL, **depths)


def elsewhere(model, rows, offset=SURVEY):
    """The same camera and points in a world with another origin."""
    shifted = model.copy()
    shifted[:, 3] -= model[:, :3] @ offset
    return shifted, rows + np.r_[0, 0, offset]


def error_of(fitted, truth):
    w = Rotation.from_matrix(truth[:, :3] @ fitted[:, :3].T).as_rotvec()
    return np.r_[w, truth[:, 3] - fitted[:, 3]]


def numerical_jacobian(model, rows):
    """Derivatives (2 n, 6) of the slow residuals by central differences."""
    columns, h = [], 1e-6
    for k in range(6):
        ahead, behind = np.empty((2, 3, 4))
        move(model, h * np.eye(6)[k], ahead)
        move(model, -h * np.eye(6)[k], behind)
        difference = naive.image_errors(ahead, rows, FOCAL) - naive.image_errors(behind, rows, FOCAL)
        columns.append(difference.ravel() / (2 * h))
    return np.column_stack(columns)


# --- arguments --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf])
def test_a_wrong_focal_length_is_refused_by_name(value):
    with pytest.raises(ValueError, match="focal must be a positive number, got"):
        AbsolutePose(value)


@pytest.mark.parametrize("value", ["800", None, True, [800.0], 1j, np.array([1.0, 2.0])])
def test_a_focal_length_of_the_wrong_type_is_refused_by_name(value):
    with pytest.raises(TypeError, match="focal must be a positive number, got"):
        AbsolutePose(value)


@pytest.mark.parametrize("value", [1000, np.float32(1000), np.int16(1000)])
def test_a_focal_length_becomes_a_plain_float(value):
    assert AbsolutePose(value) == PROBLEM
    assert type(AbsolutePose(value).focal) is float


def test_is_frozen_and_hashable():
    with pytest.raises(dataclasses.FrozenInstanceError):
        PROBLEM.focal = 1.0
    assert len({PROBLEM, AbsolutePose(FOCAL), AbsolutePose()}) == 2


# --- residuals and counts ---------------------------------------------------------------------------------------------


def test_residuals_are_image_distances_in_pixels(rng):
    model, rows = matching(rng, 50, sigma=100.0)
    rows[::5, 2:] = naive.one_view_rows(rng, 10, model, near=-8, far=-2)[:, 2:]
    got = PROBLEM.residuals(model[None], rows)[0]
    np.testing.assert_allclose(got, naive.reprojection(model, rows, FOCAL), rtol=1e-9)
    np.testing.assert_array_equal(np.isinf(got), np.arange(50) % 5 == 0)
    np.testing.assert_allclose(AbsolutePose().residuals(model[None], rows)[0], naive.reprojection(model, rows))


@pytest.mark.parametrize("focal", [1.0, 1000.0, 5000.0])
@pytest.mark.parametrize("pixels", [0.05, 1.0, 20.0])
@pytest.mark.parametrize("offset", [np.zeros(3), SURVEY], ids=["near the origin", "survey coordinates"])
def test_counts_are_the_residuals_below_the_threshold(rng, focal, pixels, offset):
    problem, threshold = AbsolutePose(focal), pixels * focal / 1000.0
    models = np.stack([naive.random_model(rng) for _ in range(3)])
    good, behind = (
        naive.one_view_rows(rng, 1000, models[0], threshold / focal, near, far) for near, far in ((2, 8), (-8, -2))
    )
    rows = np.vstack([good, behind, rng.uniform(-1, 1, (1000, 5))])
    rows = elsewhere(models[0], rows, offset)[1]
    models = np.stack([elsewhere(model, rows, offset)[0] for model in models])
    residuals = problem.residuals(models, rows)
    clear = (np.abs(residuals / threshold - 1) > 0.02).all(axis=0)
    assert clear.mean() > 0.9
    counts = problem.count_inliers(models, rows[clear], threshold)
    np.testing.assert_array_equal(counts, (residuals[:, clear] < threshold).sum(axis=1))
    assert counts[0] > 200


@pytest.mark.parametrize("far", [1e6, 1e9, 1e30])
def test_counts_survive_a_point_far_from_all_others(rng, far):
    model, rows = matching(rng, sigma=SIGMA)
    rows[100:, 0] += 0.1
    rows[0, 2:] = far
    residuals = PROBLEM.residuals(model[None], rows)
    count = PROBLEM.count_inliers(model[None], rows, THRESHOLD)[0]
    assert count == (residuals[0] < THRESHOLD).sum()
    assert count in (99, 100)


# --- solving and fitting ----------------------------------------------------------------------------------------------


def test_minimal_samples_in_survey_coordinates_give_the_pose(rng):
    found = 0
    for _ in range(50):
        model, rows = elsewhere(*matching(rng, 3))
        models = PROBLEM.solve_minimal(rows[None])
        found += any(PROBLEM.distance(other, model) < 1e-3 for other in models)
    assert found >= 48


@pytest.mark.parametrize("offset", [np.zeros(3), SURVEY], ids=["near the origin", "survey coordinates"])
def test_the_robust_refit_ignores_outliers(rng, offset):
    model, rows = elsewhere(*matching(rng, 300, SIGMA), offset)
    rows[:100, :2] = rng.uniform(-1, 1, (100, 2))
    start, _ = elsewhere(naive.nudged(rng, elsewhere(model, rows, -offset)[0], 0.2), rows, offset)
    robust = PROBLEM.fit_robustly(start, rows, np.ones(300), THRESHOLD, 50)
    assert PROBLEM.distance(robust, model) < 0.05
    centres = [-pose[:, :3].T @ pose[:, 3] for pose in (robust, model)]
    np.testing.assert_allclose(*centres, atol=0.01)
    assert PROBLEM.distance(PROBLEM.refit(start, rows, np.ones(300)), model) > 0.5


def test_the_fit_is_the_same_in_survey_coordinates(rng):
    model, rows = matching(rng, 50, 5.0)
    near = PROBLEM.refit(model, rows, np.ones(50))
    far = PROBLEM.refit(*elsewhere(model, rows), np.ones(50))
    back, _ = elsewhere(far, rows, -SURVEY)
    np.testing.assert_allclose(back, near, atol=1e-7)


@pytest.mark.parametrize("focal", [1.0, 10.0, 1e4])
def test_the_focal_length_does_not_change_a_least_squares_fit(rng, focal):
    model, rows = matching(rng, 50, 5.0)
    expected = PROBLEM.refit(model, rows, np.ones(50))
    np.testing.assert_allclose(AbsolutePose(focal).refit(model, rows, np.ones(50)), expected, atol=1e-7)
    assert np.abs(expected - model).max() > 1e-4


@pytest.mark.parametrize("n", [0, 2])
def test_too_few_rows_are_not_fitted(rng, n):
    model, rows = matching(rng, 20)
    assert np.isnan(PROBLEM.refit(model, rows[:n], np.ones(n))).all()
    assert np.isnan(PROBLEM.refit(model, rows, np.r_[np.ones(n), np.zeros(20 - n)])).all()


def test_a_start_of_nan_gives_nan(rng):
    _, rows = matching(rng, 20)
    assert np.isnan(PROBLEM.refit(np.full((3, 4), np.nan), rows, np.ones(20))).all()


def test_a_fit_leaves_the_start_and_the_rows_alone(rng):
    model, rows = matching(rng, 20, SIGMA)
    before = model.copy(), rows.copy()
    assert np.abs(PROBLEM.refit(model, rows, np.ones(20)) - model).max() > 1e-6
    np.testing.assert_array_equal(model, before[0])
    np.testing.assert_array_equal(rows, before[1])


# --- verdicts ---------------------------------------------------------------------------------------------------------


def test_the_angle_between_rotations_is_the_distance(rng):
    for degrees in (1e-6, 1.0, 90.0, 179.9):
        model = naive.random_model(rng)
        assert PROBLEM.distance(model, naive.nudged(rng, model, degrees)) == pytest.approx(degrees, rel=1e-6)


def test_determined_means_half_a_radian_of_rotation(rng):
    """At a noise of a fifth of the threshold."""
    for _ in range(20):
        model, rows = matching(rng, 6)
        jacobian = numerical_jacobian(model, rows)
        sigma = np.linalg.eigvalsh(np.linalg.inv(jacobian.T @ jacobian)[:3, :3])[-1] ** 0.5
        limit = 5 * 0.5 / sigma
        for pose, there in ((model, rows), elsewhere(model, rows)):
            assert PROBLEM.determined(pose, there, Noise.within(0.98 * limit))
            assert not PROBLEM.determined(pose, there, Noise.within(1.02 * limit))


def test_points_on_a_line_determine_nothing(rng):
    for _ in range(10):
        model, rows = matching(rng, 2)
        points = rows[0, 2:] + rng.uniform(0, 1, (50, 1)) * (rows[1, 2:] - rows[0, 2:])
        on_line = np.hstack([naive.projected(naive.moved(model, points)), points])
        on_line[:, :2] += SIGMA / FOCAL * rng.standard_normal((50, 2))
        assert not PROBLEM.determined(model, on_line, NOISE)
        assert not PROBLEM.determined(np.full((3, 4), np.nan), on_line, NOISE)
        fitted = PROBLEM.refit(model, on_line, np.ones(50))
        assert np.isnan(fitted).all() or not PROBLEM.determined(fitted, on_line, NOISE)


def test_too_few_different_rows_are_not_determined(rng):
    model, rows = matching(rng, 2)
    for few in (rows[:0], rows[:1], rows, np.repeat(rows[:1], 20, axis=0), np.repeat(rows, 20, axis=0)):
        assert not PROBLEM.determined(model, few, NOISE)
        assert not PROBLEM.determined(np.full((3, 4), np.nan), few, NOISE)


def test_without_a_model_points_that_are_spread_out_may_determine_one(rng):
    _, rows = matching(rng, 3)
    assert PROBLEM.determined(np.full((3, 4), np.nan), rows, NOISE)


@pytest.mark.parametrize("outliers", [0, 25])
@pytest.mark.parametrize("focal", [1.0, FOCAL])
def test_the_covariance_is_that_of_repeated_fits(rng, focal, outliers):
    """The outliers are chance ones: uniform within the threshold."""
    problem, n, sigma = AbsolutePose(focal), 500, SIGMA * focal / FOCAL
    model, exact = matching(rng, n)
    errors, covariances = [], []
    for _ in range(500):
        rows = exact.copy()
        rows[:, :2] += sigma / focal * rng.standard_normal((n, 2))
        rows[:outliers, :2] += 3 * sigma / focal * rng.uniform(-1, 1, (outliers, 2))
        fitted = problem.fit_robustly(model, rows, np.ones(n), 5 * sigma, 50)
        inliers = rows[problem.residuals(fitted[None], rows)[0] < 5 * sigma]
        errors.append(error_of(fitted, model))
        covariances.append(problem.covariance(fitted, inliers, Noise.given(sigma)))
    errors, covariances = np.array(errors), np.array(covariances)
    assert covariances.shape == (500, 6, 6)
    np.testing.assert_allclose(covariances, covariances.transpose(0, 2, 1), rtol=1e-6)
    empirical = errors.T @ errors / len(errors)
    ratio = np.diagonal(covariances.mean(axis=0)) / np.diagonal(empirical)
    np.testing.assert_allclose(ratio, 1, atol=0.25)
    nees = np.mean([error @ np.linalg.solve(C, error) for error, C in zip(errors, covariances, strict=True)])
    assert nees == pytest.approx(6, rel=0.15)


def test_the_covariance_moves_with_the_origin_of_the_world(rng):
    """t = t' - exp([w]x) R o, so its error depends on the origin o; that of the camera's centre does not."""
    model, rows = matching(rng, 100, SIGMA)
    model = PROBLEM.refit(model, rows, np.ones(100))
    for offset, rtol in ((np.array([3.0, -20.0, 7.0]), 1e-6), (SURVEY, 1e-2)):
        shifted, there = elsewhere(model, rows, offset)
        centres = []
        for pose, some in ((model, rows), (shifted, there)):
            covariance = PROBLEM.covariance(pose, some, NOISE)
            x, y, z = pose[:, 3]
            # C = -R^T t, so R dC = -dt - [t]x w
            slope = np.hstack([-np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), -np.eye(3)])
            centres.append(slope @ covariance @ slope.T)
        np.testing.assert_allclose(centres[1], centres[0], rtol=rtol, atol=rtol * np.abs(centres[0]).max())
        rotation = PROBLEM.covariance(model, rows, NOISE)[:3, :3]
        np.testing.assert_allclose(covariance[:3, :3], rotation, rtol=0, atol=1e-5 * rotation.max())


def test_the_covariance_of_what_is_not_determined_is_not_finite(rng):
    model, rows = matching(rng, 2)
    assert not np.isfinite(PROBLEM.covariance(model, np.repeat(rows, 5, axis=0), NOISE)).any()
