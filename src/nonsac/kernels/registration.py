"""Registration of 3D points: residuals, inlier counts and normal equations."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel
from nonsac.kernels.losses import mirror


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
def registration_residuals(models, columns, residuals):
    """Distances |A a + t - b| of M models [A | t] (M, 3, 4) over `columns` (6, N) into `residuals` (M, N)."""
    ax, ay, az, bx, by, bz = columns[0], columns[1], columns[2], columns[3], columns[4], columns[5]
    for m in range(models.shape[0]):
        model = models[m]
        row = residuals[m]
        for i in range(ax.shape[0]):
            x = model[0, 0] * ax[i] + model[0, 1] * ay[i] + model[0, 2] * az[i] + model[0, 3] - bx[i]
            y = model[1, 0] * ax[i] + model[1, 1] * ay[i] + model[1, 2] * az[i] + model[1, 3] - by[i]
            z = model[2, 0] * ax[i] + model[2, 1] * ay[i] + model[2, 2] * az[i] + model[2, 3] - bz[i]
            row[i] = np.sqrt(x * x + y * y + z * z)


@reordered_kernel
def count_registration_inliers(models, columns, squared_threshold, counts):
    """Rows within the threshold of each model: single precision, so the caller shifts the data near the origin."""
    ax, ay, az, bx, by, bz = columns[0], columns[1], columns[2], columns[3], columns[4], columns[5]
    for m in range(models.shape[0]):
        r00, r01, r02, t0 = models[m, 0, 0], models[m, 0, 1], models[m, 0, 2], models[m, 0, 3]
        r10, r11, r12, t1 = models[m, 1, 0], models[m, 1, 1], models[m, 1, 2], models[m, 1, 3]
        r20, r21, r22, t2 = models[m, 2, 0], models[m, 2, 1], models[m, 2, 2], models[m, 2, 3]
        count = np.int32(0)
        for i in range(ax.shape[0]):
            x = r00 * ax[i] + r01 * ay[i] + r02 * az[i] + t0 - bx[i]
            y = r10 * ax[i] + r11 * ay[i] + r12 * az[i] + t1 - by[i]
            z = r20 * ax[i] + r21 * ay[i] + r22 * az[i] + t2 - bz[i]
            count += np.int32(x * x + y * y + z * z < squared_threshold)
        counts[m] = count
