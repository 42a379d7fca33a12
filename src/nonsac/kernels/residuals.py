"""Residuals and inlier counts of many models over many rows."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel


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
    distance in the image: the nearest match that fits is a point at infinity. Infinite where both points lie at the
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
