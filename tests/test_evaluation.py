import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nonsac.evaluation import mean_average_accuracy, rotation_error, translation_error

seeds = st.integers(0, 2**32 - 1)


def rotations(seed: int, n: int) -> np.ndarray:
    return Rotation.from_quat(np.random.default_rng(seed).standard_normal((n, 4))).as_matrix()


def turned(R: np.ndarray, degrees: float, seed: int) -> np.ndarray:
    axis = np.random.default_rng(seed).standard_normal(3)
    return R @ Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()


@given(seeds)
def test_rotation_error_is_symmetric_and_bounded(seed):
    A, B = rotations(seed, 2)
    assert rotation_error(A, B) == pytest.approx(rotation_error(B, A), abs=1e-12)
    assert 0 <= rotation_error(A, B) <= 180


@given(seeds)
def test_rotation_error_ignores_a_common_rotation(seed):
    A, B, common = rotations(seed, 3)
    expected = rotation_error(A, B)
    assert rotation_error(common @ A, common @ B) == pytest.approx(expected, abs=1e-5)
    assert rotation_error(A @ common, B @ common) == pytest.approx(expected, abs=1e-5)


@given(seeds, st.floats(1e-7, 179.0))
def test_rotation_error_is_the_angle_turned(seed, degrees):
    R = rotations(seed, 1)[0]
    assert rotation_error(R, turned(R, degrees, seed)) == pytest.approx(degrees, rel=1e-6, abs=1e-13)


def test_rotation_error_at_the_ends():
    assert rotation_error(np.eye(3), np.eye(3)) == 0.0
    assert rotation_error(np.eye(3), np.diag([1.0, -1.0, -1.0])) == pytest.approx(180.0)


def test_rotation_error_is_batched_and_broadcasts():
    A, B = rotations(0, 6).reshape(2, 3, 3, 3), rotations(1, 1)[0]
    errors = rotation_error(A, B)
    assert errors.shape == (2, 3)
    assert errors[1, 2] == rotation_error(A[1, 2], B)


def test_rotation_error_of_a_failed_estimate_is_nan():
    A = np.stack([np.eye(3), np.full((3, 3), np.nan)])
    np.testing.assert_array_equal(rotation_error(A, np.eye(3)), [0.0, np.nan])


def test_rotation_error_takes_single_precision():
    R = rotations(3, 50)
    assert rotation_error(R.astype(np.float32), R).max() < 1e-4


@pytest.mark.parametrize("bad", [np.eye(4), np.eye(3)[0], 2 * np.eye(3), -np.eye(3), np.zeros((3, 3))])
def test_rotation_error_refuses_what_is_no_rotation(bad):
    with pytest.raises(ValueError, match=r"^B .*expected"):
        rotation_error(np.eye(3), bad)


def test_translation_error():
    assert translation_error([1, 2, 3], [1, 5, 7]) == 5.0
    np.testing.assert_array_equal(translation_error(np.zeros((4, 3)), [0, 0, 2]), [2, 2, 2, 2])
    assert np.isnan(translation_error([np.nan] * 3, [0, 0, 0]))
    with pytest.raises(ValueError, match=r"^A has shape \(2,\).*expected"):
        translation_error([1, 2], [1, 2, 3])


@pytest.mark.parametrize(
    ("errors", "maximum", "expected"),
    [
        ([0.5], 10, 1.0),
        ([0.0, 0.0], 10, 1.0),
        ([1.0], 10, 0.9),  # strictly below: 1 is not below the threshold of 1
        ([9.99], 10, 0.1),
        ([10.0], 10, 0.0),
        ([np.nan], 10, 0.0),
        ([np.inf, 0.2], 10, 0.5),
        ([0.5, 2.5, 7.0, np.nan], 10, (10 + 8 + 3 + 0) / 40),
        ([0.5, 2.5, 7.0, np.nan], 5, (5 + 3 + 0 + 0) / 20),
        ([[0.5, 2.5], [7.0, 30.0]], 20, (20 + 18 + 13 + 0) / 80),
    ],
)
def test_mean_average_accuracy_on_hand_worked_cases(errors, maximum, expected):
    assert mean_average_accuracy(errors, maximum) == pytest.approx(expected, abs=1e-15)


def test_mean_average_accuracy_uses_ten_degrees_unless_told():
    assert mean_average_accuracy([9.5]) == 0.1


@pytest.mark.parametrize(
    ("errors", "maximum", "error", "message"),
    [
        ([], 10, ValueError, "errors is empty"),
        ([-1.0], 10, ValueError, "errors holds -1.0"),
        ([1.0], 0, ValueError, "maximum is 0"),
        ([1.0], 2.5, TypeError, "integer"),
    ],
)
def test_mean_average_accuracy_refuses(errors, maximum, error, message):
    with pytest.raises(error, match=message):
        mean_average_accuracy(errors, maximum)
