"""Error measures against a known ground truth: the ones the paper reports."""

import numpy as np
from numpy.typing import ArrayLike

from nonsac.layouts import Array
from nonsac.problems.pose import rotation_distance
from nonsac.values.checks import real_array, whole_number

__all__ = ["mean_average_accuracy", "rotation_error", "translation_error"]

_MOST = 1.5  # no entry of a rotation, or of what passes for one, is larger


def rotation_error(A: ArrayLike, B: ArrayLike) -> Array:
    """Angle of the rotation between two rotations, in degrees.

    Computed as ``2 asin(|A - B| / sqrt 8)`` with the Frobenius norm, which stays accurate at small angles,
    where the arc cosine of the trace loses half of the digits.

    Parameters
    ----------
    A, B : array_like, shape (..., 3, 3)
        Rotation matrices; leading axes broadcast. A matrix that holds NaN (a failed estimate) gives NaN.

    Returns
    -------
    ndarray, shape (...)
        Angles from 0 to 180 degrees; a scalar for two single matrices.

    Raises
    ------
    ValueError
        If the last two axes are not 3 x 3, or a finite matrix is not a rotation (a scaled one, for instance).
    """
    first, second = _rotations("A", A), _rotations("B", B)
    _check_broadcast(first.shape[:-2], second.shape[:-2])
    return np.asarray(rotation_distance(first, second))[()]


def translation_error(A: ArrayLike, B: ArrayLike) -> Array:
    """Euclidean distance between two translations, in their own unit.

    Parameters
    ----------
    A, B : array_like, shape (..., 3)
        Translation vectors; leading axes broadcast. A vector that holds NaN gives NaN.

    Returns
    -------
    ndarray, shape (...)
        Distances; a scalar for two single vectors.

    Raises
    ------
    ValueError
        If the last axis does not have three entries.
    """
    first, second = real_array("A", A), real_array("B", B)
    for name, value in (("A", first), ("B", second)):
        if value.ndim < 1 or value.shape[-1] != 3:
            raise ValueError(f"{name} has shape {value.shape}; expected translations of shape (..., 3)")
    _check_broadcast(first.shape[:-1], second.shape[:-1])
    with np.errstate(all="ignore"):  # too far apart is infinitely far
        return np.asarray(np.linalg.norm(first - second, axis=-1))[()]


def mean_average_accuracy(errors: ArrayLike, maximum: int = 10) -> float:
    """Share of trials with an error below a threshold, averaged over 1, 2, ..., `maximum` degrees.

    Section 4 of the paper (Eq. mAA, there with 10 degrees; Table 3 uses 5, 10, 15 and 20). An error equal to
    a threshold is not below it; NaN, the error of a failed trial, is below none.

    Parameters
    ----------
    errors : array_like, any shape
        Rotation errors in degrees, one for each trial.
    maximum : int
        The largest threshold, in whole degrees.

    Returns
    -------
    float
        From 0 (no trial below `maximum` degrees) to 1 (every trial below 1 degree).

    Raises
    ------
    ValueError
        If there are no errors, one is negative, or `maximum` is not from 1 to 180.
    TypeError
        If `maximum` is not an integer.
    """
    values, maximum = real_array("errors", errors).ravel(), whole_number("maximum", maximum, 1, 180)
    if values.size == 0:
        raise ValueError("errors is empty; expected at least one error in degrees")
    if (values < 0).any():
        raise ValueError(f"errors holds {values[values < 0][0]}; expected degrees of at least 0")
    thresholds = np.arange(1, maximum + 1)
    return float(np.count_nonzero(values < thresholds[:, None]) / (maximum * values.size))


def _check_broadcast(first: tuple[int, ...], second: tuple[int, ...]) -> None:
    try:
        np.broadcast_shapes(first, second)
    except ValueError:
        raise ValueError(f"A and B have leading axes {first} and {second}; expected equal ones, or one of 1") from None


def _rotations(name: str, value: ArrayLike) -> Array:
    matrices = real_array(name, value)
    if matrices.shape[-2:] != (3, 3):
        raise ValueError(f"{name} has shape {matrices.shape}; expected rotations of shape (..., 3, 3)")
    if (np.abs(matrices) > _MOST).any():
        raise ValueError(f"{name} holds a matrix that is not a rotation; expected R R^T = I and det R = 1")
    # Loose enough for float32 and hand-written matrices; NaN, a failed estimate, passes both comparisons.
    skewed = np.abs(matrices @ matrices.swapaxes(-1, -2) - np.eye(3)) > 1e-3
    mirrored = (np.cross(matrices[..., 0, :], matrices[..., 1, :]) * matrices[..., 2, :]).sum(axis=-1) < 0
    if skewed.any() or mirrored.any():
        raise ValueError(f"{name} holds a matrix that is not a rotation; expected R R^T = I and det R = 1")
    return matrices
