"""How uncertain a fit is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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


def at_origin(centred: Array, moved: Array) -> Array:
    """Covariance (6, 6) or (7, 7) of w, t and perhaps log s, where `centred` is that for t at a centre c of the points.

    t = t_centred - s exp([w]x) R c, so dt = dt_centred + [m]x w - m dlog s for the moved centre m = s R c.
    """
    x, y, z = moved
    transport = np.eye(len(centred))
    transport[3:6, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    if len(centred) == 7:
        transport[3:6, 6] = -moved
    return np.asarray(transport @ centred @ transport.T)
