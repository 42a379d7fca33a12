"""What problems whose models are motions share."""

from __future__ import annotations

import numpy as np

from nonsac.layouts import Array
from nonsac.values import special
from nonsac.values.numeric import as_real, shown

RESOLVED = 6.0  # standard deviations within which two places are one
ROTATION, SHIFT = slice(0, 3), slice(3, 6)  # parameters of a covariance
_LARGEST_ROTATION_SIGMA = 0.5  # radians; smaller errors are for `max_uncertainty` to judge


def positive(name: str, value: float) -> float:
    """The value as a float; kernels would be compiled anew for other types."""
    number = as_real(value)
    if not 0 < number < np.inf:
        kind = TypeError if np.isnan(number) and not isinstance(value, float) else ValueError
        raise kind(f"{name} must be a positive number, got {shown(value)}")
    return number


def homogeneous(model: Array) -> Array:
    """A model (3, 4) as a matrix (4, 4)."""
    T = np.eye(4)
    T[:3] = model
    return T


def rotation_distance(a: Array, b: Array) -> Array:
    """Angle between the rotations of models (..., 3, 3 or 4), in degrees.

    2 asin(|A - B|_F / sqrt 8) keeps its digits at small angles, where the arc cosine of the trace loses half of them.
    """
    difference = np.asarray(a)[..., :3, :3] - np.asarray(b)[..., :3, :3]
    chord = np.sqrt((difference**2).sum(axis=(-2, -1)) / 8.0)
    return np.degrees(2.0 * np.arcsin(np.minimum(chord, 1.0)))


def rotation_is_certain(covariance: Array) -> bool:
    """Whether the first three parameters, a rotation vector, are known to half a radian or better."""
    block = covariance[:3, :3]
    return bool(np.isfinite(block).all() and np.linalg.eigvalsh(block)[-1] < _LARGEST_ROTATION_SIGMA**2)


def largest_error(covariance: Array) -> float:
    """Standard deviation in the worst direction, in degrees, of a covariance of angles; infinite if it is not known."""
    if not np.isfinite(covariance).all():
        return float("inf")
    return float(np.degrees(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0))))


def likely_length(covariance: Array) -> float:
    """What the length of an error with this covariance stays below with 95 % probability; infinite if not known.

    The sum of squares is taken for a multiple of a chi-squared variable with the same mean and variance (Satterthwaite
    1946).
    """
    if not np.isfinite(covariance).all():
        return float("inf")
    variances = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    total = float(variances.sum())
    if not total > 0.0:
        return 0.0
    unit = float((variances / total) @ variances)
    return float(np.sqrt(unit * special.chdtri(total / unit, 0.05)))


def spread_out(points: Array) -> bool:
    """Whether points (n, d) are neither all the same nor on one line."""
    centred = points - points.mean(axis=0)
    singular = np.linalg.svd(centred, compute_uv=False)
    return bool(singular[0] > 0.0 and singular[1] > 1e-9 * singular[0])
