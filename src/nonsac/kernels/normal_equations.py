"""Gauss-Newton's normal equations of many rows, summed so that pieces of the data can be added up.

The rows have one weight in the gradient and another in the matrix: the second derivative of a robust loss is not its
weight. Rows of weight zero are passed over.
"""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel
from nonsac.kernels.pose_fit import reprojection_row, reprojection_slopes, sampson_row


@kernel
def likely_inliers(residuals, noise, odds, dimension, weights, curvatures):
    """How likely rows are to be inliers, tapered to zero at ten standard deviations: real errors have long tails.

    An inlier has a Gaussian error in each of `dimension` directions; at residual 0 others are `odds` times as frequent,
    and evenly spread. `curvatures` are what the second derivative of the loss has for each J^T J, averaged over the
    directions of the residual: w + 2 / d r^2 dw / d(r^2).
    """
    inverse, end = 1.0 / (noise * noise), 0.01 / (noise * noise)
    weights[:] = 0.0
    curvatures[:] = 0.0
    for i in range(residuals.shape[0]):
        if not residuals[i] < 10.0 * noise:
            continue
        square = residuals[i] * residuals[i]
        share = 1.0 - square * end
        likely = 1.0 / (1.0 + odds * np.exp(0.5 * square * inverse))
        weight = share * share * likely
        slope = -weight * (2.0 * end / share + 0.5 * inverse * (1.0 - likely))
        weights[i] = weight
        curvatures[i] = weight + 2.0 / dimension * square * slope


@reordered_kernel
def registration_equations(columns, weights, curvatures, model, pivot, sums):
    """For rows a b (6, N): adds to the 17 `sums` that `registration_matrix` makes the equations of.

    With m = s R (a - pivot) and r = s R a + t - b: of h, h m, h m m^T (upper half), w r, w m x r and w m . r.
    """
    t0, t1, t2 = model[0, 3], model[1, 3], model[2, 3]
    for c in range(3):
        t0 += model[0, c] * pivot[c]
        t1 += model[1, c] * pivot[c]
        t2 += model[2, c] * pivot[c]
    r00, r01, r02 = model[0, 0], model[0, 1], model[0, 2]
    r10, r11, r12 = model[1, 0], model[1, 1], model[1, 2]
    r20, r21, r22 = model[2, 0], model[2, 1], model[2, 2]
    ax, ay, az, bx, by, bz = columns[0], columns[1], columns[2], columns[3], columns[4], columns[5]
    h0 = h1 = h2 = h3 = h4 = h5 = h6 = h7 = h8 = h9 = g0 = g1 = g2 = g3 = g4 = g5 = g6 = 0.0
    for i in range(weights.shape[0]):
        w, h = weights[i], curvatures[i]
        if w == 0.0:
            continue
        a, b, c = ax[i] - pivot[0], ay[i] - pivot[1], az[i] - pivot[2]
        x = r00 * a + r01 * b + r02 * c
        y = r10 * a + r11 * b + r12 * c
        z = r20 * a + r21 * b + r22 * c
        p, q, s = w * (x + t0 - bx[i]), w * (y + t1 - by[i]), w * (z + t2 - bz[i])
        hx, hy, hz = h * x, h * y, h * z
        h0 += h
        h1 += hx
        h2 += hy
        h3 += hz
        h4 += hx * x
        h5 += hx * y
        h6 += hx * z
        h7 += hy * y
        h8 += hy * z
        h9 += hz * z
        g0 += p
        g1 += q
        g2 += s
        g3 += y * s - z * q
        g4 += z * p - x * s
        g5 += x * q - y * p
        g6 += x * p + y * q + z * s
    sums[0] += h0
    sums[1] += h1
    sums[2] += h2
    sums[3] += h3
    sums[4] += h4
    sums[5] += h5
    sums[6] += h6
    sums[7] += h7
    sums[8] += h8
    sums[9] += h9
    sums[10] += g0
    sums[11] += g1
    sums[12] += g2
    sums[13] += g3
    sums[14] += g4
    sums[15] += g5
    sums[16] += g6


@kernel
def registration_matrix(sums, free_scale, hessian, gradient):
    """The equations (6 or 7) for w (R becomes exp([w]x) R about the pivot), t and perhaps log s, from the 17 sums."""
    h, x, y, z = sums[0], sums[1], sums[2], sums[3]
    xx, xy, xz, yy, yz, zz = sums[4], sums[5], sums[6], sums[7], sums[8], sums[9]
    hessian[:] = 0.0
    hessian[0, 0], hessian[0, 1], hessian[0, 2] = yy + zz, -xy, -xz
    hessian[1, 1], hessian[1, 2], hessian[2, 2] = xx + zz, -yz, xx + yy
    hessian[0, 4], hessian[0, 5], hessian[1, 3] = -z, y, z
    hessian[1, 5], hessian[2, 3], hessian[2, 4] = -x, -y, x
    hessian[3, 3] = hessian[4, 4] = hessian[5, 5] = h
    if free_scale:
        hessian[3, 6], hessian[4, 6], hessian[5, 6], hessian[6, 6] = x, y, z, xx + yy + zz
        gradient[6] = sums[16]
    for c in range(3):
        gradient[c], gradient[3 + c] = sums[13 + c], sums[10 + c]
    mirror(hessian)


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


@reordered_kernel
def reprojection_equations(columns, weights, curvatures, focal, model, hessian, gradient):
    """For points (5, N), image coordinates in pixels: adds to (6, 6) and (6,)."""
    u, v, x, y, z = columns[0], columns[1], columns[2], columns[3], columns[4]
    slopes = np.empty((2, 6))
    for i in range(weights.shape[0]):
        w, h = weights[i], curvatures[i]
        if w == 0.0:
            continue
        r, s, inverse, a, b, c = reprojection_row(model, focal, u[i], v[i], x[i], y[i], z[i])
        reprojection_slopes(focal, inverse, r + u[i], s + v[i], a, b, c, slopes)
        for j in range(6):
            first, second = slopes[0, j], slopes[1, j]
            gradient[j] += w * (first * r + second * s)
            first, second = h * first, h * second
            for k in range(j, 6):
                hessian[j, k] += first * slopes[0, k] + second * slopes[1, k]


@kernel
def mirror(hessian):
    """Fill the lower half of a symmetric matrix."""
    for i in range(hessian.shape[0]):
        for j in range(i):
            hessian[i, j] = hessian[j, i]
