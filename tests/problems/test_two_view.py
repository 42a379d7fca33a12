import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.kernels.five_point import five_point_poses
from nonsac.problems.two_view import plane_of, pose_of_same_plane, seen_through_plane

THRESHOLD = 0.01


def random_plane(rng):
    """n with n . X = 1, some 4 in front of the first camera and tilted by up to 40 degrees."""
    return np.r_[rng.uniform(-0.6, 0.6, 2), 1.0] / rng.uniform(3, 5)


def planar_scene(rng, n, noise=0.0):
    """A pose, a plane, and rows of points on it that both cameras have in front of them."""
    while True:
        model, plane = naive.random_pose(rng), random_plane(rng)
        image = rng.uniform(-1, 1, (n, 2))
        points = naive.lifted(image, 1 / (naive.lifted(image, np.ones(n)) @ plane))
        moved = naive.moved(model, points)
        if (points[:, 2] > 1).all() and (moved[:, 2] > 1).all():
            rows = np.hstack([image, naive.projected(moved)])
            return model, plane, rows + noise * rng.standard_normal(rows.shape)


def transfer_error(model, rows):
    return lambda plane: np.linalg.norm(seen_through_plane(model, plane, rows[:, :2]) - rows[:, 2:], axis=-1)


def all_poses(rows):
    """Poses that explain all rows of a planar scene, by the five-point method; those near each other are one."""
    found = []
    for start in range(0, 30, 5):
        models = np.empty((10, 3, 4))
        for model in models[: five_point_poses(np.ascontiguousarray(rows[None, start : start + 5]), models)]:
            fits = naive.sampson(model, rows).max() < 1e-6
            if fits and all(np.abs(model - other).max() > 0.01 for other in found):
                found.append(model)
    return found


def in_front(model, rows):
    """Whether both depths of each match are positive, by least squares: d2 x2 = d1 R x1 + t."""
    result = []
    for row in rows:
        first, second = model[:, :3] @ [row[0], row[1], 1], np.array([row[2], row[3], 1])
        depths = np.linalg.lstsq(np.column_stack([-first, second]), model[:, 3], rcond=None)[0]
        result.append((depths > 0).all())
    return np.array(result)


# --- seeing a plane ---------------------------------------------------------------------------------------------------


def test_points_on_the_plane_are_seen_where_they_are(rng):
    for _ in range(20):
        model, plane, rows = planar_scene(rng, 30)
        np.testing.assert_allclose(seen_through_plane(model, plane, rows[:, :2]), rows[:, 2:], atol=1e-12)
        assert np.abs(seen_through_plane(model, 1.1 * plane, rows[:, :2]) - rows[:, 2:]).max() > 1e-3


def test_the_plane_of_zeros_is_at_infinity(rng):
    model, image = naive.random_pose(rng), rng.uniform(-0.5, 0.5, (20, 2))
    far = naive.moved(model, naive.lifted(image, np.full(20, 1e9)))
    np.testing.assert_allclose(seen_through_plane(model, np.zeros(3), image), naive.projected(far), atol=1e-8)


def test_what_is_not_in_front_of_the_second_camera_is_not_seen():
    turned = np.column_stack([Rotation.from_rotvec([0, np.pi, 0]).as_matrix(), [1, 0, 0]])
    assert np.isnan(seen_through_plane(turned, np.zeros(3), np.array([[0.1, 0.2], [0, 0]]))).all()
    sideways = np.column_stack([Rotation.from_rotvec([0, np.pi / 2, 0]).as_matrix(), [0, 0, 0]])  # z2 = -x1
    seen = seen_through_plane(sideways, np.zeros(3), np.array([[0.5, 0], [-0.5, 0]]))
    np.testing.assert_array_equal(np.isnan(seen), [[True, True], [False, False]])


# --- finding the plane ------------------------------------------------------------------------------------------------


def test_exact_rows_give_their_plane(rng):
    for _ in range(20):
        model, plane, rows = planar_scene(rng, 50)
        np.testing.assert_allclose(plane_of(model, rows, transfer_error(model, rows), THRESHOLD), plane, atol=1e-8)


@pytest.mark.parametrize("n", [200, 5000])
def test_the_plane_of_most_points_is_found_among_others(rng, n):
    for _ in range(10):
        model, plane, rows = planar_scene(rng, n, noise=1e-3)
        others = naive.two_view_rows(rng, n // 2, model, noise=1e-3)
        both = rng.permutation(np.vstack([rows, others]))
        found = plane_of(model, both, transfer_error(model, both), THRESHOLD)
        assert np.degrees(np.arccos(found @ plane / np.linalg.norm(found) / np.linalg.norm(plane))) < 5
        assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(plane), rel=0.05)
        assert (transfer_error(model, rows)(found) < THRESHOLD).mean() > 0.95


@pytest.mark.parametrize("unit", [1e-3, 1000.0])
def test_the_unit_of_the_error_does_not_matter(rng, unit):
    """Pixels or normalised coordinates, as long as the threshold is in the same unit."""
    for _ in range(10):
        model, _, rows = planar_scene(rng, 100, noise=1e-3)
        both = rng.permutation(np.vstack([rows, naive.two_view_rows(rng, 100, model, noise=1e-3)]))
        error = transfer_error(model, both)
        expected = plane_of(model, both, error, THRESHOLD)
        found = plane_of(model, both, lambda plane, error=error: unit * error(plane), unit * THRESHOLD)
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_the_same_rows_give_the_same_plane(rng):
    model, _, rows = planar_scene(rng, 100, noise=1e-3)
    planes = [plane_of(model, rows, transfer_error(model, rows), THRESHOLD) for _ in range(2)]
    np.testing.assert_array_equal(*planes)


def test_rows_on_a_line_span_no_plane(rng):
    model = naive.random_pose(rng)
    rows = np.repeat(naive.two_view_rows(rng, 1, model), 20, axis=0)
    np.testing.assert_array_equal(plane_of(model, rows, transfer_error(model, rows), THRESHOLD), np.zeros(3))


def test_a_pure_rotation_gives_the_plane_at_infinity(rng):
    model, image = naive.random_pose(rng, 20.0), rng.uniform(-0.5, 0.5, (50, 2))
    rows = np.hstack([image, naive.projected(naive.lifted(image, np.ones(50)) @ model[:, :3].T)])
    plane = plane_of(model, rows, transfer_error(model, rows), THRESHOLD)
    np.testing.assert_allclose(plane, np.zeros(3), atol=1e-9)


# --- the second pose --------------------------------------------------------------------------------------------------


def test_the_poses_of_a_plane_are_those_that_the_five_point_method_finds(rng):
    compared = seconds = 0
    for _ in range(60):
        model, plane, rows = planar_scene(rng, 60)
        others = pose_of_same_plane(model, plane, rows)
        assert others.shape in ((0, 3, 4), (1, 3, 4))
        everything = all_poses(rows)
        expected = [pose for pose in everything if np.abs(pose - model).max() > 0.01]
        assert len(everything) == len(expected) + 1
        shares = [in_front(pose, rows).mean() for pose in expected]
        if any(np.abs(pose - model).max() < 0.06 for pose in expected) or any(0.9 <= share < 1 for share in shares):
            continue  # too near each other to count as two; or a few points, which may be wrong ones, are behind
        expected = [pose for pose, share in zip(expected, shares, strict=True) if share == 1]
        assert len(others) == len(expected)
        if len(others):
            np.testing.assert_allclose(others[0], expected[0], atol=1e-6)
        compared, seconds = compared + 1, seconds + len(others)
    assert compared > 30
    assert 5 < seconds < compared - 5


def test_the_second_pose_explains_the_same_rows_and_has_the_first_one_for_its_second(rng):
    seconds = 0
    for _ in range(60):
        model, plane, rows = planar_scene(rng, 60)
        for other in pose_of_same_plane(model, plane, rows):
            seconds += 1
            np.testing.assert_allclose(other[:, :3] @ other[:, :3].T, np.eye(3), atol=1e-10)
            assert np.linalg.det(other[:, :3]) == pytest.approx(1)
            assert np.linalg.norm(other[:, 3]) == pytest.approx(1)
            np.testing.assert_allclose(naive.sampson(other, rows), 0, atol=1e-9)
            assert in_front(other, rows).mean() > 0.9
            its_plane = plane_of(other, rows, transfer_error(other, rows), THRESHOLD)
            back = pose_of_same_plane(other, its_plane, rows)
            np.testing.assert_allclose(back, model[None], atol=1e-6)
    assert seconds > 10


def test_the_length_of_a_plane_is_the_inverse_of_its_distance_in_baselines(rng):
    """A plane twice as near gives another homography, hence another second pose."""
    while True:
        model, plane, rows = planar_scene(rng, 60)
        other, nearer = pose_of_same_plane(model, plane, rows), pose_of_same_plane(model, 1.5 * plane, rows)
        if len(other) and len(nearer):
            assert np.abs(other - nearer).max() > 1e-3
            break


def test_a_plane_at_infinity_has_no_second_pose(rng):
    model, image = naive.random_pose(rng), rng.uniform(-0.5, 0.5, (20, 2))
    rows = np.hstack([image, image])
    assert pose_of_same_plane(model, np.zeros(3), rows).shape == (0, 3, 4)


def test_a_motion_along_the_normal_of_the_plane_has_no_second_pose(rng):
    plane = random_plane(rng)
    R = naive.random_pose(rng, 20.0)[:, :3]
    model = np.column_stack([R, R @ plane / np.linalg.norm(plane)])
    image = rng.uniform(-0.5, 0.5, (20, 2))
    rows = np.hstack([image, seen_through_plane(model, plane, image)])
    assert len(pose_of_same_plane(model, plane, rows)) == 0
