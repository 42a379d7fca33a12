"""L1 means against slow searches, their symmetries, and how many wrong ones they bear."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from nonsac.problems import AbsolutePose, Registration, RelativePose
from nonsac.problems.averages import mean_direction, mean_motion, mean_point, mean_rotation


def angles(a, b):
    return np.degrees((Rotation.from_matrix(a) * Rotation.from_matrix(b).inv()).magnitude())


def around(rng, truth, count, degrees):
    """Rotations off by rotation vectors with this standard deviation in each of the three numbers."""
    return (Rotation.from_rotvec(np.radians(degrees) * rng.standard_normal((count, 3))) * truth).as_matrix()


def with_outliers(rng, truth, count, share, degrees=3.0):
    wrong = round(share * count)
    return np.concatenate([around(rng, truth, count - wrong, degrees), Rotation.random(wrong, rng).as_matrix()])


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_mean_rotation_has_the_least_sum_of_angles_on_a_fine_grid(rng):
    rotations = with_outliers(rng, Rotation.random(random_state=rng), 20, 0.2, 8.0)
    found = mean_rotation(rotations)
    steps = np.radians(np.linspace(-4, 4, 17))
    grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)  # half a degree
    nearby = (Rotation.from_rotvec(grid) * Rotation.from_matrix(found)).as_matrix()
    costs = sum(angles(nearby, rotation) for rotation in rotations)
    assert np.linalg.norm(grid[np.argmin(costs)]) == 0.0


def test_mean_rotation_is_what_a_general_minimiser_finds(rng):
    for _ in range(5):
        truth = Rotation.random(random_state=rng)
        rotations = around(rng, truth, 15, 15.0)

        def cost(turn, rotations=rotations, truth=truth):
            return sum(angles((Rotation.from_rotvec(turn) * truth).as_matrix(), each) for each in rotations)

        found = minimize(cost, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-10})
        expected = (Rotation.from_rotvec(found.x) * truth).as_matrix()
        assert angles(mean_rotation(rotations), expected) < 1e-3


def test_mean_point_and_direction_are_what_a_general_minimiser_finds(rng):
    points = rng.standard_normal((12, 3)) + rng.standard_cauchy((12, 1))
    simplex = {"method": "Nelder-Mead", "options": {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 5000}}
    found = minimize(
        lambda x: np.linalg.norm(points - x, axis=1).sum(),
        np.median(points, axis=0),
        **simplex,
    )
    np.testing.assert_allclose(mean_point(points), found.x, atol=1e-5)

    directions = unit(np.array([0.2, -0.5, 2.0]) + 0.5 * rng.standard_normal((12, 3)))
    found = minimize(
        lambda x: np.arccos(np.clip(directions @ unit(x), -1, 1)).sum(),
        directions[0],
        **simplex,
    )
    np.testing.assert_allclose(mean_direction(directions), unit(found.x), atol=1e-5)


def test_turning_all_rotations_from_the_left_and_the_right_turns_their_mean(rng):
    left, right = Rotation.random(2, rng).as_matrix()
    rotations = with_outliers(rng, Rotation.random(random_state=rng), 30, 0.3)
    expected = left @ mean_rotation(rotations) @ right
    assert angles(mean_rotation(left @ rotations @ right), expected) < 1e-6


@pytest.mark.parametrize("turn", [0.0, 1e-9, 90.0, 180.0 - 1e-7, 180.0])
def test_rotations_by_any_angle_are_their_own_mean(rng, turn):
    axis = np.radians(turn) * unit(rng.standard_normal(3))
    rotation = Rotation.from_rotvec(axis).as_matrix()
    np.testing.assert_allclose(mean_rotation(rotation[None]), rotation, atol=1e-12)
    np.testing.assert_allclose(mean_rotation(np.stack([rotation] * 4)), rotation, atol=1e-12)


def test_a_mean_may_be_one_of_the_rotations():
    """The middle of three in a row; Weiszfeld's step is not defined there."""
    row = Rotation.from_rotvec([[-0.3, 0, 0], [0, 0, 0], [0.3, 0, 0]]).as_matrix()
    assert angles(mean_rotation(row), np.eye(3)) < 1e-6


@pytest.mark.parametrize(
    ("places", "median"),
    [([0.0, 0, -3, 1, 2], 0.0), ([0.0, -10, 1, 1, 8], 1.0)],  # the search starts at 0, the mean, which is a point
)
def test_a_point_holds_the_search_only_if_the_others_pull_less(places, median):
    found = mean_point(np.outer(places, [1.0, 0.0]))
    assert found[0] == pytest.approx(median, abs=1e-6)
    if median == 0.0:  # not only nearly
        assert abs(found[0]) < 1e-13


def test_forty_percent_of_outliers_move_the_l1_mean_less_than_the_l2_mean(rng):
    l1, l2 = [], []
    for _ in range(30):
        truth = Rotation.random(random_state=rng)
        rotations = with_outliers(rng, truth, 100, 0.4, 3.0)
        l1.append(angles(mean_rotation(rotations), truth.as_matrix()))
        l2.append(angles(Rotation.from_matrix(rotations).mean().as_matrix(), truth.as_matrix()))
    assert max(l1) < 5.0
    assert np.mean(l1) < 0.5 * np.mean(l2)


def test_the_mean_point_does_not_depend_on_the_unit_or_the_origin(rng):
    points = rng.standard_normal((9, 3))
    for scale, shift in ((1e-6, 0.0), (1e9, 0.0), (1.0, 1e6)):
        np.testing.assert_allclose(mean_point(scale * points + shift), scale * mean_point(points) + shift, rtol=1e-8)


def test_directions_that_cancel_have_a_mean_all_the_same():
    np.testing.assert_allclose(np.linalg.norm(mean_direction(np.array([[0, 0, 1.0], [0, 0, -1.0]]))), 1.0)


def motions(rng, truth, count, far, degrees=0.5):
    """Motions that agree near a place far away, so that t varies by far more than the motion does there."""
    rotations = around(rng, Rotation.from_matrix(truth[:, :3]), count, degrees)
    places = truth[:, :3] @ far + truth[:, 3] + 0.01 * rng.standard_normal((count, 3))
    return np.concatenate([rotations, (places - rotations @ far)[:, :, None]], axis=2)


def test_translations_are_averaged_where_the_points_are(rng):
    truth = np.column_stack([Rotation.random(random_state=rng).as_matrix(), [1.0, 2.0, 3.0]])
    far = np.array([5e5, 4e6, 100.0])
    models = motions(rng, truth, 9, far)
    rows = np.concatenate([far + rng.standard_normal((40, 3)), np.zeros((40, 3))], axis=1)
    average = Registration().average(models, rows)
    assert angles(average[:, :3], truth[:, :3]) < 0.5
    moved = average[:, :3] @ far + average[:, 3]
    assert np.linalg.norm(moved - (truth[:, :3] @ far + truth[:, 3])) < 0.1
    assert np.linalg.norm(np.median(models, axis=0) @ [*far, 1.0] - moved) > 100.0
    seen = np.column_stack([np.zeros((40, 2)), rows[:, :3]])
    np.testing.assert_allclose(AbsolutePose().average(models, seen), average)


def test_scales_are_averaged_by_their_logarithms(rng):
    models = motions(rng, np.eye(3, 4), 3, np.zeros(3))
    models[:, :, :3] *= np.array([0.1, 2.0, 1e3])[:, None, None]
    assert np.cbrt(np.linalg.det(mean_motion(models, np.zeros(3))[:, :3])) == pytest.approx(2.0)


def test_of_a_relative_pose_the_direction_is_averaged(rng):
    models = motions(rng, np.eye(3, 4), 11, np.zeros(3))
    models[:, :, 3] = unit(np.array([3.0, 1.0, 0.2]) + 0.02 * rng.standard_normal((11, 3)))
    models[:4, :, 3] *= -1.0  # of the wrong sign
    average = RelativePose().average(models, np.empty((0, 4)))
    assert np.linalg.norm(average[:, 3]) == pytest.approx(1.0)
    assert np.degrees(np.arccos(average[:, 3] @ unit(np.array([3.0, 1.0, 0.2])))) < 1.0
