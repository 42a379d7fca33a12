"""The graph of correspondences that agree on the distance between their points: a bit for each pair of rows."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel


@kernel
def number_of_ones(word):
    """How many bits of a 64-bit word are 1; the compiler knows this as one instruction."""
    word = word - ((word >> np.uint64(1)) & np.uint64(0x5555555555555555))
    word = (word & np.uint64(0x3333333333333333)) + ((word >> np.uint64(2)) & np.uint64(0x3333333333333333))
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((word * np.uint64(0x0101010101010101)) >> np.uint64(56))


@kernel
def lowest_one(word):
    """The place of the lowest 1 of a word that is not zero."""
    return number_of_ones((word & (~word + np.uint64(1))) - np.uint64(1))


@kernel
def has_edge(words, i, j):
    return (words[i, j >> 6] >> np.uint64(j & 63)) & np.uint64(1) != np.uint64(0)


@reordered_kernel
def fill_consistency_graph(columns, tolerance, words):
    """Connect rows i and j if ||a_i - a_j| - |b_i - b_j|| < tolerance.

    `columns` is (6, N) single precision; bit j of row i of `words`, (N, ceil(N / 64)) uint64, receives the edge. No row
    is connected with itself. The test is that of `consistency.count_consistent_distances`, without a square root.
    """
    n = columns.shape[1]
    squared_tolerance = tolerance * tolerance
    block = np.zeros(6 * 512, np.float32)
    agrees = np.zeros(512, np.uint8)
    zero, four = np.float32(0.0), np.float32(4.0)
    for start in range(0, n, 512):
        width = min(512, n - start)
        for c in range(6):
            for j in range(width):
                block[512 * c + j] = columns[c, start + j]
        for i in range(n):
            x, y, z, u, v, w = columns[0, i], columns[1, i], columns[2, i], columns[3, i], columns[4, i], columns[5, i]
            for j in range(width):
                dx, dy, dz = block[j] - x, block[512 + j] - y, block[1024 + j] - z
                ex, ey, ez = block[1536 + j] - u, block[2048 + j] - v, block[2560 + j] - w
                a = dx * dx + dy * dy + dz * dz
                b = ex * ex + ey * ey + ez * ez
                s = a + b - squared_tolerance
                s = zero if s < zero else s
                agrees[j] = s * s - four * a * b <= zero  # not true of infinities
            if start <= i < start + width:
                agrees[i - start] = 0
            for first in range(0, width, 64):
                word = np.uint64(0)
                for j in range(min(64, width - first)):
                    word |= np.uint64(agrees[first + j]) << np.uint64(j)
                words[i, (start + first) >> 6] = word


@kernel
def order_rows(words, order, ordered):
    """The same graph with row order[i] as row i."""
    for i in range(words.shape[0]):
        for w in range(words.shape[1]):
            ordered[i, w] = np.uint64(0)
        for j in range(words.shape[0]):
            if has_edge(words, order[i], order[j]):
                ordered[i, j >> 6] |= np.uint64(1) << np.uint64(j & 63)


@kernel
def count_edges(words, degrees):
    """How many neighbours each row has."""
    for i in range(words.shape[0]):
        degrees[i] = 0
        for w in range(words.shape[1]):
            degrees[i] += number_of_ones(words[i, w])


@kernel
def count_common_neighbours(words, counts):
    """Second-order consistency: for rows that are connected, how many others are connected with both; else 0.

    `counts` is (N, N) uint16 and symmetric.
    """
    n, width = words.shape
    for i in range(n):
        counts[i, i] = 0
        for j in range(i):
            common = 0
            if has_edge(words, i, j):
                for w in range(width):
                    common += number_of_ones(words[i, w] & words[j, w])
            counts[i, j] = common
            counts[j, i] = common


@reordered_kernel
def multiply_counts(counts, vector, product):
    """The product (N,) of a matrix of counts and a vector, single precision."""
    for i in range(counts.shape[0]):
        total = np.float32(0.0)
        for j in range(counts.shape[1]):
            total += np.float32(counts[i, j]) * vector[j]
        product[i] = total


@kernel
def local_maxima(points, order, radius, is_maximum):
    """Whether no point (N, 3) that comes before it in `order` is within the radius of it."""
    squared = radius * radius
    for place in range(order.shape[0]):
        i = order[place]
        is_maximum[i] = True
        for earlier in range(place):
            j = order[earlier]
            distance = 0.0
            for c in range(3):
                distance += (points[i, c] - points[j, c]) * (points[i, c] - points[j, c])
            if distance < squared:
                is_maximum[i] = False
                break


@kernel
def strongest_edges(counts, edges):
    """The edges with the highest counts; of equal ones the first. Returns how many of `edges` (E, 2) were filled.

    An edge without a common neighbour is none.
    """
    n = counts.shape[0]
    how_many = np.zeros(65536, np.int64)
    for i in range(n):
        for j in range(i + 1, n):
            how_many[counts[i, j]] += 1
    least, above = 65536, 0
    while least > 1 and above + how_many[least - 1] <= edges.shape[0]:
        least -= 1
        above += how_many[least]
    count, spare = 0, edges.shape[0] - above  # room for edges with one less
    for i in range(n):
        for j in range(i + 1, n):
            strength = np.int64(counts[i, j])
            if strength == 0 or strength < least - 1:
                continue
            if strength < least:
                if spare == 0:
                    continue
                spare -= 1
            edges[count, 0], edges[count, 1] = i, j
            count += 1
    return count


@kernel
def best_triangles(words, counts, edges, each, triangles):
    """For each edge the rows after both of its own that make triangles with the most counts, at most `each`.

    `triangles` (E each, 3) receives them, the best of an edge first; returns how many there are.
    """
    filled = 0
    for e in range(edges.shape[0]):
        i, j = edges[e, 0], edges[e, 1]
        count = 0
        for w in range(j >> 6, words.shape[1]):
            word = words[i, w] & words[j, w]
            while word != np.uint64(0):
                k = 64 * w + lowest_one(word)
                word &= word - np.uint64(1)
                if k <= j:
                    continue
                score = np.int64(counts[i, k]) + np.int64(counts[j, k])
                place = filled + count
                while place > filled:
                    other = triangles[place - 1, 2]
                    if np.int64(counts[i, other]) + np.int64(counts[j, other]) >= score:
                        break
                    if place < filled + each:
                        triangles[place, 2] = other
                    place -= 1
                if place < filled + each:
                    triangles[place, 2] = k
                    count = min(count + 1, each)
        for t in range(filled, filled + count):
            triangles[t, 0], triangles[t, 1] = i, j
        filled += count
    return filled
