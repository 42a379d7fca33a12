"""Least-squares poses of many weighted matches: Levenberg and Marquardt's method on the manifold of poses.

A pose moves by R <- exp([w]x) R and t <- t + d; for relative poses, whose t has length 1, d lies in the tangent plane
of t. So there are five parameters (relative) or six (absolute), and no constraint to enforce.
"""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel
from nonsac.kernels.eigen import diagonalise
from nonsac.kernels.pose_math import orthonormalise, rotate, solve_in_place, tangents


@kernel
def fit_pose(columns, weights, threshold, iterations, focals, model):
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
        False where the weighted rows do not determine a pose; `model` is then where the search got stuck.
    """
    size = 5 if columns.shape[0] == 4 else 6
    system, hessian, gradient = np.empty((size, size + 1)), np.empty((size, size)), np.empty(size)
    directions, step = np.empty((6, 3, 3)), np.empty(size)
    trial = model.copy()
    orthonormalise(model)
    cost = normal_equations(columns, weights, threshold, focals, model, directions, hessian, gradient)
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
        trial_cost = normal_equations(columns, weights, threshold, focals, trial, directions, hessian, gradient)
        if trial_cost <= cost:
            model[:] = trial
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
            normal_equations(columns, weights, threshold, focals, model, directions, hessian, gradient)
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
    moved[:] = model
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
def normal_equations(columns, weights, threshold, focals, model, directions, hessian, gradient):
    """Gauss-Newton's matrix J^T W J and gradient J^T W r at a pose; returns the cost."""
    if columns.shape[0] == 4:
        essential_directions(model, focals, directions)
        cost = sampson_equations(columns, weights, threshold, directions, hessian, gradient)
    else:
        cost = reprojection_equations(columns, weights, threshold, focals[0], model, hessian, gradient)
    for i in range(hessian.shape[0]):
        for j in range(i):
            hessian[i, j] = hessian[j, i]
    return cost


@kernel
def essential_directions(model, focals, directions):
    """E = [t]x R and its derivatives with respect to the five parameters: six matrices (6, 3, 3).

    For image coordinates of length `focals` where they were 1.
    """
    t0, t1, t2 = model[0, 3], model[1, 3], model[2, 3]
    b0, b1, b2, c0, c1, c2 = tangents(t0, t1, t2)
    for c in range(3):
        x, y, z = model[0, c], model[1, c], model[2, c]
        _cross_into(directions[0], c, t0, t1, t2, x, y, z)
        _cross_into(directions[1], c, t0, t1, t2, 0.0, -z, y)
        _cross_into(directions[2], c, t0, t1, t2, z, 0.0, -x)
        _cross_into(directions[3], c, t0, t1, t2, -y, x, 0.0)
        _cross_into(directions[4], c, b0, b1, b2, x, y, z)
        _cross_into(directions[5], c, c0, c1, c2, x, y, z)
    for k in range(6):
        for i in range(2):
            for c in range(3):
                directions[k, i, c] /= focals[1]
                directions[k, c, i] /= focals[0]


@kernel
def _cross_into(matrix, c, a0, a1, a2, x, y, z):
    matrix[0, c] = a1 * z - a2 * y
    matrix[1, c] = a2 * x - a0 * z
    matrix[2, c] = a0 * y - a1 * x


@kernel
def sampson_row(d, x, y, u, v):
    """A signed Sampson residual and its five derivatives, from the matrices of `essential_directions`."""
    a, b = d[0, 0, 0] * x + d[0, 0, 1] * y + d[0, 0, 2], d[0, 1, 0] * x + d[0, 1, 1] * y + d[0, 1, 2]
    c, e = d[0, 0, 0] * u + d[0, 1, 0] * v + d[0, 2, 0], d[0, 0, 1] * u + d[0, 1, 1] * v + d[0, 2, 1]
    square = a * a + b * b + c * c + e * e
    if not square > 0.0:
        return np.inf, 0.0, 0.0, 0.0, 0.0, 0.0
    scale = 1.0 / np.sqrt(square)
    residual = scale * (u * a + v * b + d[0, 2, 0] * x + d[0, 2, 1] * y + d[0, 2, 2])
    pull = residual / square
    a, b, c, e = pull * a, pull * b, pull * c, pull * e
    return (
        residual,
        _sampson_slope(d[1], scale, a, b, c, e, x, y, u, v),
        _sampson_slope(d[2], scale, a, b, c, e, x, y, u, v),
        _sampson_slope(d[3], scale, a, b, c, e, x, y, u, v),
        _sampson_slope(d[4], scale, a, b, c, e, x, y, u, v),
        _sampson_slope(d[5], scale, a, b, c, e, x, y, u, v),
    )


@kernel
def _sampson_slope(d, scale, a, b, c, e, x, y, u, v):
    """Derivative of product / sqrt(a^2 + b^2 + c^2 + e^2) where E changes by d; a to e come times residual / square."""
    da, db = d[0, 0] * x + d[0, 1] * y + d[0, 2], d[1, 0] * x + d[1, 1] * y + d[1, 2]
    dc, de = d[0, 0] * u + d[1, 0] * v + d[2, 0], d[0, 1] * u + d[1, 1] * v + d[2, 1]
    product = u * da + v * db + d[2, 0] * x + d[2, 1] * y + d[2, 2]
    return scale * product - (a * da + b * db + c * dc + e * de)


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
def tukey(weight, square, inverse):
    """Loss and weight of a squared residual: Tukey's biweight, scaled so that it is weight times r^2 for small r.

    `inverse` is one over the squared threshold, 0 for plain least squares.
    """
    if inverse == 0.0:
        return (weight * square, weight) if square < np.inf else (0.0, 0.0)
    share = 1.0 - square * inverse
    if not share > 0.0:
        return weight / (3.0 * inverse), 0.0
    return weight * (1.0 - share * share * share) / (3.0 * inverse), weight * share * share


@kernel
def reprojection_row(model, focal, u, v, x, y, z):
    """Where a pose sees a point, less where it was seen, and what their derivatives are made of.

    Returns the two residuals, the inverse depth (0 where the point is not in front), and the moved point less t.
    """
    a = model[0, 0] * x + model[0, 1] * y + model[0, 2] * z
    b = model[1, 0] * x + model[1, 1] * y + model[1, 2] * z
    c = model[2, 0] * x + model[2, 1] * y + model[2, 2] * z
    depth = c + model[2, 3]
    if not depth > 0.0:
        return np.inf, np.inf, 0.0, a, b, c
    inverse = 1.0 / depth
    scale = focal * inverse
    return scale * (a + model[0, 3]) - u, scale * (b + model[1, 3]) - v, inverse, a, b, c


@kernel
def reprojection_slopes(focal, inverse, p, q, a, b, c, jacobian):
    """Derivatives (2, 6) of an image point (p, q) with respect to w and d: (a, b, c) is R X."""
    scale, along_p, along_q = focal * inverse, -inverse * p, -inverse * q
    first, second = jacobian[0], jacobian[1]
    first[0], first[1], first[2] = b * along_p, c * scale - a * along_p, -b * scale
    first[3], first[4], first[5] = scale, 0.0, along_p
    second[0], second[1], second[2] = b * along_q - c * scale, -a * along_q, a * scale
    second[3], second[4], second[5] = 0.0, scale, along_q


@kernel
def reprojection_equations(columns, weights, threshold, focal, model, hessian, gradient):
    u, v, x, y, z = columns[0], columns[1], columns[2], columns[3], columns[4]
    scale = 1.0 / (threshold * threshold)
    hessian[:] = 0.0
    gradient[:] = 0.0
    jacobian = np.empty((2, 6))
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


@kernel
def sampson_jacobian(columns, focals, model, residuals, jacobian):
    """Signed Sampson residuals (N,) and their derivatives (N, 5)."""
    directions = np.empty((6, 3, 3))
    essential_directions(model, focals, directions)
    for i in range(columns.shape[1]):
        r, j0, j1, j2, j3, j4 = sampson_row(directions, columns[0, i], columns[1, i], columns[2, i], columns[3, i])
        residuals[i] = r
        jacobian[i, 0], jacobian[i, 1], jacobian[i, 2], jacobian[i, 3], jacobian[i, 4] = j0, j1, j2, j3, j4


@kernel
def reprojection_jacobian(columns, focal, model, residuals, jacobian):
    """Residuals (N, 2) of image points and their derivatives (N, 2, 6); 0 for points that are not in front."""
    for i in range(columns.shape[1]):
        u, v = columns[0, i], columns[1, i]
        r, s, inverse, a, b, c = reprojection_row(model, focal, u, v, columns[2, i], columns[3, i], columns[4, i])
        residuals[i, 0], residuals[i, 1] = r, s
        if inverse == 0.0:
            jacobian[i, :] = 0.0
        else:
            reprojection_slopes(focal, inverse, r + u, s + v, a, b, c, jacobian[i])
