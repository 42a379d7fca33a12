"""Residuals and inlier counts of many registration models over many rows."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import reordered_kernel


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
