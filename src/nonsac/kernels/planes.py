"""Planes through the neighbourhoods of points."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel
from nonsac.kernels.eigen import diagonalise


@kernel
def fit_planes(points, neighbors, moved, normals, variation):
    """Fit a plane to each neighbourhood by principal components.

    Parameters
    ----------
    points : (n, 3) float64
    neighbors : (n, k) int64, the numbers of each point's nearest points, itself included
    moved : (n, 3) float64, receives each point's foot on its plane
    normals : (n, 3) float64, receives the planes' unit normals, of arbitrary sign
    variation : (n,) float64, receives the share of the variance that lies across the plane
    """
    mean = np.empty(3)
    scatter = np.empty((3, 3))
    basis = np.empty((3, 3))
    count = neighbors.shape[1]
    for i in range(points.shape[0]):
        mean[:] = 0.0
        for k in range(count):
            for c in range(3):
                mean[c] += points[neighbors[i, k], c] / count
        scatter[:] = 0.0
        for k in range(count):
            for r in range(3):
                for c in range(r + 1):
                    scatter[r, c] += (points[neighbors[i, k], r] - mean[r]) * (points[neighbors[i, k], c] - mean[c])
        scatter[0, 1], scatter[0, 2], scatter[1, 2] = scatter[1, 0], scatter[2, 0], scatter[2, 1]
        diagonalise(scatter, basis)
        least = 0
        for c in range(1, 3):
            if scatter[c, c] < scatter[least, least]:
                least = c
        total = scatter[0, 0] + scatter[1, 1] + scatter[2, 2]
        variation[i] = max(0.0, scatter[least, least]) / total if total > 0.0 else 0.0
        height = 0.0
        for c in range(3):
            normals[i, c] = basis[c, least]
            height += basis[c, least] * (points[i, c] - mean[c])
        for c in range(3):
            moved[i, c] = points[i, c] - height * basis[c, least]
