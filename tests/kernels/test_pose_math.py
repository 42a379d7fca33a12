import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.kernels.pose_math import orthonormalise, rotate, solve_in_place, tangents


def units(rng):
    """Random unit vectors, and those along the axes."""
    vectors = rng.standard_normal((200, 3))
    return np.vstack([vectors / np.linalg.norm(vectors, axis=1, keepdims=True), np.eye(3), -np.eye(3)])


def test_tangents_and_the_vector_are_a_right_handed_frame(rng):
    for t in units(rng):
        frame = np.array([t, *np.reshape(tangents(*t), (2, 3))])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(frame) == pytest.approx(1)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 9.9e-5, 1.01e-4, 1e-3, 0.05, 1.0, np.pi, 6.0, 100.0])
def test_rotate_multiplies_with_the_exponential_from_the_left(rng, angle):
    for axis in units(rng):
        model = naive.random_model(rng)
        rotated = model.copy()
        rotate(rotated, *(angle * axis))
        expected = Rotation.from_rotvec(angle * axis).as_matrix() @ model[:, :3]
        np.testing.assert_allclose(rotated[:, :3], expected, rtol=0, atol=2e-15 * (1 + angle))
        np.testing.assert_array_equal(rotated[:, 3], model[:, 3])


def test_a_thousand_small_turns_leave_a_rotation(rng):
    model = naive.random_model(rng)
    for vector in 1e-3 * rng.standard_normal((1000, 3)):
        rotate(model, *vector)
    np.testing.assert_allclose(model[:, :3] @ model[:, :3].T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("error", [0.0, 1e-9, 1e-3, 0.1])
def test_orthonormalise_makes_a_rotation_near_the_matrix(rng, error):
    for _ in range(100):
        model = naive.random_model(rng)
        model[:, :3] += error * rng.uniform(-1, 1, (3, 3))
        before = model.copy()
        orthonormalise(model)
        np.testing.assert_allclose(model[:, :3] @ model[:, :3].T, np.eye(3), atol=1e-15)
        assert np.linalg.det(model[:, :3]) == pytest.approx(1)
        np.testing.assert_allclose(model[:, :3], before[:, :3], atol=1e-15 + 6 * error)
        np.testing.assert_array_equal(model[:, 3], before[:, 3])


def test_orthonormalise_keeps_the_direction_of_the_first_row_and_the_plane_of_the_first_two(rng):
    model = naive.random_model(rng)
    model[:, :3] += 0.05 * rng.uniform(-1, 1, (3, 3))
    before = model.copy()
    orthonormalise(model)
    np.testing.assert_allclose(model[0, :3], before[0, :3] / np.linalg.norm(before[0, :3]), atol=1e-15)
    assert np.linalg.det([model[0, :3], model[1, :3], before[1, :3]]) == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("n", [1, 2, 5, 6])
def test_solve_in_place_equals_numpy(rng, n):
    for _ in range(100):
        system = rng.standard_normal((n, n + 1))
        expected = np.linalg.solve(system[:, :n], system[:, n])
        assert solve_in_place(system)
        np.testing.assert_allclose(system[:, n], expected, rtol=1e-9, atol=1e-9)


def test_solve_in_place_exchanges_rows(rng):
    order = rng.permutation(6)
    right = rng.standard_normal(6)
    system = np.column_stack([np.eye(6)[order], right])
    assert solve_in_place(system)
    np.testing.assert_array_equal(system[order, 6], right)


def test_solve_in_place_takes_the_largest_pivot():
    """With 1e-20 for a pivot, the first unknown would come out as 0."""
    system = np.array([[1e-20, 1.0, 1.0], [1.0, 1.0, 2.0]])
    assert solve_in_place(system)
    np.testing.assert_allclose(system[:, 2], 1.0)


@pytest.mark.parametrize(
    "matrix", [np.zeros((3, 3)), np.ones((3, 3)), np.diag([1.0, 0.0, 1.0]), np.full((3, 3), np.nan)]
)
def test_singular_systems_have_no_solution(matrix):
    assert not solve_in_place(np.column_stack([matrix, np.ones(3)]))
