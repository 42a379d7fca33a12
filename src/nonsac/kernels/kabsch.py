"""Rigid and similarity fits of 3D point pairs, in closed form."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel
from nonsac.kernels.eigen import diagonalise


@kernel
def largest_eigenvector(matrix, vector):
    """Unit eigenvector of the largest eigenvalue of a symmetric 4x4 `matrix`, which is destroyed.

    Returns the gap to the second largest eigenvalue, relative to the spread of all four: near 0 the vector is not
    determined by the data.
    """
    basis = np.empty((4, 4))
    diagonalise(matrix, basis)
    best = 0
    for i in range(1, 4):
        if matrix[i, i] > matrix[best, best]:
            best = i
    second, smallest = -np.inf, np.inf
    for i in range(4):
        smallest = min(smallest, matrix[i, i])
        if i != best:
            second = max(second, matrix[i, i])
    for k in range(4):
        vector[k] = basis[k, best]
    spread = matrix[best, best] - smallest
    return (matrix[best, best] - second) / spread if spread > 0.0 else 0.0


@kernel
def fit_similarity(rows, weights, free_scale, fixed_scale, model):
    """Weighted least-squares similarity between the two halves of `rows`.

    Minimises sum_i w_i |b_i - s R a_i - t|^2 with Horn's unit quaternion (Horn 1987), where row i is (a_i, b_i).
    The scale is Umeyama's least-squares one (1991) if it is free.

    Parameters
    ----------
    rows : (N, 6) float64
    weights : (N,) float64, not negative
    free_scale : bool
    fixed_scale : float, used if the scale is not free
    model : (3, 4) float64, receives [s R | t]

    Returns
    -------
    bool
        False if the rows do not determine the rotation (fewer than three distinct points, or collinear ones).
    """
    n = rows.shape[0]
    total = 0.0
    mean = np.zeros(6)
    for i in range(n):
        total += weights[i]
        for c in range(6):
            mean[c] += weights[i] * rows[i, c]
    if not total > 0.0:
        return False
    for c in range(6):
        mean[c] /= total
    cross = np.zeros((3, 3))
    spread_a = 0.0
    spread_b = 0.0
    for i in range(n):
        w = weights[i]
        if w == 0.0:
            continue
        for c in range(3):
            a = rows[i, c] - mean[c]
            b = rows[i, 3 + c] - mean[3 + c]
            spread_a += w * a * a
            spread_b += w * b * b
            for d in range(3):
                cross[c, d] += w * a * (rows[i, 3 + d] - mean[3 + d])
    if not (spread_a > 0.0 and spread_b > 0.0):
        return False
    norm = 1.0 / np.sqrt(spread_a * spread_b)
    for c in range(3):
        for d in range(3):
            cross[c, d] *= norm
    k = np.empty((4, 4))
    k[0, 0] = cross[0, 0] + cross[1, 1] + cross[2, 2]
    k[0, 1] = cross[1, 2] - cross[2, 1]
    k[0, 2] = cross[2, 0] - cross[0, 2]
    k[0, 3] = cross[0, 1] - cross[1, 0]
    k[1, 1] = cross[0, 0] - cross[1, 1] - cross[2, 2]
    k[1, 2] = cross[0, 1] + cross[1, 0]
    k[1, 3] = cross[2, 0] + cross[0, 2]
    k[2, 2] = -cross[0, 0] + cross[1, 1] - cross[2, 2]
    k[2, 3] = cross[1, 2] + cross[2, 1]
    k[3, 3] = -cross[0, 0] - cross[1, 1] + cross[2, 2]
    for i in range(4):
        for j in range(i):
            k[i, j] = k[j, i]
    q = np.empty(4)
    gap = largest_eigenvector(k, q)
    if not gap > 1e-12:
        return False
    w, x, y, z = q[0], q[1], q[2], q[3]
    model[0, 0] = w * w + x * x - y * y - z * z
    model[0, 1] = 2.0 * (x * y - w * z)
    model[0, 2] = 2.0 * (x * z + w * y)
    model[1, 0] = 2.0 * (x * y + w * z)
    model[1, 1] = w * w - x * x + y * y - z * z
    model[1, 2] = 2.0 * (y * z - w * x)
    model[2, 0] = 2.0 * (x * z - w * y)
    model[2, 1] = 2.0 * (y * z + w * x)
    model[2, 2] = w * w - x * x - y * y + z * z
    scale = fixed_scale
    if free_scale:
        trace = 0.0
        for c in range(3):
            for d in range(3):
                trace += model[d, c] * cross[c, d]
        scale = trace * np.sqrt(spread_b / spread_a)
        if not scale > 0.0:
            return False
    for r in range(3):
        model[r, 3] = mean[3 + r]
        for c in range(3):
            model[r, c] *= scale
            model[r, 3] -= model[r, c] * mean[c]
    return True


@kernel
def fit_each(samples, free_scale, fixed_scale, models):
    """Fit one model to each of B small samples (B, k, 6); returns how many of `models` (B, 3, 4) were filled.

    Samples that do not determine a model are left out, the others keep their order.
    """
    count = 0
    weights = np.ones(samples.shape[1])
    for b in range(samples.shape[0]):
        if fit_similarity(samples[b], weights, free_scale, fixed_scale, models[count]):
            count += 1
    return count
