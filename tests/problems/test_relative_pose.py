import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac import simulate
from nonsac.kernels.pose_fit import move
from nonsac.kernels.pose_math import tangents
from nonsac.problems import Noise, RelativePose

FOCALS = (800.0, 1200.0)
PROBLEM = RelativePose(*FOCALS)
SIGMA = 0.7  # pixels
NOISE = Noise.given(SIGMA)
THRESHOLD = NOISE.threshold


def matching(rng, n=200, sigma=0.0, degrees=40.0):
    """A pose, and rows with so much noise in pixels."""
    model = naive.random_pose(rng, degrees)
    return model, naive.two_view_rows(rng, n, model) + sigma * pixel_of(PROBLEM) * rng.standard_normal((n, 4))


def rotated(rng, n, problem=PROBLEM, sigma=0.0, field=0.5):
    """A pose whose translation means nothing, and rows of a rotation without a baseline."""
    model, rows = naive.random_pose(rng, 30.0), np.empty((0, 4))
    while len(rows) < n:
        image = rng.uniform(-field, field, (n, 2))
        turned = naive.lifted(image, np.ones(n)) @ model[:, :3].T
        seen = (turned[:, 2] > 0.3) & (np.abs(turned[:, :2]).max(axis=1) < 1.5 * field * turned[:, 2])
        rows = np.vstack([rows, np.hstack([image[seen], naive.projected(turned[seen])])])
    return model, rows[:n] + sigma * pixel_of(problem) * rng.standard_normal((n, 4))


def planar(rng, n, problem=PROBLEM, sigma=0.0, field=0.7):
    """A pose, and rows of points on a plane that both cameras have in front of them."""
    while True:
        model, image = naive.random_pose(rng), rng.uniform(-field, field, (n, 2))
        normal = np.r_[rng.uniform(-0.6, 0.6, 2), 1.0] / rng.uniform(2, 4)
        points = naive.lifted(image, 1 / (naive.lifted(image, np.ones(n)) @ normal))
        moved = naive.moved(model, points)
        if (points[:, 2] > 0).all() and (moved[:, 2] > 1).all():
            rows = np.hstack([image, naive.projected(moved)])
            return model, rows + sigma * pixel_of(problem) * rng.standard_normal((n, 4))


def pixel_of(problem):
    return np.repeat([1 / problem.focal1, 1 / problem.focal2], 2)


def error_of(fitted, truth):
    """What the parameters of a fitted pose are off: a rotation vector and two coordinates in the tangent plane of t."""
    w = Rotation.from_matrix(truth[:, :3] @ fitted[:, :3].T).as_rotvec()
    axes = np.reshape(tangents(*fitted[:, 3]), (2, 3))
    return np.r_[w, axes @ truth[:, 3] / (fitted[:, 3] @ truth[:, 3])]


def numerical_covariance(model, rows, sigma):
    """Of a least-squares fit, by central differences of the slow residuals over the five parameters."""
    jacobian, h = np.empty((len(rows), 5)), 1e-6
    for k in range(5):
        ahead, behind = np.empty((2, 3, 4))
        move(model, h * np.eye(5)[k], ahead)
        move(model, -h * np.eye(5)[k], behind)
        difference = naive.signed_sampson(ahead, rows, *FOCALS) - naive.signed_sampson(behind, rows, *FOCALS)
        jacobian[:, k] = difference / (2 * h)
    return sigma**2 * np.linalg.inv(jacobian.T @ jacobian)


# --- arguments --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["focal1", "focal2"])
@pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf])
def test_a_wrong_focal_length_is_refused_by_name(name, value):
    with pytest.raises(ValueError, match=f"{name} must be a positive number, got"):
        RelativePose(**{name: value})


@pytest.mark.parametrize("name", ["focal1", "focal2"])
@pytest.mark.parametrize("value", ["800", None, True, [800.0], 1j, np.array([1.0, 2.0])])
def test_a_focal_length_of_the_wrong_type_is_refused_by_name(name, value):
    with pytest.raises(TypeError, match=f"{name} must be a positive number, got"):
        RelativePose(**{name: value})


@pytest.mark.parametrize("value", [800, np.float32(800), np.int16(800)])
def test_focal_lengths_become_plain_floats(value):
    problem = RelativePose(value, value)
    assert problem == RelativePose(800.0, 800.0)
    assert type(problem.focal1) is type(problem.focal2) is float


def test_is_frozen_and_hashable():
    with pytest.raises(dataclasses.FrozenInstanceError):
        PROBLEM.focal1 = 1.0
    assert len({PROBLEM, RelativePose(*FOCALS), RelativePose()}) == 2


# --- residuals and counts ---------------------------------------------------------------------------------------------


def test_residuals_are_epipolar_distances_in_pixels(rng):
    model, matches = matching(rng, 50, sigma=20.0)
    for rows in (matches, rng.uniform(-1, 1, (50, 4))):
        got = PROBLEM.residuals(model[None], rows)[0]
        np.testing.assert_allclose(got, naive.epipolar(model, rows, *FOCALS), rtol=1e-9)
        np.testing.assert_allclose(RelativePose().residuals(model[None], rows)[0], naive.epipolar(model, rows))


def test_larger_pixels_make_smaller_residuals(rng):
    model, rows = matching(rng, sigma=20.0)
    half = RelativePose(FOCALS[0] / 2, FOCALS[1] / 2)
    np.testing.assert_allclose(2 * half.residuals(model[None], rows), PROBLEM.residuals(model[None], rows), rtol=1e-9)


def test_the_noise_of_exact_matches_is_their_residual(rng):
    """Noise of one pixel along each axis of both images gives residuals with a standard deviation of one pixel."""
    model, rows = matching(rng, 5000, sigma=1.0)
    assert np.sqrt((PROBLEM.residuals(model[None], rows) ** 2).mean()) == pytest.approx(1, rel=0.04)


@pytest.mark.parametrize("focals", [(1.0, 1.0), FOCALS, (5000.0, 300.0)])
@pytest.mark.parametrize("pixels", [0.05, 1.0, 20.0])
def test_counts_are_the_residuals_below_the_threshold(rng, focals, pixels):
    problem, threshold = RelativePose(*focals), pixels * focals[0] / 800.0
    models = np.stack([naive.random_pose(rng) for _ in range(3)])
    noise = threshold / focals[0]
    rows = np.vstack([naive.two_view_rows(rng, 1000, models[0], noise), rng.uniform(-1, 1, (1000, 4))])
    residuals = problem.residuals(models, rows)
    clear = (np.abs(residuals / threshold - 1) > 0.01).all(axis=0)
    assert clear.mean() > 0.9
    counts = problem.count_inliers(models, rows[clear], threshold)
    np.testing.assert_array_equal(counts, (residuals[:, clear] < threshold).sum(axis=1))
    assert counts[0] > 400


# --- solving and fitting ----------------------------------------------------------------------------------------------


def test_minimal_samples_of_any_cameras_give_the_pose(rng):
    found = 0
    for _ in range(30):
        matches = simulate.relative_pose(5, 0.0, 0.0, rng)
        models = RelativePose().solve_minimal(np.hstack([matches.points1, matches.points2])[None])
        found += np.abs(models - matches.T[:3]).max(axis=(1, 2)).min(initial=np.inf) < 1e-6
    assert found >= 28


def test_the_robust_refit_ignores_outliers(rng):
    model, rows = matching(rng, 300, SIGMA)
    rows[:100] = rng.uniform(-0.7, 0.7, (100, 4))
    start = naive.nudged(rng, model, 0.2, direction=True)
    robust = PROBLEM.fit_robustly(start, rows, np.ones(300), THRESHOLD, 50)
    assert PROBLEM.distance(robust, model) < 0.3
    assert PROBLEM.distance(PROBLEM.refit(start, rows, np.ones(300)), model) > 0.5


def test_the_refit_takes_residuals_in_pixels(rng):
    """With a short and a long focal length, noise of a pixel matters more in the first image."""
    model, rows = matching(rng, 50, 5.0)
    fits = [RelativePose(*focals).refit(model, rows, np.ones(50)) for focals in (FOCALS, FOCALS[::-1], (8.0, 12.0))]
    np.testing.assert_allclose(fits[2], fits[0], atol=1e-6)
    assert np.abs(fits[1] - fits[0]).max() > 1e-5


@pytest.mark.parametrize("rows", [0, 4])
def test_too_few_rows_are_not_fitted(rng, rows):
    model, all_rows = matching(rng, 20)
    assert np.isnan(PROBLEM.refit(model, all_rows[:rows], np.ones(rows))).all()
    weights = np.r_[np.ones(rows), np.zeros(20 - rows)]
    assert np.isnan(PROBLEM.refit(model, all_rows, weights)).all()


def test_a_start_of_nan_gives_nan(rng):
    _, rows = matching(rng, 20)
    assert np.isnan(PROBLEM.refit(np.full((3, 4), np.nan), rows, np.ones(20))).all()


def test_a_fit_leaves_the_start_alone(rng):
    model, rows = matching(rng, 20, SIGMA)
    before = model.copy()
    fitted = PROBLEM.refit(model, rows, np.ones(20))
    np.testing.assert_array_equal(model, before)
    assert np.abs(fitted - model).max() > 1e-6


# --- verdicts ---------------------------------------------------------------------------------------------------------


def test_the_angle_between_rotations_is_the_distance(rng):
    for degrees in (1e-6, 1.0, 90.0, 179.9):
        model = naive.random_pose(rng)
        turned = naive.nudged(rng, model, degrees)
        assert PROBLEM.distance(model, turned) == pytest.approx(degrees, rel=1e-6)


def test_determined_means_half_a_radian_of_rotation_and_seven_tenths_of_direction(rng):
    """At a noise of a fifth of the threshold."""
    by_rotation = by_direction = 0
    for _ in range(40):
        model, rows = matching(rng, 8)
        covariance = numerical_covariance(model, rows, 1.0)
        largest = [np.linalg.eigvalsh(block)[-1] ** 0.5 for block in (covariance[:3, :3], covariance[3:, 3:])]
        limits = 5 * 0.5 / largest[0], 5 * 0.7 / largest[1]
        assert PROBLEM.determined(model, rows, Noise.within(0.98 * min(limits)))
        assert not PROBLEM.determined(model, rows, Noise.within(1.02 * min(limits)))
        by_rotation, by_direction = by_rotation + (limits[0] < limits[1]), by_direction + (limits[1] < limits[0])
    assert by_rotation > 0
    assert by_direction > 0


def test_a_rotation_without_a_baseline_is_not_determined(rng):
    for _ in range(10):
        assert not PROBLEM.determined(*rotated(rng, 100), NOISE)


def test_too_few_different_rows_are_not_determined(rng):
    for _ in range(10):
        model, rows = matching(rng, 4)
        assert not PROBLEM.determined(model, rows, NOISE)
        assert not PROBLEM.determined(model, np.repeat(rows, 10, axis=0), NOISE)


def test_without_a_model_rows_that_are_spread_out_may_determine_one(rng):
    nothing = np.full((3, 4), np.nan)
    _, rows = matching(rng, 20)
    assert PROBLEM.determined(nothing, rows, NOISE)
    assert not PROBLEM.determined(nothing, rows[:4], NOISE)
    assert not PROBLEM.determined(nothing, np.repeat(rows[:1], 20, axis=0), NOISE)
    on_a_line = rows.copy()
    on_a_line[:, 2:] = np.linspace(0, 1, 20)[:, None] * [0.3, -0.2]
    assert not PROBLEM.determined(nothing, on_a_line, NOISE)


@pytest.mark.parametrize("outliers", [0, 25])
@pytest.mark.parametrize("focals", [(1.0, 1.0), FOCALS])
def test_the_covariance_is_that_of_repeated_fits(rng, focals, outliers):
    """The outliers are chance ones: uniform within the threshold, off their epipolar lines."""
    problem, n = RelativePose(*focals), 500
    pixel, sigma = pixel_of(problem), SIGMA * focals[0] / FOCALS[0]
    model, exact = matching(rng, n)
    errors, covariances = [], []
    for _ in range(500):
        rows = exact + sigma * pixel * rng.standard_normal((n, 4))
        rows[:outliers, 2:] += 4 * sigma * pixel[2:] * rng.uniform(-1, 1, (outliers, 2))
        fitted = problem.fit_robustly(model, rows, np.ones(n), 5 * sigma, 50)
        inliers = rows[problem.residuals(fitted[None], rows)[0] < 5 * sigma]
        errors.append(error_of(fitted, model))
        covariances.append(problem.covariance(fitted, inliers, Noise.given(sigma)))
    errors, covariances = np.array(errors), np.array(covariances)
    assert covariances.shape == (500, 5, 5)
    np.testing.assert_allclose(covariances, covariances.transpose(0, 2, 1), rtol=1e-9)
    empirical = errors.T @ errors / len(errors)
    ratio = np.diagonal(covariances.mean(axis=0)) / np.diagonal(empirical)
    np.testing.assert_allclose(ratio, 1, atol=0.25)
    nees = np.mean([error @ np.linalg.solve(C, error) for error, C in zip(errors, covariances, strict=True)])
    assert nees == pytest.approx(5, rel=0.16)  # 5.3 is due: the noise level is estimated, too


def test_the_covariance_of_what_is_not_determined_is_not_finite(rng):
    model, rows = matching(rng, 4)
    assert not np.isfinite(PROBLEM.covariance(model, np.repeat(rows, 5, axis=0), NOISE)).any()


# --- special cases ----------------------------------------------------------------------------------------------------

cameras = pytest.mark.parametrize(
    "problem", [RelativePose(1000.0, 1000.0), RelativePose(800.0, 2400.0), RelativePose(2400.0, 800.0)], ids=str
)


def explained(problem, model, rows):
    """Shares of the rows that a rotation and a plane explain, and the second poses of the plane."""
    rotation, *_, plane = problem.special_cases(model, rows, NOISE)
    assert (rotation.name, rotation.determined) == ("pure rotation", False)
    assert (plane.name, plane.determined) == ("planar", True)
    assert len(rotation.others) == 0
    assert rotation.explains.shape == plane.explains.shape == (len(rows),)
    return rotation.explains.mean(), plane.explains.mean(), plane.others


def fitted_inliers(problem, model, rows):
    """A robust fit, unless that has fewer inliers, and its inliers."""
    fitted = problem.fit_robustly(model, rows, np.ones(len(rows)), THRESHOLD, 50)
    inliers = problem.residuals(np.stack([fitted, model]), rows) < THRESHOLD
    best = int(inliers[1].sum() > inliers[0].sum())
    return (fitted, model)[best], rows[inliers[best]]


@cameras
@pytest.mark.parametrize("field", [0.3, 1.0])
def test_a_pure_rotation_explains_all_but_a_few_of_its_matches(rng, problem, field):
    """With the noise that the threshold is made for; what is left over passes for evidence of a baseline."""
    for _ in range(10):
        assert explained(problem, *rotated(rng, 200, problem, field=field))[0] == 1
        model, rows = rotated(rng, 200, problem, SIGMA, field)
        assert explained(problem, model, rows)[0] > 0.99
        assert explained(problem, *fitted_inliers(problem, model, rows))[0] > 0.97


@cameras
def test_a_rotation_explains_what_is_far_away_only(rng, problem):
    for _ in range(10):
        model = naive.random_pose(rng)
        points = np.vstack([naive.scene(rng, 100, model, *depths) for depths in ((2, 8), (1e5, 1e6))])
        rows = np.hstack([naive.projected(points), naive.projected(naive.moved(model, points))])
        explains = problem.special_cases(model, rows, NOISE)[0].explains
        assert explains[:100].mean() < 0.1
        assert explains[100:].all()


@cameras
def test_a_planar_scene_is_explained_by_its_plane(rng, problem):
    several = 0
    for _ in range(30):
        model, rows = planar(rng, 100, problem)
        by_rotation, by_plane, others = explained(problem, model, rows)
        assert by_rotation < 0.5
        assert by_plane == 1
        for other in others:
            several += 1
            np.testing.assert_allclose(naive.sampson(other, rows), 0, atol=1e-9)
            assert (problem.residuals(other[None], rows)[0] < 1e-6).mean() > 0.9  # a few points may be behind a camera
            assert np.abs(other - model).max() > 0.05
            np.testing.assert_allclose(explained(problem, other, rows)[2], model[None], atol=1e-6)
    assert several > 5


@cameras
@pytest.mark.parametrize("field", [0.3, 1.0])
def test_a_plane_explains_all_but_a_few_of_its_noisy_matches(rng, problem, field):
    several = 0
    for _ in range(20):
        model, inliers = fitted_inliers(problem, *planar(rng, 200, problem, SIGMA, field))
        _, by_plane, others = explained(problem, model, inliers)
        assert by_plane > 0.96
        for other in others:
            several += 1
            assert (problem.residuals(other[None], inliers)[0] < THRESHOLD).mean() > 0.85
    assert several > 3


@cameras
def test_a_plane_in_a_scene_with_depth_explains_its_own_points(rng, problem):
    for _ in range(10):
        model, on_plane = planar(rng, 150, problem, SIGMA)
        off_plane = naive.two_view_rows(rng, 50, model)
        explains = problem.special_cases(model, np.vstack([on_plane, off_plane]), NOISE)[-1].explains
        assert explains[:150].mean() > 0.95
        assert explains[150:].mean() < 0.5


@cameras
def test_a_general_scene_is_explained_by_neither(rng, problem):
    for _ in range(20):
        model = naive.random_pose(rng)
        by_rotation, by_plane, _ = explained(problem, model, naive.two_view_rows(rng, 200, model))
        assert by_rotation < 0.2
        assert by_plane < 0.5


def test_as_few_rows_as_a_minimal_sample_are_no_error(rng):
    explained(PROBLEM, *matching(rng, 5))
