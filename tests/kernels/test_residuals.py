import numpy as np
import pytest

import naive
from nonsac.kernels.registration import count_registration_inliers, registration_residuals
from nonsac.kernels.reprojection import count_reprojection_inliers, reprojection_residuals
from nonsac.kernels.sampson import count_epipolar_inliers, epipolar_geometries, epipolar_residuals


def residuals(models, rows):
    result = np.full((len(models), len(rows)), -1.0)
    registration_residuals(models, np.ascontiguousarray(rows.T), result)
    return result


def counts(models, rows, threshold):
    result = np.full(len(models), -1, np.int64)
    columns = np.ascontiguousarray(rows.T, np.float32)
    count_registration_inliers(models.astype(np.float32), columns, np.float32(threshold**2), result)
    return result


@pytest.fixture
def models(rng):
    return np.stack([naive.random_model(rng, scale) for scale in (1.0, 1.0, 0.3, 5.0)])


@pytest.mark.parametrize("n", [0, 1, 7, 64, 1001])
def test_residuals_equal_the_definition(rng, models, n):
    rows = rng.standard_normal((n, 6))
    expected = np.stack([naive.residuals(model, rows) for model in models])
    np.testing.assert_allclose(residuals(models, rows), expected, rtol=1e-12)


@pytest.mark.parametrize("n", [0, 1, 7, 64, 1001])
def test_counts_equal_the_definition_away_from_ties(rng, models, n):
    rows = rng.standard_normal((n, 6))
    truth = np.stack([naive.residuals(model, rows) for model in models])
    threshold = 2.0
    assert not (np.abs(truth - threshold) < 1e-5).any()
    np.testing.assert_array_equal(counts(models, rows, threshold), (truth < threshold).sum(axis=1))


def test_a_residual_equal_to_the_threshold_is_no_inlier():
    identity = np.eye(4)[None, :3]
    rows = np.array([[0, 0, 0, 2.0, 0, 0], [0, 0, 0, 1.5, 0, 0]])
    assert counts(identity, rows, 2.0)[0] == 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", range(6))
def test_rows_that_are_not_finite_never_count(rng, bad, column):
    model = naive.random_model(rng)
    rows = naive.matching_rows(rng, 20, model)
    rows[[3, 17], column] = bad
    assert counts(model[None], rows, 1.0)[0] == 18
    assert (residuals(model[None], rows)[0] < 1.0).sum() == 18


def test_a_model_of_nan_has_no_inliers(rng):
    nothing = np.full((1, 3, 4), np.nan)
    rows = rng.standard_normal((20, 6))
    assert counts(nothing, rows, 1e6)[0] == 0
    assert np.isnan(residuals(nothing, rows)).all()


# --- matches in two images --------------------------------------------------------------------------------------------

FOCALS = (800.0, 1200.0)


def geometries_of(models, focals=FOCALS):
    geometries = np.full((len(models), 8, 3), np.nan)
    epipolar_geometries(models, *focals, geometries)
    return geometries


def pixels(rows):
    return rows * [FOCALS[0], FOCALS[0], FOCALS[1], FOCALS[1]]


def epipolar(models, rows):
    result = np.full((len(models), len(rows)), -1.0)
    epipolar_residuals(geometries_of(models), np.ascontiguousarray(pixels(rows).T), result)
    return result


def epipolar_counts(models, rows, threshold):
    result = np.full(len(models), -1, np.int64)
    columns = np.ascontiguousarray(pixels(rows).T / threshold, np.float32)
    in_thresholds = geometries_of(models, (FOCALS[0] / threshold, FOCALS[1] / threshold))
    count_epipolar_inliers(in_thresholds.astype(np.float32), columns, result)
    return result


@pytest.fixture
def poses(rng):
    return np.stack([naive.random_pose(rng) for _ in range(4)])


def test_the_first_rows_of_an_epipolar_geometry_are_its_essential_matrix(poses):
    for model, geometry in zip(poses, geometries_of(poses), strict=True):
        expected = naive.fundamental(model, *FOCALS)
        unit = np.linalg.norm(expected) / np.linalg.norm(geometry[:3])
        np.testing.assert_allclose(unit * geometry[:3], expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("n", [0, 1, 7, 64, 1001])
def test_epipolar_residuals_equal_the_definition(rng, poses, n):
    rows = rng.uniform(-1, 1, (n, 4))
    expected = np.reshape([naive.epipolar(model, rows, *FOCALS) for model in poses], (4, n))
    sampson = np.reshape([naive.sampson(model, rows, *FOCALS) for model in poses], (4, n))
    assert n < 64 or 0.2 < (expected == sampson).mean() < 0.8  # the rays of the others meet behind a camera
    np.testing.assert_allclose(epipolar(poses, rows), expected, rtol=1e-9, atol=1e-9)


def test_epipolar_residuals_are_distances_to_the_nearest_match_that_fits(rng, poses):
    """To first order: the shortest correction (of both image points) that fulfils the epipolar constraint."""
    model = poses[0]
    rows = naive.two_view_rows(rng, 30, model, noise=1e-4)
    for row, residual in zip(pixels(rows), epipolar(poses[:1], rows)[0], strict=True):
        F, correction = naive.fundamental(model, *FOCALS), np.zeros(4)
        for _ in range(20):  # the nearest point of the constraint's linearisation at the corrected match
            x, y = np.append((row + correction)[:2], 1), np.append((row + correction)[2:], 1)
            error, slope = y @ F @ x, np.r_[(F.T @ y)[:2], (F @ x)[:2]]
            correction = (slope @ correction - error) / (slope @ slope) * slope
        assert residual == pytest.approx(np.linalg.norm(correction), rel=1e-2)


@pytest.mark.parametrize("n", [0, 1, 7, 64, 1001])
@pytest.mark.parametrize("threshold", [0.5, 30.0])
def test_epipolar_counts_equal_the_definition_away_from_ties(rng, poses, n, threshold):
    rows = np.vstack([naive.two_view_rows(rng, n, poses[0], noise=1e-3), rng.uniform(-1, 1, (n, 4))])
    truth = np.reshape([naive.epipolar(model, rows, *FOCALS) for model in poses], (4, 2 * n))
    rows, truth = (part[..., ~(np.abs(truth - threshold) < 2e-3).any(axis=0)] for part in (rows.T, truth))
    assert len(truth.T) >= 1.8 * n
    expected = (truth < threshold).sum(axis=1)
    np.testing.assert_array_equal(epipolar_counts(poses, rows.T, threshold), expected)
    assert n < 64 or 0 < expected[0] < 2 * n


@pytest.mark.parametrize(("depth", "count"), [(-3.0, 0), (-100.0, 0), (-1e5, 50), (1e5, 50), (3.0, 50)])
def test_points_behind_the_cameras_are_as_far_off_as_points_at_infinity(rng, depth, count):
    """A baseline at a right angle to the view: the rays of a point at depth d part by 1 / d; one pixel is 1 / 980."""
    model = np.column_stack([np.eye(3), [1.0, 0.0, 0.0]])
    points = naive.lifted(rng.uniform(-0.1, 0.1, (50, 2)), np.full(50, depth))
    rows = np.hstack([naive.projected(points), naive.projected(naive.moved(model, points))])
    np.testing.assert_allclose(naive.sampson(model, rows), 0, atol=1e-12)
    got = epipolar(model[None], rows)[0]
    expected = 0 if depth > 0 else np.sqrt(FOCALS[0] * FOCALS[1]) / abs(depth)
    np.testing.assert_allclose(got, expected, rtol=0.1, atol=1e-9)
    assert epipolar_counts(model[None], rows, 1.0)[0] == count


def test_cameras_that_look_away_from_each_other_see_no_common_point(rng):
    model = np.array([[-1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, -1]])  # back to back
    rows = rng.uniform(-0.5, 0.5, (50, 4))
    np.testing.assert_array_equal(epipolar(model[None], rows)[0], np.inf)
    assert epipolar_counts(model[None], rows, 1e4)[0] == 0


def test_a_match_at_both_epipoles_has_an_infinite_residual_and_does_not_count(rng):
    forward = np.column_stack([np.eye(3), [0.0, 0.0, 1.0]])
    sideways = np.column_stack([np.eye(3), [1.0, 0.0, 0.0]])
    rows = naive.two_view_rows(rng, 20, forward, noise=0.01)
    rows[[3, 17]] = 0  # both epipoles of the first pose
    got = epipolar(np.stack([forward, sideways]), rows)
    assert (got[0, [3, 17]] == np.inf).all()
    assert np.isfinite(np.delete(got[0], [3, 17])).all()
    assert np.isfinite(got[1]).all()
    np.testing.assert_array_equal(epipolar_counts(np.stack([forward, sideways]), rows, 1e4), [18, 20])


def test_an_epipolar_residual_of_one_is_no_inlier():
    """Under a motion along the axis: (u y - v x)^2 / (x^2 + y^2 + u^2 + v^2) = 4.5^2 / 20.25."""
    forward = np.column_stack([np.eye(3), [0.0, 0.0, 1.0]])[None]
    columns = np.array([[-3, -3], [-3, -3], [-1.5, -1.5], [0, -0.01]])
    got, result = np.empty((1, 2)), np.array([-1])
    epipolar_residuals(geometries_of(forward, (1.0, 1.0)), columns, got)
    np.testing.assert_allclose(got[0], [1, 4.47 / np.sqrt(20.2501)], rtol=1e-12)
    count_epipolar_inliers(geometries_of(forward, (1.0, 1.0)).astype(np.float32), columns.astype(np.float32), result)
    assert result[0] == 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", range(4))
def test_matches_that_are_not_finite_never_count(rng, poses, bad, column):
    rows = naive.two_view_rows(rng, 20, poses[0])
    rows[[3, 17], column] = bad
    assert epipolar_counts(poses[:1], rows, 1.0)[0] == 18
    assert (epipolar(poses[:1], rows)[0] < 1.0).sum() == 18


def test_a_pose_of_nan_has_no_inliers(rng):
    nothing = np.full((1, 3, 4), np.nan)
    matches, points = rng.uniform(-1, 1, (20, 4)), rng.uniform(-1, 1, (20, 5))
    assert epipolar_counts(nothing, matches, 1e6)[0] == 0
    assert np.isnan(epipolar(nothing, matches)).all()
    assert reprojection_counts(nothing, points, 1e6)[0] == 0
    assert np.isnan(reprojection(nothing, points)).all()


# --- points in an image and in the world ------------------------------------------------------------------------------


def reprojection(models, rows):
    result = np.full((len(models), len(rows)), -1.0)
    reprojection_residuals(models, np.ascontiguousarray(rows.T), result)
    return result


def reprojection_counts(models, rows, threshold):
    result = np.full(len(models), -1, np.int64)
    columns = np.ascontiguousarray(rows.T, np.float32)
    count_reprojection_inliers(models.astype(np.float32), columns, np.float32(threshold**2), result)
    return result


@pytest.mark.parametrize("n", [0, 1, 7, 64, 1001])
def test_reprojection_residuals_equal_the_definition(rng, poses, n):
    rows = rng.uniform(-1, 1, (n, 5)) * [1, 1, 5, 5, 5]
    expected = np.reshape([naive.reprojection(model, rows) for model in poses], (4, n))
    assert n < 64 or 0.2 < np.isinf(expected).mean() < 0.8  # behind the camera
    np.testing.assert_allclose(reprojection(poses, rows), expected, rtol=1e-9)


@pytest.mark.parametrize("n", [0, 1, 7, 64, 1001])
@pytest.mark.parametrize("threshold", [0.01, 0.5, 1e6])
def test_reprojection_counts_equal_the_definition_away_from_ties(rng, poses, n, threshold):
    rows = np.vstack([naive.one_view_rows(rng, n, poses[0], noise=0.005), rng.uniform(-5, 5, (n, 5))])
    truth = np.reshape([naive.reprojection(model, rows) for model in poses], (4, 2 * n))
    rows, truth = (part[..., ~(np.abs(truth / threshold - 1) < 1e-3).any(axis=0)] for part in (rows.T, truth))
    assert len(truth.T) >= 1.8 * n
    expected = (truth < threshold).sum(axis=1)
    np.testing.assert_array_equal(reprojection_counts(poses, rows.T, threshold), expected)
    assert n < 64 or 0 < expected[0] < 2 * n


def test_an_image_distance_equal_to_the_threshold_is_no_inlier():
    identity = np.eye(4)[None, :3]
    rows = np.array([[0.5, 0, 0, 0, 2], [0, 0.25, 0, 0, 2], [0.3, 0.4, 0, 0, 4]])
    assert reprojection_counts(identity, rows, 0.5)[0] == 1
    np.testing.assert_allclose(reprojection(identity, rows)[0], [0.5, 0.25, 0.5])


@pytest.mark.parametrize("depth", [0.0, -0.0, -1e-30, -1.0, -1e30])
def test_points_that_are_not_in_front_never_count(depth):
    identity = np.eye(4)[None, :3]
    rows = np.array([[0, 0, 0, 0, depth], [0.1, 0, 0, 0, depth], [0, 0, 0, 0, 1.0]])
    assert reprojection_counts(identity, rows, 1e6)[0] == 1
    np.testing.assert_array_equal(reprojection(identity, rows)[0], [np.inf, np.inf, 0])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", range(5))
def test_points_that_are_not_finite_never_count(rng, poses, bad, column):
    rows = naive.one_view_rows(rng, 20, poses[0])
    rows[[3, 17], column] = bad
    assert reprojection_counts(poses[:1], rows, 0.1)[0] == 18
    assert (reprojection(poses[:1], rows)[0] < 0.1).sum() == 18
