"""What the two camera pose problems share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LARGEST_ROTATION_SIGMA = 0.17


def positive(name: str, value: float) -> float:
    """The value as a float; kernels would be compiled anew for other types."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        raise TypeError(f"{name} must be a positive number, got {value!r}")
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be a positive number, got {value!r}")
    return float(value)


def rotation_distance(a: Array, b: Array) -> Array:
    """Angle between the rotations of models (..., 3, 4), in degrees: 2 asin(|A - B|_F / sqrt 8)."""
    difference = np.asarray(a)[..., :3, :3] - np.asarray(b)[..., :3, :3]
    chord = np.sqrt((difference**2).sum(axis=(-2, -1)) / 8.0)
    return np.degrees(2.0 * np.arcsin(np.minimum(chord, 1.0)))


def least_squares_covariance(jacobian: Array, noise: float) -> Array:
    """Covariance of a fit to rows with this noise, from their derivatives (N, ..., p); infinite if undetermined."""
    p = jacobian.shape[-1]
    information = np.einsum("ip,iq->pq", *[jacobian.reshape(-1, p)] * 2) / noise**2
    if np.linalg.cond(information) > 1e14:
        return np.full((p, p), np.inf)
    return np.linalg.inv(information)


def robust_covariance(residuals: Array, jacobian: Array, threshold: float) -> Array:
    """Covariance of a fit with Tukey's biweight, from what the residuals themselves say about the noise.

    The sandwich A^-1 B A^-1 of M-estimators (Huber 1981, Sec. 7.6): A is the second derivative of the loss, B the sum
    of squared gradients, so neither the noise level nor the share of outliers within the threshold has to be known.
    Residuals are divided by one less their leverage (HC3, MacKinnon and White 1985): a fit to few rows follows them.

    Parameters
    ----------
    residuals : (N, d) float64
    jacobian : (N, d, p) float64
    threshold : float

    Returns
    -------
    (p, p) float64
        NaN where the rows do not determine the parameters.
    """
    share = 1.0 - (residuals**2).sum(axis=1) / threshold**2
    weights = np.where(share > 0.0, share, 0.0) ** 2
    gradients = np.einsum("nd,ndp->np", residuals, jacobian)
    curvature = np.einsum("n,ndp,ndq->pq", weights, jacobian, jacobian)
    if np.linalg.cond(curvature) > 1e14:
        return np.full(curvature.shape, np.nan)
    leverage = weights * np.einsum("ndp,pq,ndq->n", jacobian, np.linalg.inv(curvature), jacobian) / residuals.shape[1]
    spread = np.einsum("n,np,nq->pq", (weights / np.maximum(1.0 - leverage, 0.05)) ** 2, gradients, gradients)
    bending = np.einsum("n,np,nq->pq", np.maximum(share, 0.0), gradients, gradients)
    bent = curvature - 4.0 / threshold**2 * bending
    if np.linalg.eigvalsh(bent)[0] <= 0.1 * np.linalg.eigvalsh(curvature)[0]:  # too many rows near the threshold
        bent = curvature
    inverse = np.linalg.inv(bent)
    return inverse @ spread @ inverse


def rotation_is_certain(covariance: Array) -> bool:
    """Whether the first three parameters, a rotation vector, are known to ten degrees or better."""
    block = covariance[:3, :3]
    return bool(np.isfinite(block).all() and np.linalg.eigvalsh(block)[-1] < _LARGEST_ROTATION_SIGMA**2)


def spread_out(points: Array) -> bool:
    """Whether points (n, d) are neither all the same nor on one line."""
    centred = points - points.mean(axis=0)
    singular = np.linalg.svd(centred, compute_uv=False)
    return bool(singular[0] > 0.0 and singular[1] > 1e-9 * singular[0])
