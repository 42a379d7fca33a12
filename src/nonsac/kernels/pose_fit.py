"""Least-squares poses of many weighted matches: Levenberg and Marquardt's method on the manifold of poses.

A pose moves by R <- exp([w]x) R and t <- t + d; for relative poses, whose t has length 1, d lies in the tangent plane
of t. So there are five parameters (relative) or six (absolute), and no constraint to enforce.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nonsac.kernels._jit import kernel
from nonsac.kernels.eigen import diagonalise
from nonsac.kernels.losses import tukey
from nonsac.kernels.pose_math import orthonormalise, rotate, solve_in_place, tangents
from nonsac.kernels.reprojection import reprojection_row, reprojection_slopes
from nonsac.kernels.sampson import essential_directions, sampson_row


def fit_pose(columns: Any, weights: Any, threshold: float, iterations: int, focals: Any, model: Any) -> bool:
    """Move a pose [R | t] to the least weighted sum of squared residuals, or to the least robust cost.

    With a finite threshold the loss is Tukey's biweight, which is constant beyond the threshold; its weights are
    those of the current pose in every step (iteratively reweighted least squares).

    Parameters
    ----------
    columns : (4, N) or (5, N) float64
        x1 y1 x2 y2 of matches (relative pose, Sampson residuals), or u v X Y Z (absolute pose, image distances; points
        behind the camera count as outliers). The image coordinates are normalised ones times the focal length.
    weights : (N,) float64, not negative
    threshold : float
        In the unit of the image coordinates; infinite for plain least squares.
    iterations : int
        At most.
    focals : (2,) float64
        Focal lengths of the two images; for an absolute pose the first one counts.
    model : (3, 4) float64, the start; receives the fit

    Returns
    -------
    bool
        False if the weighted rows do not determine a pose; `model` is then where the search got stuck.
    """
    fit = fit_relative_pose if columns.shape[0] == 4 else fit_absolute_pose
    return bool(fit(columns, weights, threshold, iterations, focals, model))


@kernel
def fit_relative_pose(columns, weights, threshold, iterations, focals, model):
    return descend(columns, weights, threshold, iterations, focals, np.empty((6, 3, 3)), np.empty((5, 6)), model)


@kernel
def fit_absolute_pose(columns, weights, threshold, iterations, focals, model):
    return descend(columns, weights, threshold, iterations, focals, np.empty((2, 6)), np.empty((6, 7)), model)


@kernel
def descend(columns, weights, threshold, iterations, focals, slopes, system, model):
    """What `fit_pose` does, for the kind of pose that the shape of `slopes` and `system`, which are overwritten, tells.

    `slopes` are E and its derivatives (6, 3, 3), or those of an image point (2, 6): numba knows the number of axes when
    it compiles, and leaves out what the other kind needs.
    """
    size = system.shape[0]
    hessian, gradient, step, trial = np.empty((size, size)), np.empty(size), np.empty(size), np.empty((3, 4))
    orthonormalise(model)
    cost = normal_equations(columns, weights, threshold, focals, model, slopes, hessian, gradient)
    if not well_posed(hessian):
        return False
    damping = 1e-6
    for _ in range(iterations):
        for i in range(size):
            for j in range(size):
                system[i, j] = hessian[i, j]
            system[i, i] += damping * hessian[i, i]
            system[i, size] = -gradient[i]
        if not solve_in_place(system):
            return False
        length = 0.0
        for i in range(size):
            step[i] = system[i, size]
            length += step[i] * step[i]
        move(model, step, trial)
        trial_cost = normal_equations(columns, weights, threshold, focals, trial, slopes, hessian, gradient)
        if trial_cost <= cost:
            copy_pose(trial, model)
            gain = cost - trial_cost
            cost = trial_cost
            damping = max(1e-9, 0.1 * damping)
            if length < 1e-20 or gain <= 1e-13 * cost:
                break
        else:
            if length < 1e-20:
                break
            damping = 1e-4 if damping < 1e-4 else 10.0 * damping
            if damping > 1e8:
                break
            normal_equations(columns, weights, threshold, focals, model, slopes, hessian, gradient)
    return well_posed(hessian)


@kernel
def well_posed(hessian):
    """Whether J^T J determines the parameters, in double precision.

    By the smallest eigenvalue of the matrix scaled to a diagonal of ones: rank-deficient rows leave rounding errors of
    1e-15 there, five matches in general position 1e-9 or more. A relative pose without a baseline has derivatives for
    t that are rounding errors themselves.
    """
    n = hessian.shape[0]
    largest, smallest = 0.0, np.inf
    for i in range(n):
        largest, smallest = max(largest, hessian[i, i]), min(smallest, hessian[i, i])
    if not smallest > 0.0 or (n == 5 and smallest < 1e-20 * largest):
        return False
    scaled, basis = np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        for j in range(n):
            scaled[i, j] = hessian[i, j] / np.sqrt(hessian[i, i] * hessian[j, j])
    diagonalise(scaled, basis)
    smallest = np.inf
    for i in range(n):
        smallest = min(smallest, scaled[i, i])
    return smallest > 1e-12


@kernel
def move(model, step, moved):
    """The pose after a step (5,) or (6,) on the manifold."""
    copy_pose(model, moved)
    rotate(moved, step[0], step[1], step[2])
    t0, t1, t2 = model[0, 3], model[1, 3], model[2, 3]
    if step.shape[0] == 6:
        t0, t1, t2 = t0 + step[3], t1 + step[4], t2 + step[5]
    else:
        b0, b1, b2, c0, c1, c2 = tangents(t0, t1, t2)
        t0, t1, t2 = (
            t0 + step[3] * b0 + step[4] * c0,
            t1 + step[3] * b1 + step[4] * c1,
            t2 + step[3] * b2 + step[4] * c2,
        )
        scale = 1.0 / np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
        t0, t1, t2 = scale * t0, scale * t1, scale * t2
    moved[0, 3], moved[1, 3], moved[2, 3] = t0, t1, t2


@kernel
def copy_pose(model, copy):
    """What `copy[:] = model` does; numba takes seconds to compile that, for the message if shapes do not match."""
    for i in range(3):
        for j in range(4):
            copy[i, j] = model[i, j]


@kernel
def normal_equations(columns, weights, threshold, focals, model, slopes, hessian, gradient):
    """Gauss-Newton's matrix J^T W J and gradient J^T W r at a pose; returns the cost."""
    if slopes.ndim == 3:
        essential_directions(model, focals, slopes)
        cost = sampson_equations(columns, weights, threshold, slopes, hessian, gradient)
    else:
        cost = reprojection_equations(columns, weights, threshold, focals[0], model, slopes, hessian, gradient)
    for i in range(hessian.shape[0]):
        for j in range(i):
            hessian[i, j] = hessian[j, i]
    return cost


@kernel
def sampson_equations(columns, weights, threshold, directions, hessian, gradient):
    x, y, u, v = columns[0], columns[1], columns[2], columns[3]
    inverse = 1.0 / (threshold * threshold)
    cost = 0.0
    h00 = h01 = h02 = h03 = h04 = h11 = h12 = h13 = h14 = h22 = h23 = h24 = h33 = h34 = h44 = 0.0
    g0 = g1 = g2 = g3 = g4 = 0.0
    for i in range(x.shape[0]):
        w = weights[i]
        if w == 0.0:
            continue
        r, j0, j1, j2, j3, j4 = sampson_row(directions, x[i], y[i], u[i], v[i])
        loss, w = tukey(w, r * r, inverse)
        cost += loss
        if w == 0.0:
            continue
        w0, w1, w2, w3, w4 = w * j0, w * j1, w * j2, w * j3, w * j4
        h00 += w0 * j0
        h01 += w0 * j1
        h02 += w0 * j2
        h03 += w0 * j3
        h04 += w0 * j4
        h11 += w1 * j1
        h12 += w1 * j2
        h13 += w1 * j3
        h14 += w1 * j4
        h22 += w2 * j2
        h23 += w2 * j3
        h24 += w2 * j4
        h33 += w3 * j3
        h34 += w3 * j4
        h44 += w4 * j4
        g0 += w0 * r
        g1 += w1 * r
        g2 += w2 * r
        g3 += w3 * r
        g4 += w4 * r
    hessian[0, 0], hessian[0, 1], hessian[0, 2], hessian[0, 3], hessian[0, 4] = h00, h01, h02, h03, h04
    hessian[1, 1], hessian[1, 2], hessian[1, 3], hessian[1, 4] = h11, h12, h13, h14
    hessian[2, 2], hessian[2, 3], hessian[2, 4] = h22, h23, h24
    hessian[3, 3], hessian[3, 4], hessian[4, 4] = h33, h34, h44
    gradient[0], gradient[1], gradient[2], gradient[3], gradient[4] = g0, g1, g2, g3, g4
    return cost


@kernel
def reprojection_equations(columns, weights, threshold, focal, model, jacobian, hessian, gradient):
    u, v, x, y, z = columns[0], columns[1], columns[2], columns[3], columns[4]
    scale = 1.0 / (threshold * threshold)
    hessian[:] = 0.0
    gradient[:] = 0.0
    cost = 0.0
    for i in range(u.shape[0]):
        w = weights[i]
        if w == 0.0:
            continue
        r, s, inverse, a, b, c = reprojection_row(model, focal, u[i], v[i], x[i], y[i], z[i])
        loss, w = tukey(w, r * r + s * s, scale)
        cost += loss
        if w == 0.0:
            continue
        reprojection_slopes(focal, inverse, r + u[i], s + v[i], a, b, c, jacobian)
        for j in range(6):
            first, second = w * jacobian[0, j], w * jacobian[1, j]
            gradient[j] += first * r + second * s
            for k in range(j, 6):
                hessian[j, k] += first * jacobian[0, k] + second * jacobian[1, k]
    return cost
