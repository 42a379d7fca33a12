"""Many thresholds at once: each is the square root of two times the one below it."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel


@kernel
def count_on_ladder(residuals, lowest, few, counts):
    """Residuals (M, N) below each threshold lowest * 2^(j / 2), into `counts` (M, L).

    Where no more than `few` are, smaller thresholds have none.
    """
    squares = np.empty(residuals.shape[1], np.float32)
    inverse = 1.0 / lowest
    for m in range(residuals.shape[0]):
        row = residuals[m]
        for i in range(row.shape[0]):
            scaled = row[i] * inverse
            squares[i] = np.float32(scaled * scaled)
        count_squares(squares, few, counts[m])


@kernel
def count_squares(squares, few, counts):
    """How many of some squares are below 2^j, for each j (L,), from the largest down; none below `few` or fewer.

    Comparing all with one bound after the other takes less time than sorting them into bins.
    """
    bound, last = np.float32(2.0 ** (counts.shape[0] - 1)), squares.shape[0]
    for back in range(counts.shape[0]):
        if last > few:
            count = np.int32(0)
            for i in range(squares.shape[0]):
                count += np.int32(squares[i] < bound)
            last = count
            bound *= np.float32(0.5)
        else:
            last = 0
        counts[counts.shape[0] - 1 - back] = last


@reordered_kernel
def reprojection_ladder(models, columns, square, few, counts):
    """`count_on_ladder` of `reprojection_residuals`: single precision; `square` is one over the squared threshold."""
    u, v, x, y, z = columns[0], columns[1], columns[2], columns[3], columns[4]
    n = u.shape[0]
    squares = np.empty(n, np.float32)
    zero, far = np.float32(0.0), np.float32(1e30)
    for m in range(models.shape[0]):
        r00, r01, r02, t0 = models[m, 0, 0], models[m, 0, 1], models[m, 0, 2], models[m, 0, 3]
        r10, r11, r12, t1 = models[m, 1, 0], models[m, 1, 1], models[m, 1, 2], models[m, 1, 3]
        r20, r21, r22, t2 = models[m, 2, 0], models[m, 2, 1], models[m, 2, 2], models[m, 2, 3]
        for i in range(n):
            depth = r20 * x[i] + r21 * y[i] + r22 * z[i] + t2
            a = r00 * x[i] + r01 * y[i] + r02 * z[i] + t0 - u[i] * depth
            b = r10 * x[i] + r11 * y[i] + r12 * z[i] + t1 - v[i] * depth
            squares[i] = square * (a * a + b * b) / (depth * depth) if depth > zero else far
        count_squares(squares, few, counts[m])


@reordered_kernel
def registration_ladder(models, columns, few, counts):
    """`count_on_ladder` of `registration_residuals`: single precision, in units of the lowest threshold."""
    ax, ay, az, bx, by, bz = columns[0], columns[1], columns[2], columns[3], columns[4], columns[5]
    n = ax.shape[0]
    squares = np.empty(n, np.float32)
    for m in range(models.shape[0]):
        r00, r01, r02, t0 = models[m, 0, 0], models[m, 0, 1], models[m, 0, 2], models[m, 0, 3]
        r10, r11, r12, t1 = models[m, 1, 0], models[m, 1, 1], models[m, 1, 2], models[m, 1, 3]
        r20, r21, r22, t2 = models[m, 2, 0], models[m, 2, 1], models[m, 2, 2], models[m, 2, 3]
        for i in range(n):
            x = r00 * ax[i] + r01 * ay[i] + r02 * az[i] + t0 - bx[i]
            y = r10 * ax[i] + r11 * ay[i] + r12 * az[i] + t1 - by[i]
            z = r20 * ax[i] + r21 * ay[i] + r22 * az[i] + t2 - bz[i]
            squares[i] = x * x + y * y + z * z
        count_squares(squares, few, counts[m])


@reordered_kernel
def epipolar_ladder(geometries, columns, few, counts):
    """`count_on_ladder` of `epipolar_residuals`, in single precision and in units of the lowest threshold."""
    x, y, u, v = columns[0], columns[1], columns[2], columns[3]
    n = x.shape[0]
    squares = np.empty(n, np.float32)
    zero, far = np.float32(0.0), np.float32(1e30)
    for m in range(geometries.shape[0]):
        g = geometries[m]
        e00, e01, e02, e10, e11, e12 = g[0, 0], g[0, 1], g[0, 2], g[1, 0], g[1, 1], g[1, 2]
        e20, e21, e22, t0, t1, t2 = g[2, 0], g[2, 1], g[2, 2], g[6, 0], g[6, 1], g[6, 2]
        r00, r01, r02, r10, r11, r12 = g[3, 0], g[3, 1], g[3, 2], g[4, 0], g[4, 1], g[4, 2]
        r20, r21, r22, inverse, square1, product = g[5, 0], g[5, 1], g[5, 2], g[7, 0], g[7, 1], g[7, 2]
        one = np.float32(1.0)
        for i in range(n):
            a, b = e00 * x[i] + e01 * y[i] + e02, e10 * x[i] + e11 * y[i] + e12
            c, d = e00 * u[i] + e10 * v[i] + e20, e01 * u[i] + e11 * v[i] + e21
            off = u[i] * a + v[i] * b + e20 * x[i] + e21 * y[i] + e22
            size = a * a + b * b + c * c + d * d
            sampson = off * off / size if size > zero else far
            p, q, s = r00 * x[i] + r01 * y[i] + r02, r10 * x[i] + r11 * y[i] + r12, r20 * x[i] + r21 * y[i] + r22
            k, l = inverse * u[i], inverse * v[i]  # noqa: E741
            n0, n1, n2 = q - s * l, s * k - p, p * l - q * k
            first, second = square1 * (x[i] * x[i] + y[i] * y[i]) + one, k * k + l * l + one
            both, along1, along2 = k * p + l * q + s, t0 * p + t1 * q + t2 * s, t0 * k + t1 * l + t2
            depth1, depth2 = along2 * both - along1 * second, along2 * first - along1 * both
            depth1 = depth1 if depth1 < depth2 else depth2
            angle = product * (n0 * n0 + n1 * n1 + n2 * n2) / (first * second)
            angle = angle if both > zero else far
            behind = angle if angle > sampson else sampson
            squares[i] = sampson if depth1 >= zero else behind
        count_squares(squares, few, counts[m])


@kernel
def best_on_ladder(counts, rows, fitted, chance, dimension, scores, best):
    """For each threshold the model whose count is least likely by chance, and minus the logarithm of that chance.

    A row is within a threshold by chance as often as `chance` (L,) says, or as the rows between this threshold and
    those two and four times as large are dense, in as many dimensions: the larger one. `fitted` rows are within
    anyway. The bound is Hoeffding's; `scores` and `best` are (L - 4,), as the last thresholds are surroundings only.
    """
    scores[:] = 0.0
    best[:] = -1
    inside2, inside4 = 1.0 / (2.0**dimension - 1.0), 1.0 / (4.0**dimension - 1.0)
    free = rows - fitted
    for m in range(counts.shape[0]):
        for j in range(scores.shape[0]):
            count = counts[m, j]
            share = (count - fitted) / free
            rate = max(
                chance[j],
                (counts[m, j + 2] - count + 0.5) * inside2 / rows,
                (counts[m, j + 4] - count + 0.5) * inside4 / rows,
            )
            if share <= rate:
                continue
            score = free * share * np.log(share / rate)
            if share < 1.0:
                score += free * (1.0 - share) * np.log((1.0 - share) / (1.0 - rate))
            if score > scores[j]:
                scores[j] = score
                best[j] = m


@kernel
def likelihood_ratios(residuals, thresholds, chance, peak, few, ratios):
    """How much likelier residuals (N,) are if some are of inliers than if all are there by chance; the logarithms (L,).

    For each threshold, inliers have Gaussian errors of a fifth of it, and rows within it by chance, as many as `chance`
    (L,) says, are evenly spread. `peak` is how much denser inliers are at 0 than rows evenly spread. The share of
    inliers is found by two steps of expectation maximisation. Minus infinity where no more than `few` are within.
    """
    n = residuals.shape[0]
    relative = np.empty(n)
    for j in range(thresholds.shape[0]):
        near = 0
        for i in range(n):
            if residuals[i] < thresholds[j]:
                scaled = residuals[i] / thresholds[j]
                relative[near] = peak / chance[j] * np.exp(-12.5 * scaled * scaled)
                near += 1
        ratios[j] = -np.inf
        if near <= few:
            continue
        share = max(near / n - chance[j], 1e-3)
        for _ in range(2):
            inliers = 0.0
            for i in range(near):
                inliers += share * relative[i] / (share * relative[i] + 1.0 - share)
            share = min(max(inliers / n, 1e-6), 0.999)
        ratios[j] = (n - near) * np.log(1.0 - share)
        for i in range(near):
            ratios[j] += np.log(share * relative[i] + 1.0 - share)
