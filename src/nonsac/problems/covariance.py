"""How uncertain a fit is."""

from __future__ import annotations

import numpy as np

from nonsac.layouts import Array

_CHANCE = 0.7  # of the expected difference: a covariance that is too small does more harm than a noisy one


def least_squares_covariance(jacobian: Array, noise: float) -> Array:
    """Covariance of a fit to rows with this noise, from their derivatives (N, ..., p); infinite if undetermined."""
    p = jacobian.shape[-1]
    information = np.einsum("ip,iq->pq", *[jacobian.reshape(-1, p)] * 2) / noise**2
    if np.linalg.cond(information) > 1e14:
        return np.full((p, p), np.inf)
    return np.linalg.inv(information)


def robust_covariance(residuals: Array, jacobian: Array, threshold: float) -> Array:
    """Covariance of a fit with Tukey's biweight, from what the residuals themselves say about the noise.

    The sandwich A^-1 B A^-1 of M-estimators (Huber 1981, Ch. 6 and 7): A is the second derivative of the loss, B the
    sum of squared gradients, so neither the noise level nor the share of outliers within the threshold has to be known.
    If all rows are alike, both are multiples of J^T W J, and the two factors are known far better than the matrices.
    If outliers have other derivatives than inliers, or the noise grows with the distance, that would be wrong.
    Therefore A and B are shrunk towards the multiples, as far as chance explains the difference (Ledoit and Wolf 2004).
    The noise being estimated, too, the parameters have Student's distribution, and the covariance is that.

    Parameters
    ----------
    residuals : (N, d) float64
    jacobian : (N, d, p) float64
    threshold : float

    Returns
    -------
    (p, p) float64
        NaN if the rows do not determine the parameters, infinite if N d < p + 3.
    """
    n, d, p = jacobian.shape
    ratios = (residuals**2).sum(axis=1) / threshold**2
    share = np.maximum(1.0 - ratios, 0.0)
    weights = share**2
    unit = _whitening(weights, jacobian)
    freedom = n * d - p
    if unit is None:
        return np.full((p, p), np.nan)
    if freedom <= 2:
        return np.full((p, p), np.inf)

    jacobian = jacobian @ unit
    gradients = np.einsum("nd,ndp->np", residuals, jacobian)
    leverage = weights * (jacobian**2).sum(axis=(1, 2)) / d
    squares = (weights / np.maximum(1.0 - leverage, 0.05)) ** 2  # HC3 (MacKinnon and White 1985)
    bends = 4.0 / threshold**2 * share
    spread = (gradients.T * squares) @ gradients
    bent = np.eye(p) - (gradients.T * bends) @ gradients
    even_spread = n / freedom * (weights**2 * ratios).sum() * threshold**2 / weights.sum()
    even_bent = max(1.0 - 4.0 / d * (share * ratios).sum() / weights.sum(), 0.05)
    if not even_spread > 0.0:
        return np.zeros((p, p))

    of_gradients, of_rows = squares / even_spread + 2.0 / even_bent * bends, weights * (1.0 - 2.0 / even_bent)
    difference = (gradients.T * of_gradients) @ gradients + (1.0 - 2.0 / even_bent) * np.eye(p)
    by_chance, observed = _sum_of_squares(jacobian, gradients, of_rows, of_gradients), (difference**2).sum()
    evenness = _CHANCE * by_chance / observed if observed > _CHANCE * by_chance else 1.0
    spread += evenness * (even_spread * np.eye(p) - spread)
    bent += evenness * (even_bent * np.eye(p) - bent)
    values, axes = np.linalg.eigh(bent)
    inverse = axes / np.maximum(values, 0.2 * even_bent) @ axes.T
    return np.asarray(freedom / (freedom - 2) * unit @ inverse @ spread @ inverse @ unit.T)


def _whitening(weights: Array, jacobian: Array) -> Array | None:
    """U with U^T (J^T W J) U = 1, or None if J^T W J is singular, whatever the units of the parameters."""
    curvature = np.einsum("ndp,ndq->pq", weights[:, None, None] * jacobian, jacobian)
    scale = np.sqrt(np.diagonal(curvature))
    if not scale.all():
        return None
    values, axes = np.linalg.eigh(curvature / np.outer(scale, scale))
    return axes / scale[:, None] / np.sqrt(values) if values[0] > 1e-14 * values[-1] else None


def _sum_of_squares(jacobian: Array, gradients: Array, of_rows: Array, of_gradients: Array) -> float:
    """Sum of |a J^T J + b g g^T|^2 over the rows, without storing N matrices."""
    products = np.einsum("ndp,nep->nde", jacobian, jacobian)
    across = np.einsum("ndp,np->nd", jacobian, gradients)
    lengths = (gradients**2).sum(axis=1)
    rows, both = (products**2).sum(axis=(1, 2)), (across**2).sum(axis=1)
    return float((of_rows**2 * rows + 2.0 * of_rows * of_gradients * both + (of_gradients * lengths) ** 2).sum())


def at_origin(centred: Array, moved: Array) -> Array:
    """Covariance (6, 6) or (7, 7) of w, t and perhaps log s; `centred` is that for t at a centre c of the points.

    t = t_centred - s exp([w]x) R c, so dt = dt_centred + [m]x w - m dlog s for the moved centre m = s R c.
    """
    x, y, z = moved
    transport = np.eye(len(centred))
    transport[3:6, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    if len(centred) == 7:
        transport[3:6, 6] = -moved
    return np.asarray(transport @ centred @ transport.T)
