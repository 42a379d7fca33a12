"""Pairs of oriented correspondences that one rigid motion explains, and that motion.

A row is (a, u, b, v): a point and its unit normal in each of two clouds, the normals known up to their sign.
"""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel, reordered_kernel


@reordered_kernel
def consistent_pairs(columns, tolerance, angle, smallest_distance, pairs):
    """Find pairs of rows that agree on their distance and on the angles of both normals.

    Of each pair (i, j), with the chord from point i to point j, four quantities do not change under a rigid motion
    or a flip of normals: the chord's length, the distance of each point from the other's tangent plane, and the angle
    between the normals (Drost et al., "Model globally, match locally", 2010, in a form free of signs).

    Parameters
    ----------
    columns : (12, N) float32
        a, u, b, v, the points near the origin.
    tolerance : float32
        Largest difference of the two chords' lengths.
    angle : float32, radians
        Largest error of a normal's angle to the chord; the angle between normals may differ by 1.5 times as much.
    smallest_distance : float32
        Shorter chords are left out: they do not determine a rotation.
    pairs : (P, 2) int32
        Receives the row numbers of the pairs; the search ends when it is full.

    Returns
    -------
    int
        How many pairs were found, at most P.
    """
    n = columns.shape[1]
    squared_tolerance = tolerance * tolerance
    squared_angle = angle * angle
    normal_tolerance = np.float32(1.5) * angle
    squared_smallest = smallest_distance * smallest_distance
    # Blocks of 256 rows in one buffer with fixed offsets, so that the compiler proves that nothing overlaps; an inner
    # loop without branches, so that it vectorises; its few hits are then found eight flags at a time.
    block = np.zeros(12 * 256, np.float32)
    flags = np.zeros(256, np.uint8)
    words = flags.view(np.uint64)
    count = 0
    for start in range(0, n, 256):
        width = min(256, n - start)
        for c in range(12):
            for j in range(width):
                block[256 * c + j] = columns[c, start + j]
        for i in range(start + width - 1):
            x, y, z, p, q, r = columns[0, i], columns[1, i], columns[2, i], columns[3, i], columns[4, i], columns[5, i]
            e, f, g, s, t, w = (
                columns[6, i],
                columns[7, i],
                columns[8, i],
                columns[9, i],
                columns[10, i],
                columns[11, i],
            )
            for j in range(256):
                dx, dy, dz = block[j] - x, block[256 + j] - y, block[512 + j] - z
                ex, ey, ez = block[1536 + j] - e, block[1792 + j] - f, block[2048 + j] - g
                ux, uy, uz = block[768 + j], block[1024 + j], block[1280 + j]
                vx, vy, vz = block[2304 + j], block[2560 + j], block[2816 + j]
                a = dx * dx + dy * dy + dz * dz
                b = ex * ex + ey * ey + ez * ez
                excess = a + b - squared_tolerance
                here = abs(p * dx + q * dy + r * dz) - abs(s * ex + t * ey + w * ez)
                there = abs(ux * dx + uy * dy + uz * dz) - abs(vx * ex + vy * ey + vz * ez)
                between = abs(p * ux + q * uy + r * uz) - abs(s * vx + t * vy + w * vz)
                limit = squared_angle * a
                flags[j] = np.uint8(
                    (excess * excess < np.float32(4.0) * a * b)
                    & (a > squared_smallest)
                    & (here * here < limit)
                    & (there * there < limit)
                    & (abs(between) < normal_tolerance)
                )
            first = max(0, i + 1 - start)
            for word in range(first // 8, 32):
                if words[word] != 0:
                    for j in range(max(first, 8 * word), min(width, 8 * word + 8)):
                        if flags[j] != 0:
                            pairs[count, 0], pairs[count, 1] = i, start + j
                            count += 1
                            if count == pairs.shape[0]:
                                return count
    return count


@kernel
def _pair_frame(p, q, first_normal, second_normal, first_sign, second_sign, frame):
    """Right-handed frame of two points and their signed normals: the chord, and the part of the normals across it."""
    length = 0.0
    for c in range(3):
        frame[c, 0] = q[c] - p[c]
        length += frame[c, 0] ** 2
    length = np.sqrt(length)
    first_along = 0.0
    second_along = 0.0
    for c in range(3):
        frame[c, 0] /= length
        first_along += frame[c, 0] * first_normal[c]
        second_along += frame[c, 0] * second_normal[c]
    across = 0.0
    for c in range(3):
        frame[c, 1] = first_sign * (first_normal[c] - first_along * frame[c, 0]) + second_sign * (
            second_normal[c] - second_along * frame[c, 0]
        )
        across += frame[c, 1] ** 2
    across = np.sqrt(across)
    if not across > 0.2:  # both normals nearly along the chord: the rotation about it is not determined
        return False
    for c in range(3):
        frame[c, 1] /= across
    frame[0, 2] = frame[1, 0] * frame[2, 1] - frame[2, 0] * frame[1, 1]
    frame[1, 2] = frame[2, 0] * frame[0, 1] - frame[0, 0] * frame[2, 1]
    frame[2, 2] = frame[0, 0] * frame[1, 1] - frame[1, 0] * frame[0, 1]
    return True


@kernel
def motions_of_pairs(samples, angle, models):
    """Rigid motions (M, 3, 4) of B samples of two oriented rows (B, 2, 12); returns M, at most the room in `models`.

    The chord and the normals' parts across it give a frame in each cloud. The signs of the normals in the second
    cloud are those that agree with the first within `angle`; if several do, there are several motions, four at
    most.
    """
    count = 0
    frame_a = np.empty((3, 3))
    frame_b = np.empty((3, 3))
    for sample in range(samples.shape[0]):
        first, second = samples[sample, 0], samples[sample, 1]
        length = 0.0
        along_a1 = along_a2 = along_b1 = along_b2 = between_a = between_b = 0.0
        for c in range(3):
            chord_a = second[c] - first[c]
            chord_b = second[6 + c] - first[6 + c]
            length += chord_a * chord_a
            along_a1 += first[3 + c] * chord_a
            along_a2 += second[3 + c] * chord_a
            along_b1 += first[9 + c] * chord_b
            along_b2 += second[9 + c] * chord_b
            between_a += first[3 + c] * second[3 + c]
            between_b += first[9 + c] * second[9 + c]
        length = np.sqrt(length)
        if not length > 0.0:
            continue
        # Add the two normals' parts across the chord if they point the same way, else subtract them.
        same_way = 1.0 if between_a - along_a1 * along_a2 / (length * length) >= 0.0 else -1.0
        if not _pair_frame(first[0:3], second[0:3], first[3:6], second[3:6], 1.0, same_way, frame_a):
            continue
        for signs in range(4):
            s1 = 1.0 if signs & 1 else -1.0
            s2 = 1.0 if signs & 2 else -1.0
            if (
                abs(along_a1 - s1 * along_b1) >= angle * length
                or abs(along_a2 - s2 * along_b2) >= angle * length
                or abs(between_a - s1 * s2 * between_b) >= 1.5 * angle
            ):
                continue
            if count == models.shape[0]:
                return count
            if not _pair_frame(first[6:9], second[6:9], first[9:12], second[9:12], s1, s2 * same_way, frame_b):
                continue
            for r in range(3):
                models[count, r, 3] = 0.5 * (first[6 + r] + second[6 + r])
                for c in range(3):
                    models[count, r, c] = (
                        frame_b[r, 0] * frame_a[c, 0] + frame_b[r, 1] * frame_a[c, 1] + frame_b[r, 2] * frame_a[c, 2]
                    )
                    models[count, r, 3] -= models[count, r, c] * 0.5 * (first[c] + second[c])
            count += 1
    return count
