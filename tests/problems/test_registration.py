import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.clouds.problem import OrientedRegistration
from nonsac.problems import Noise, Registration

THRESHOLD = 0.1
NOISE = Noise.within(THRESHOLD)


def matching(rng, n=200, **settings):
    model = naive.random_model(rng)
    return model, naive.matching_rows(rng, n, model, **settings)


@pytest.mark.parametrize("scale", [0, -1.0, np.nan, np.inf])
def test_a_wrong_scale_is_refused_by_name(scale):
    with pytest.raises(ValueError, match="scale must be positive"):
        Registration(scale)


@pytest.mark.parametrize("scale", [1e-300, 1e101])
def test_a_scale_whose_cube_is_no_number_is_refused(scale):
    with pytest.raises(ValueError, match=r"scale must be from 1e-100 to 1e\+100, got "):
        Registration(scale)


@pytest.mark.parametrize("scale", ["1", [1.0, 2.0], 1j])
def test_a_scale_of_the_wrong_type_is_refused_by_name(scale):
    with pytest.raises((TypeError, ValueError), match="scale"):
        Registration(scale)


@pytest.mark.parametrize("scale", [1.0, 3.0, None])
def test_refit_equals_the_svd_solution(rng, scale):
    rows = naive.matching_rows(rng, 40, naive.random_model(rng, scale or 0.4), noise=0.1)
    weights = rng.uniform(0, 1, 40)
    fitted = Registration(scale).refit(np.full((3, 4), np.nan), rows, weights)
    np.testing.assert_allclose(fitted, naive.kabsch(rows, weights, scale), atol=1e-8)


def test_counts_survive_survey_coordinates(rng):
    model, rows = matching(rng, noise=0.03)
    offset = np.array([4.5e6, 5.2e5, 3.0e2, 7e6, -1e7, 12.0])
    shifted = model.copy()
    shifted[:, 3] += offset[3:] - model[:, :3] @ offset[:3]
    expected = (naive.residuals(model, rows) < THRESHOLD).sum()
    assert 0 < expected < 200
    assert Registration().count_inliers(shifted[None], rows + offset, THRESHOLD)[0] == expected


@pytest.mark.parametrize("far", [1e6, 1e9, 1e12, 1e30])
def test_counts_survive_a_row_far_from_all_others(rng, far):
    model, rows = matching(rng, noise=0.01)
    rows[100:, 4] += 3.0
    rows[0, 3:] = far
    assert Registration().count_inliers(model[None], rows, THRESHOLD)[0] == 99


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_rows_that_are_not_finite_never_count_and_harm_no_others(rng, bad):
    model, rows = matching(rng, noise=0.01)
    rows[[3, 50], [0, 5]] = bad
    assert Registration().count_inliers(model[None], rows, THRESHOLD)[0] == 198
    assert (Registration().residuals(model[None], rows)[0] < THRESHOLD).sum() == 198


@pytest.mark.parametrize("unit", [1e-12, 1e-6, 1e6, 1e12])
def test_counts_do_not_depend_on_the_unit(rng, unit):
    model, rows = matching(rng, noise=0.04)
    scaled = model.copy()
    scaled[:, 3] *= unit
    expected = Registration().count_inliers(model[None], rows, THRESHOLD)
    np.testing.assert_array_equal(Registration().count_inliers(scaled[None], unit * rows, unit * THRESHOLD), expected)


def test_collinear_inliers_do_not_determine_a_motion(rng):
    model = naive.random_model(rng)
    a = np.linspace(-1, 1, 100)[:, None] * [1.0, 2.0, 2.0]
    for spread, expected in ((0.0, False), (0.001, False), (1.0, True)):
        points = a + spread * rng.standard_normal(a.shape)
        rows = np.hstack([points, naive.moved(model, points)])
        assert Registration().determined(model, rows, NOISE) is expected


def test_identical_inliers_do_not_determine_a_motion():
    assert Registration().determined(np.eye(4)[:3], np.ones((10, 6)), NOISE) is False


@pytest.mark.parametrize("degrees", [0.0, 1e-6, 1e-3, 1.0, 90.0, 179.99, 180.0])
@pytest.mark.parametrize("scale", [1.0, 0.01, 40.0])
def test_distance_is_the_angle_between_the_rotations(rng, degrees, scale):
    axis = rng.standard_normal(3)
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    a = naive.random_model(rng)
    b = np.column_stack([scale * turn @ a[:, :3], rng.standard_normal(3)])
    assert Registration().distance(a, b) == pytest.approx(degrees, rel=1e-6, abs=1e-7)


def test_distance_broadcasts(rng):
    models = np.stack([naive.random_model(rng) for _ in range(5)])
    table = Registration().distance(models[:, None], models[None])
    for i in range(5):
        for j in range(5):
            assert table[i, j] == pytest.approx(naive.angle_between(models[i], models[j]), abs=1e-6)


def test_oriented_registration_uses_the_points_alone(rng):
    model, rows = matching(rng, n=30, noise=0.05)
    normals = rng.standard_normal((30, 6))
    oriented = np.hstack([rows[:, :3], normals[:, :3], rows[:, 3:], normals[:, 3:]])
    plain, problem = Registration(), OrientedRegistration()
    weights = rng.uniform(0, 1, 30)
    np.testing.assert_array_equal(problem.residuals(model[None], oriented), plain.residuals(model[None], rows))
    np.testing.assert_array_equal(problem.refit(model, oriented, weights), plain.refit(model, rows, weights))
    np.testing.assert_array_equal(
        problem.count_inliers(model[None], oriented, THRESHOLD), plain.count_inliers(model[None], rows, THRESHOLD)
    )


# --- errors along one motion ------------------------------------------------------------------------------------------


def around(points, angles):
    """Points turned about the vertical axis, each by an angle of its own."""
    cosines, sines = np.cos(angles), np.sin(angles)
    x, y, z = points.T
    return np.column_stack([cosines * x - sines * y, sines * x + cosines * y, z])


def turned(rng, points, ends):
    """The motion, and the rows, of points whose matches end where `ends` says, before a motion."""
    model = naive.random_model(rng)
    return model, np.hstack([points, ends @ model[:, :3].T + model[:, 3]])


@pytest.mark.parametrize(("n", "most"), [(8, 0.72), (30, 0.74), (2000, 0.4)])
def test_errors_in_all_directions_are_along_no_motion(rng, n, most):
    points = rng.standard_normal((n, 3))
    model, rows = turned(rng, points, points + 0.01 * rng.standard_normal((n, 3)))
    assert share(model, rows) < most


def share(model, rows, noise=NOISE):
    return Registration().share_of_one_motion(model, rows, noise)


@pytest.mark.parametrize("across", [0.005, 0.02])
def test_matches_that_slip_around_an_axis_err_along_one_motion(rng, across):
    points = rng.uniform(-1, 1, (1000, 3))
    slips = 0.05 * rng.standard_normal(1000)
    ends = around(points, slips) + across * rng.standard_normal((1000, 3))
    moved = (points[:, :2] ** 2).sum(axis=1)  # by a radian, squared
    along = (moved**2 * slips**2).sum() / moved.sum()
    found = share(*turned(rng, points, ends), Noise.given(across))
    assert found == pytest.approx((along + across**2) / (along + 3.0 * across**2), abs=0.02)


def test_the_share_along_one_motion_depends_on_no_frame_unit_or_order(rng):
    points = rng.uniform(-1, 1, (300, 3))
    ends = around(points, 0.05 * rng.standard_normal(300)) + 0.005 * rng.standard_normal((300, 3))
    shares = []
    for unit, far in ((1.0, 0.0), (1e-3, 0.0), (1e3, 1e5)):
        model, rows = turned(rng, points, ends)
        shifted = rows[:, :3] + far
        model = np.column_stack([model[:, :3], unit * (model[:, 3] - model[:, :3] @ np.full(3, far))])
        shares.append(share(model, unit * np.hstack([shifted, rows[:, 3:]])[::-1], Noise.given(0.005 * unit)))
    np.testing.assert_allclose(shares, shares[0], rtol=1e-6)


def test_errors_of_one_direction_everywhere_are_those_of_a_sensor(rng):
    points = rng.uniform([-1, -1, 4], [1, 1, 8], (500, 3))
    depth = points / points[:, 2:] * 0.05 * rng.standard_normal((500, 1))
    assert share(*turned(rng, points, points + depth)) == 0.0


@pytest.mark.parametrize("n", [0, 1, 3, 4, 100])
def test_exact_or_few_rows_are_along_no_motion(rng, n):
    points = rng.uniform(-1, 1, (n, 3))
    for ends in (points, points + 0.1, points * [1.0, 1.0, 1.0 + 1e-15]):
        assert share(np.eye(3, 4), np.hstack([points, ends])) < 0.6
