"""Small steps that the pose kernels share."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel


@kernel
def tangents(t0, t1, t2):
    """Two unit vectors, orthogonal to each other and to the unit vector t."""
    if abs(t0) < 0.6:
        b0, b1, b2 = 0.0, t2, -t1
    else:
        b0, b1, b2 = -t2, 0.0, t0
    scale = 1.0 / np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
    b0, b1, b2 = scale * b0, scale * b1, scale * b2
    return b0, b1, b2, t1 * b2 - t2 * b1, t2 * b0 - t0 * b2, t0 * b1 - t1 * b0


@kernel
def rotate(model, x, y, z):
    """R <- exp([w]x) R for w = (x, y, z), through the unit quaternion."""
    square = x * x + y * y + z * z
    if square < 1e-8:
        half, cosine = 0.5 - square / 48.0, 1.0 - square / 8.0
    else:
        angle = np.sqrt(square)
        half, cosine = np.sin(0.5 * angle) / angle, np.cos(0.5 * angle)
    scale = 1.0 / np.sqrt(cosine * cosine + half * half * square)
    w, x, y, z = scale * cosine, scale * half * x, scale * half * y, scale * half * z
    for c in range(3):
        a, b, d = model[0, c], model[1, c], model[2, c]
        model[0, c] = (1.0 - 2.0 * (y * y + z * z)) * a + 2.0 * (x * y - w * z) * b + 2.0 * (x * z + w * y) * d
        model[1, c] = 2.0 * (x * y + w * z) * a + (1.0 - 2.0 * (x * x + z * z)) * b + 2.0 * (y * z - w * x) * d
        model[2, c] = 2.0 * (x * z - w * y) * a + 2.0 * (y * z + w * x) * b + (1.0 - 2.0 * (x * x + y * y)) * d


@kernel
def orthonormalise(model):
    """Gram and Schmidt on the rows of R, which is nearly a rotation."""
    for i in range(2):
        norm = 0.0
        for c in range(3):
            norm += model[i, c] * model[i, c]
        norm = 1.0 / np.sqrt(norm)
        for c in range(3):
            model[i, c] *= norm
        if i == 0:
            product = model[0, 0] * model[1, 0] + model[0, 1] * model[1, 1] + model[0, 2] * model[1, 2]
            for c in range(3):
                model[1, c] -= product * model[0, c]
    model[2, 0] = model[0, 1] * model[1, 2] - model[0, 2] * model[1, 1]
    model[2, 1] = model[0, 2] * model[1, 0] - model[0, 0] * model[1, 2]
    model[2, 2] = model[0, 0] * model[1, 1] - model[0, 1] * model[1, 0]


@kernel
def solve_in_place(system):
    """Solve a small linear system (n, n + 1) by elimination with partial pivoting; the solution is the last column."""
    n = system.shape[0]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(system[i, k]) > abs(system[pivot, k]):
                pivot = i
        if not abs(system[pivot, k]) > 1e-300:
            return False
        if pivot != k:
            for c in range(k, n + 1):
                system[k, c], system[pivot, c] = system[pivot, c], system[k, c]
        inverse = 1.0 / system[k, k]
        for c in range(k, n + 1):
            system[k, c] *= inverse
        for i in range(n):
            if i != k:
                factor = system[i, k]
                for c in range(k, n + 1):
                    system[i, c] -= factor * system[k, c]
    return True
