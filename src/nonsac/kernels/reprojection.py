"""Absolute pose: reprojection residuals, inlier counts, derivatives and normal equations."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel


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
def reprojection_row(model, focal, u, v, x, y, z):
    """Where a pose sees a point, less where it was seen, and what their derivatives are made of.

    Returns the two residuals, the inverse depth (0 if the point is not in front), and the moved point less t.
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


@reordered_kernel
def reprojection_residuals(models, columns, residuals):
    """Image distances of M camera poses (M, 3, 4) over `columns` u v X Y Z (5, N), into (M, N).

    Infinite for points that are not in front of the camera.
    """
    u, v, x, y, z = columns[0], columns[1], columns[2], columns[3], columns[4]
    for m in range(models.shape[0]):
        model, row = models[m], residuals[m]
        r00, r01, r02, t0 = model[0, 0], model[0, 1], model[0, 2], model[0, 3]
        r10, r11, r12, t1 = model[1, 0], model[1, 1], model[1, 2], model[1, 3]
        r20, r21, r22, t2 = model[2, 0], model[2, 1], model[2, 2], model[2, 3]
        for i in range(u.shape[0]):
            depth = r20 * x[i] + r21 * y[i] + r22 * z[i] + t2
            a = r00 * x[i] + r01 * y[i] + r02 * z[i] + t0 - u[i] * depth
            b = r10 * x[i] + r11 * y[i] + r12 * z[i] + t1 - v[i] * depth
            row[i] = np.sqrt(a * a + b * b) / depth if depth > 0.0 else (np.inf if depth <= 0.0 else np.nan)


@reordered_kernel
def count_reprojection_inliers(models, columns, squared_threshold, counts):
    """Points in front of the camera with an image distance below the threshold: single precision."""
    u, v, x, y, z = columns[0], columns[1], columns[2], columns[3], columns[4]
    for m in range(models.shape[0]):
        r00, r01, r02, t0 = models[m, 0, 0], models[m, 0, 1], models[m, 0, 2], models[m, 0, 3]
        r10, r11, r12, t1 = models[m, 1, 0], models[m, 1, 1], models[m, 1, 2], models[m, 1, 3]
        r20, r21, r22, t2 = models[m, 2, 0], models[m, 2, 1], models[m, 2, 2], models[m, 2, 3]
        count = np.int32(0)
        for i in range(u.shape[0]):
            depth = r20 * x[i] + r21 * y[i] + r22 * z[i] + t2
            a = r00 * x[i] + r01 * y[i] + r02 * z[i] + t0 - u[i] * depth
            b = r10 * x[i] + r11 * y[i] + r12 * z[i] + t1 - v[i] * depth
            bound = squared_threshold * depth * depth if depth > 0.0 else depth * np.float32(0.0)
            count += np.int32(a * a + b * b < bound)
        counts[m] = count
