"""Gauss-Newton's normal equations of many rows, summed so that pieces of the data can be added up.

The rows have one weight in the gradient and another in the matrix: the second derivative of a robust loss is not its
weight. Rows of weight zero are passed over.
"""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel


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


@kernel
def mirror(hessian):
    """Fill the lower half of a symmetric matrix."""
    for i in range(hessian.shape[0]):
        for j in range(i):
            hessian[i, j] = hessian[j, i]


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
