"""Residuals and inlier counts of many models over many rows."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel
from nonsac.kernels.pose_math import tangents


@kernel
def epipolar_geometries(models, focal1, focal2, geometries):
    """What the residuals of M relative poses (M, 3, 4) need, in (M, 8, 3), for image coordinates in pixels.

    Rows 0 to 2: E = [t]x R; 3 to 5: R, which turns (x, y, 1) of the first camera into a ray in the second; 6: t;
    7: the inverse of the second focal length, of the squared first one, and the product of both.
    """
    for m in range(models.shape[0]):
        model, geometry = models[m], geometries[m]
        t0, t1, t2 = model[0, 3], model[1, 3], model[2, 3]
        for c in range(3):
            a, b, d = model[0, c], model[1, c], model[2, c]
            scale = 1.0 / focal1 if c < 2 else 1.0
            geometry[0, c] = scale * (t1 * d - t2 * b) / focal2
            geometry[1, c] = scale * (t2 * a - t0 * d) / focal2
            geometry[2, c] = scale * (t0 * b - t1 * a)
            geometry[3, c], geometry[4, c], geometry[5, c] = scale * a, scale * b, scale * d
            geometry[6, c] = model[c, 3]
        geometry[7, 0], geometry[7, 1], geometry[7, 2] = 1.0 / focal2, 1.0 / focal1**2, focal1 * focal2


@reordered_kernel
def epipolar_residuals(geometries, columns, residuals):
    """Distances of matches `columns` (4, N) from M epipolar geometries (M, 8, 3), into (M, N).

    Sampson's first-order distance; for a match whose rays meet behind a camera, the angle between its rays, as a
    distance in the image: the nearest match that fits is a point at infinity. Infinite if both points lie at the
    epipoles: such a match fits everything, so it speaks for nothing.
    """
    x, y, u, v = columns[0], columns[1], columns[2], columns[3]
    for m in range(geometries.shape[0]):
        g, row = geometries[m], residuals[m]
        e00, e01, e02, e10, e11, e12 = g[0, 0], g[0, 1], g[0, 2], g[1, 0], g[1, 1], g[1, 2]
        e20, e21, e22, t0, t1, t2 = g[2, 0], g[2, 1], g[2, 2], g[6, 0], g[6, 1], g[6, 2]
        r00, r01, r02, r10, r11, r12 = g[3, 0], g[3, 1], g[3, 2], g[4, 0], g[4, 1], g[4, 2]
        r20, r21, r22, inverse, square1, product = g[5, 0], g[5, 1], g[5, 2], g[7, 0], g[7, 1], g[7, 2]
        for i in range(x.shape[0]):
            a, b = e00 * x[i] + e01 * y[i] + e02, e10 * x[i] + e11 * y[i] + e12
            c, d = e00 * u[i] + e10 * v[i] + e20, e01 * u[i] + e11 * v[i] + e21
            off = u[i] * a + v[i] * b + e20 * x[i] + e21 * y[i] + e22
            square = a * a + b * b + c * c + d * d
            sampson = abs(off) / np.sqrt(square) if square != 0.0 else np.inf
            # The ray of the first camera, turned, (p, q, s); of the second, (k, l, 1); and their cross product.
            p, q, s = r00 * x[i] + r01 * y[i] + r02, r10 * x[i] + r11 * y[i] + r12, r20 * x[i] + r21 * y[i] + r22
            k, l = inverse * u[i], inverse * v[i]  # noqa: E741
            n0, n1, n2 = q - s * l, s * k - p, p * l - q * k
            first, second = square1 * (x[i] * x[i] + y[i] * y[i]) + 1.0, k * k + l * l + 1.0
            both, along1, along2 = k * p + l * q + s, t0 * p + t1 * q + t2 * s, t0 * k + t1 * l + t2
            behind = (along1 * second > along2 * both) | (along1 * both > along2 * first)
            angle = np.sqrt(product * (n0 * n0 + n1 * n1 + n2 * n2) / (first * second)) if both > 0.0 else np.inf
            row[i] = max(angle, sampson) if behind else sampson


@reordered_kernel
def count_epipolar_inliers(geometries, columns, counts):
    """Matches with a residual, as above, below 1: single precision, in units of the threshold."""
    x, y, u, v = columns[0], columns[1], columns[2], columns[3]
    for m in range(geometries.shape[0]):
        g = geometries[m]
        e00, e01, e02, e10, e11, e12 = g[0, 0], g[0, 1], g[0, 2], g[1, 0], g[1, 1], g[1, 2]
        e20, e21, e22, t0, t1, t2 = g[2, 0], g[2, 1], g[2, 2], g[6, 0], g[6, 1], g[6, 2]
        r00, r01, r02, r10, r11, r12 = g[3, 0], g[3, 1], g[3, 2], g[4, 0], g[4, 1], g[4, 2]
        r20, r21, r22, inverse, square1, product = g[5, 0], g[5, 1], g[5, 2], g[7, 0], g[7, 1], g[7, 2]
        zero, one = np.float32(0.0), np.float32(1.0)
        count = np.int32(0)
        for i in range(x.shape[0]):
            a, b = e00 * x[i] + e01 * y[i] + e02, e10 * x[i] + e11 * y[i] + e12
            c, d = e00 * u[i] + e10 * v[i] + e20, e01 * u[i] + e11 * v[i] + e21
            off = u[i] * a + v[i] * b + e20 * x[i] + e21 * y[i] + e22
            near = off * off < a * a + b * b + c * c + d * d
            p, q, s = r00 * x[i] + r01 * y[i] + r02, r10 * x[i] + r11 * y[i] + r12, r20 * x[i] + r21 * y[i] + r22
            k, l = inverse * u[i], inverse * v[i]  # noqa: E741
            n0, n1, n2 = q - s * l, s * k - p, p * l - q * k
            first, second = square1 * (x[i] * x[i] + y[i] * y[i]) + one, k * k + l * l + one
            both, along1, along2 = k * p + l * q + s, t0 * p + t1 * q + t2 * s, t0 * k + t1 * l + t2
            depth1, depth2 = along2 * both - along1 * second, along2 * first - along1 * both
            # Of the same sign as the two depths; a distant point may have either.
            distant = first * second - product * (n0 * n0 + n1 * n1 + n2 * n2)
            distant = distant if both > zero else -one
            depth1 = depth1 if depth1 < depth2 else depth2
            count += np.int32(near & ((depth1 >= zero) | (distant > zero)))
        counts[m] = count


@reordered_kernel
def sampson_equations(columns, weights, curvatures, directions, hessian, gradient):
    """For matches (4, N) in pixels and the matrices of `essential_directions`: adds to (5, 5) and (5,)."""
    x, y, u, v = columns[0], columns[1], columns[2], columns[3]
    slopes = np.empty(5)
    for i in range(weights.shape[0]):
        w, h = weights[i], curvatures[i]
        if w == 0.0:
            continue
        r, slopes[0], slopes[1], slopes[2], slopes[3], slopes[4] = sampson_row(directions, x[i], y[i], u[i], v[i])
        for j in range(5):
            gradient[j] += w * r * slopes[j]
            scaled = h * slopes[j]
            for k in range(j, 5):
                hessian[j, k] += scaled * slopes[k]


@kernel
def essential_directions(model, focals, directions):
    """E = [t]x R and its derivatives with respect to the five parameters: six matrices (6, 3, 3).

    For image coordinates of length `focals` that had length 1.
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
    """Derivative of product / sqrt(a^2 + b^2 + c^2 + e^2) if E changes by d; a to e come times residual / square."""
    da, db = d[0, 0] * x + d[0, 1] * y + d[0, 2], d[1, 0] * x + d[1, 1] * y + d[1, 2]
    dc, de = d[0, 0] * u + d[1, 0] * v + d[2, 0], d[0, 1] * u + d[1, 1] * v + d[2, 1]
    product = u * da + v * db + d[2, 0] * x + d[2, 1] * y + d[2, 2]
    return scale * product - (a * da + b * db + c * dc + e * de)


@kernel
def sampson_jacobian(columns, focals, model, residuals, jacobian):
    """Signed Sampson residuals (N,) and their derivatives (N, 5)."""
    directions = np.empty((6, 3, 3))
    essential_directions(model, focals, directions)
    for i in range(columns.shape[1]):
        r, j0, j1, j2, j3, j4 = sampson_row(directions, columns[0, i], columns[1, i], columns[2, i], columns[3, i])
        residuals[i] = r
        jacobian[i, 0], jacobian[i, 1], jacobian[i, 2], jacobian[i, 3], jacobian[i, 4] = j0, j1, j2, j3, j4
