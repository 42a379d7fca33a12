"""Which correspondences agree with which others on the distance between their two points."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel


@reordered_kernel
def count_consistent_distances(columns, tolerance, counts):
    """For each row, with how many other rows it agrees: ||a_i - a_j| - |b_i - b_j|| < tolerance.

    `columns` is (6, N) single precision, `counts` (N,) int32. Every pair is visited once and none is stored. The
    test needs no square root: with A = |a_i - a_j|^2, B = |b_i - b_j|^2 and s = A + B - tolerance^2 it reads
    s < 2 sqrt(A B), that is s < 0 or s^2 < 4 A B.
    """
    n = columns.shape[1]
    squared_tolerance = tolerance * tolerance
    counts[:] = 0
    # Blocks of 512 rows in one local buffer with fixed offsets, and an inner loop from zero: only so does the compiler
    # prove that nothing overlaps and no index is negative, and vectorises (0.5 instead of 4.2 ns a pair).
    # Counts are floats there, exact far beyond 512, since turning masks of floats into integers costs as much again.
    block = np.zeros(6 * 512, np.float32)
    block_counts = np.zeros(512, np.float32)
    zero, one, four = np.float32(0.0), np.float32(1.0), np.float32(4.0)
    for start in range(0, n, 512):
        width = min(512, n - start)
        for c in range(6):
            for j in range(width):
                block[512 * c + j] = columns[c, start + j]
        block_counts[:] = zero
        for i in range(start + width):
            x, y, z, u, v, w = columns[0, i], columns[1, i], columns[2, i], columns[3, i], columns[4, i], columns[5, i]
            before = one if i < start else zero  # pairs inside the block are met from both sides
            own = zero
            for j in range(width):
                dx, dy, dz = block[j] - x, block[512 + j] - y, block[1024 + j] - z
                ex, ey, ez = block[1536 + j] - u, block[2048 + j] - v, block[2560 + j] - w
                a = dx * dx + dy * dy + dz * dz
                b = ex * ex + ey * ey + ez * ez
                s = a + b - squared_tolerance
                s = zero if s < zero else s
                agrees = one if s * s - four * a * b <= zero else zero  # not true of infinities
                block_counts[j] += before * agrees
                own += agrees
            itself = np.int32(0) if i < start or own == zero else np.int32(1)
            counts[i] += np.int32(own) - itself
        for j in range(width):
            counts[start + j] += np.int32(block_counts[j])


@kernel
def count_consistent_ratios(columns, known, log_scale, tolerance, counts):
    """For each row, with how many other rows it agrees on the log ratio ln(|b_i - b_j| / |a_i - a_j|).

    If the scale is known, the ratios within `tolerance` of `log_scale` count. If it is not, each row takes the
    scale that most of its ratios share: the fullest window of width 2 `tolerance` in the row's own histogram.
    """
    n = columns.shape[1]
    half_range = 4.0  # ratios beyond e^4 = 55 are never consistent
    bins = int(2.0 * half_range / tolerance) + 1
    histogram = np.empty(bins, np.int32)
    for i in range(n):
        histogram[:] = 0
        own = 0
        for j in range(n):
            a = 0.0
            b = 0.0
            for c in range(3):
                a += (columns[c, j] - columns[c, i]) ** 2
                b += (columns[3 + c, j] - columns[3 + c, i]) ** 2
            if not (a > 0.0 and b > 0.0):
                continue
            ratio = 0.5 * np.log(b / a)
            if known:
                own += abs(ratio - log_scale) < tolerance
            elif abs(ratio) < half_range:
                histogram[int((ratio + half_range) / tolerance)] += 1
        if not known:
            for k in range(1, bins):
                own = max(own, histogram[k - 1] + histogram[k])
        counts[i] = own


@kernel
def sum_consistent_ratios(columns, known, log_scale, tolerance, sums):
    """For each row, by how much its log ratios agree: the sum of max(0, tolerance - |ratio - log scale|).

    That is the sum of truncated differences min(|ratio - log scale|, tolerance), turned round. If the scale is not
    known, each row takes the middle of the fullest window of its own histogram, as in `count_consistent_ratios`.
    """
    n = columns.shape[1]
    half_range = 4.0
    bins = int(2.0 * half_range / tolerance) + 1
    histogram = np.empty(bins, np.int32)
    ratios = np.empty(n)
    for i in range(n):
        histogram[:] = 0
        for j in range(n):
            a, b = _distances(columns, i, j)
            ratios[j] = np.log(b / a) if a > 0.0 and b > 0.0 else np.inf
            if abs(ratios[j]) < half_range:
                histogram[int((ratios[j] + half_range) / tolerance)] += 1
        middle, fullest = log_scale, 0
        if not known:
            for k in range(1, bins):
                if histogram[k - 1] + histogram[k] > fullest:
                    fullest = histogram[k - 1] + histogram[k]
                    middle = k * tolerance - half_range
        total = 0.0
        for j in range(n):
            total += max(0.0, tolerance - abs(ratios[j] - middle))
        sums[i] = total


@kernel
def sum_consistent_distances(columns, tolerance, sums):
    """The same for distances: the sum over the other rows of max(0, tolerance - ||b_i - b_j| - |a_i - a_j||)."""
    n = columns.shape[1]
    sums[:] = 0.0
    for i in range(n):
        for j in range(i):
            a, b = _distances(columns, i, j)
            agreement = max(0.0, tolerance - abs(b - a))
            sums[i] += agreement
            sums[j] += agreement


@kernel
def _distances(columns, i, j):
    a = 0.0
    b = 0.0
    for c in range(3):
        a += (columns[c, j] - columns[c, i]) ** 2
        b += (columns[3 + c, j] - columns[3 + c, i]) ** 2
    return np.sqrt(a), np.sqrt(b)


@kernel
def _triplet_is_consistent(columns, i, j, k, by_ratio, known, scale, tolerance):
    low, high = np.inf, -np.inf
    for pair in range(3):
        p = i if pair < 2 else j
        q = j if pair == 0 else k
        a, b = _distances(columns, p, q)
        if not (a > 0.0 and b > 0.0):
            return False
        value = np.log(b / a) if by_ratio else b - scale * a
        low, high = min(low, value), max(high, value)
        if known:
            expected = np.log(scale) if by_ratio else 0.0
            if max(high - expected, expected - low) >= tolerance:
                return False
        elif high - low >= tolerance:
            return False
    return True


@kernel
def ranked_triplets(columns, by_ratio, known, scale, tolerance, max_drawn, state, triplets):
    """Next consistent triplets of the ranked rows, in order of their rank sum.

    `columns` (6, N) holds the rows best first; triplets i < j < k are drawn with i + j + k growing, ties in
    lexicographic order, so that the best ranked rows are combined first. `state` (4,) int64 holds [rank sum, i, j,
    drawn] and is advanced, so that a later call goes on where this one stopped; a state of [3, 0, 1, 0] starts.

    Returns how many of `triplets` (T, 3) were filled; fewer than T means that `max_drawn` or the last triplet was
    reached.
    """
    n = columns.shape[1]
    rank_sum, i, j, drawn = state[0], state[1], state[2], state[3]
    count = 0
    while rank_sum <= 3 * n - 6:
        while 3 * i + 3 <= rank_sum:
            j = max(j, i + 1, rank_sum - i - (n - 1))
            while i + 2 * j < rank_sum:
                if count == triplets.shape[0] or drawn == max_drawn:
                    state[0], state[1], state[2], state[3] = rank_sum, i, j, drawn
                    return count
                k = rank_sum - i - j
                drawn += 1
                if _triplet_is_consistent(columns, i, j, k, by_ratio, known, scale, tolerance):
                    triplets[count, 0], triplets[count, 1], triplets[count, 2] = i, j, k
                    count += 1
                j += 1
            i += 1
            j = 0
        rank_sum += 1
        i = 0
        j = 0
    state[0], state[1], state[2], state[3] = rank_sum, i, j, drawn
    return count


@kernel
def screened_triplets(columns, drawn_triplets, by_ratio, known, scale, tolerance, triplets):
    """The consistent ones among `drawn_triplets` (T, 3), copied to `triplets` in their order; returns how many."""
    count = 0
    for t in range(drawn_triplets.shape[0]):
        i, j, k = drawn_triplets[t, 0], drawn_triplets[t, 1], drawn_triplets[t, 2]
        if _triplet_is_consistent(columns, i, j, k, by_ratio, known, scale, tolerance):
            triplets[count, 0], triplets[count, 1], triplets[count, 2] = i, j, k
            count += 1
    return count
