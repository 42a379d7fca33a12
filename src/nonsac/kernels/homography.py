"""How well homographies explain matches."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import reordered_kernel


@reordered_kernel
def homography_errors(homographies, columns, focal1, focal2, errors):
    """How far x2 is from where homographies (M, 3, 3) see x1, for matches `columns` (4, N), into (M, N).

    The matches are in normalised coordinates, the errors in pixels, divided by the standard deviation that they have in
    each direction if noise is 1 pixel in both images: that of x1 is magnified by the square root of the homography's
    change of area. NaN if x1 is not seen in front of the second camera.
    """
    x, y, u, v = columns[0], columns[1], columns[2], columns[3]
    ratio = focal2 / focal1
    for m in range(homographies.shape[0]):
        h, row = homographies[m], errors[m]
        h00, h01, h02, h10, h11, h12 = h[0, 0], h[0, 1], h[0, 2], h[1, 0], h[1, 1], h[1, 2]
        h20, h21, h22 = h[2, 0], h[2, 1], h[2, 2]
        size = h00 * (h11 * h22 - h12 * h21) - h01 * (h10 * h22 - h12 * h20) + h02 * (h10 * h21 - h11 * h20)
        area = ratio * ratio * abs(size)
        for i in range(x.shape[0]):
            depth = h20 * x[i] + h21 * y[i] + h22
            inverse = 1.0 / depth
            a, b = (h00 * x[i] + h01 * y[i] + h02) * inverse - u[i], (h10 * x[i] + h11 * y[i] + h12) * inverse - v[i]
            error = focal2 * np.sqrt((a * a + b * b) / (1.0 + area * inverse * inverse * inverse))
            row[i] = error if depth > 0.0 else np.nan
