"""Branch and bound over directions and over angles, with the best shift of each found by a sweep."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel


@kernel
def best_shift(values, slacks, width, by_count, ends):
    """The t of the largest sum of gains of values v: width - (|v - t| - slack), from 0 to width; or 1 within both.

    A sweep over the ends of the intervals in which gains rise, stay and fall; `ends` is (4, N) to work in. Returns the
    sum, and the t.
    """
    n = len(values)
    for i in range(n):
        ends[0, i] = values[i] - slacks[i] - width
        ends[1, i] = values[i] + slacks[i] + width
        ends[2, i] = values[i] - slacks[i]
        ends[3, i] = values[i] + slacks[i]
    kinds = 2 if by_count else 4
    for kind in range(kinds):
        ends[kind].sort()
    at = np.zeros(4, np.int64)
    best, shift, gain, slope, place = 0.0, 0.0, 0.0, 0.0, ends[0, 0]
    while at[0] < n or (not by_count and at[2] < n) or (not by_count and at[3] < n):
        kind, next_place = 1, np.inf
        for k in range(kinds):
            if at[k] < n and (ends[k, at[k]] < next_place or (k == 0 and ends[k, at[k]] == next_place)):
                kind, next_place = k, ends[k, at[k]]
        if by_count:
            gain += 1.0 if kind == 0 else -1.0
        else:
            gain += slope * (next_place - place)
            slope += 1.0 if kind < 2 else -1.0
        place = next_place
        at[kind] += 1
        if gain > best:
            best, shift = gain, place
    return best, shift


@kernel
def _push(heap, size, cell):
    """Add a cell to a heap whose first one has the largest bound, in the first column."""
    i = size
    while i > 0 and heap[(i - 1) // 2, 0] < cell[0]:
        for c in range(len(cell)):
            heap[i, c] = heap[(i - 1) // 2, c]
        i = (i - 1) // 2
    for c in range(len(cell)):
        heap[i, c] = cell[c]


@kernel
def _pop(heap, size, cell):
    """Take the first cell out."""
    for c in range(len(cell)):
        cell[c] = heap[0, c]
    last = size - 1
    i = 0
    while True:
        child = 2 * i + 1
        if child >= last:
            break
        if child + 1 < last and heap[child + 1, 0] > heap[child, 0]:
            child += 1
        if heap[child, 0] <= heap[last, 0]:
            break
        for c in range(len(cell)):
            heap[i, c] = heap[child, c]
        i = child
    for c in range(len(cell)):
        heap[i, c] = heap[last, c]


@kernel
def _direction(face, u, v, direction):
    """The unit vector through a point of the cube around the sphere: faces 0 to 2 look along x, y, z, 3 to 5 back."""
    axis, sign = face % 3, 1.0 if face < 3 else -1.0
    norm = 1.0 / np.sqrt(1.0 + u * u + v * v)
    direction[axis] = sign * norm
    direction[(axis + 1) % 3] = sign * u * norm
    direction[(axis + 2) % 3] = sign * v * norm


@kernel
def _radius(face, u, v, half, centre):
    """Cosine and sine of the angle from the middle of a square on the cube to its farthest corner."""
    corner, cosine = np.empty(3), 1.0
    for a in range(-1, 2, 2):
        for b in range(-1, 2, 2):
            _direction(face, u + a * half, v + b * half, corner)
            cosine = min(cosine, corner[0] * centre[0] + corner[1] * centre[1] + corner[2] * centre[2])
    return cosine, np.sqrt(max(0.0, 1.0 - cosine * cosine))


@kernel
def best_direction(points, values, width, by_count, faces, gap, budget, direction):
    """The unit r and the t of the largest sum of gains of value - r . point - t (see `best_shift`).

    Squares on a cube around the sphere are split, that with the largest bound first, until no bound is larger than the
    best sum by more than the share `gap`, or `budget` of them were looked at.

    Parameters
    ----------
    points : (N, 3) float64
    values : (N,) float64
    width : float
    by_count : bool
        Whether a row within the width gains 1, rather than the more the nearer it is.
    faces : int
        6 for all directions, 3 for one of each two opposite ones.
    gap : float
    budget : int
    direction : (3,) float64, receives r

    Returns
    -------
    gain, shift, bound : float
        The sum, the t, and what no direction exceeds.
    cells : int
        Squares looked at.
    """
    n = len(points)
    ends, offsets, slacks, nothing = np.empty((4, n)), np.empty(n), np.empty(n), np.zeros(n)
    heap, cell, child, centre = np.empty((budget + 10, 5)), np.empty(5), np.empty(5), np.empty(3)
    best, shift, size, cells, children = 0.0, 0.0, 0, 0, faces
    while True:
        for k in range(children):
            if children == faces:
                child[1], child[2], child[3], child[4] = k, 0.0, 0.0, 1.0
            else:
                half = 0.5 * cell[4]
                child[1], child[4] = cell[1], half
                child[2] = cell[2] + (half if k % 2 == 1 else -half)
                child[3] = cell[3] + (half if k >= 2 else -half)
            _direction(int(child[1]), child[2], child[3], centre)
            cosine, sine = _radius(int(child[1]), child[2], child[3], child[4], centre)
            for i in range(n):
                along = centre[0] * points[i, 0] + centre[1] * points[i, 1] + centre[2] * points[i, 2]
                squared = points[i, 0] * points[i, 0] + points[i, 1] * points[i, 1] + points[i, 2] * points[i, 2]
                offsets[i] = values[i] - along
                slacks[i] = abs(along) * (1.0 - cosine) + np.sqrt(max(0.0, squared - along * along)) * sine
            cells += 1
            child[0] = best_shift(offsets, slacks, width, by_count, ends)[0]
            if child[0] <= best * (1.0 + gap):
                continue
            gain, there = best_shift(offsets, nothing, width, by_count, ends)
            if gain > best:
                best, shift = gain, there
                for c in range(3):
                    direction[c] = centre[c]
            _push(heap, size, child)
            size += 1
        if size == 0:
            return best, shift, best * (1.0 + gap), cells
        _pop(heap, size, cell)
        size -= 1
        if cell[0] <= best * (1.0 + gap) or cells >= budget:
            return best, shift, max(cell[0], best), cells
        children = 4


@kernel
def best_angle(points, values, width, by_count, gap, budget, shifts):
    """The angle of the largest gains of value - R point - t in the plane, each coordinate with a shift of its own.

    `points` and `values` are (N, 2), and `shifts` (2,) receives t. By count the gain is that of the coordinate with
    fewer rows. Arcs are split as squares are in `best_direction`. Returns the angle, the gain, and how many arcs.
    """
    n = len(points)
    ends, offsets, slacks, nothing = np.empty((4, n)), np.empty((2, n)), np.empty(n), np.zeros(n)
    heap, cell, child = np.empty((budget + 10, 3)), np.empty(3), np.empty(3)
    gains, theres = np.zeros(2), np.zeros(2)
    best, angle, size, cells = 0.0, 0.0, 0, 0
    cell[0], cell[1], cell[2] = np.inf, 0.0, np.pi
    while True:
        for k in range(2):
            child[2] = 0.5 * cell[2]
            child[1] = cell[1] + (child[2] if k == 1 else -child[2])
            cosine, sine, turn = np.cos(child[1]), np.sin(child[1]), 2.0 * np.sin(0.5 * child[2])
            for i in range(n):
                x, y = points[i, 0], points[i, 1]
                offsets[0, i] = values[i, 0] - (cosine * x - sine * y)
                offsets[1, i] = values[i, 1] - (sine * x + cosine * y)
                slacks[i] = turn * np.sqrt(x * x + y * y)
            cells += 1
            for c in range(2):
                gains[c] = best_shift(offsets[c], slacks, width, by_count, ends)[0]
            child[0] = min(gains[0], gains[1]) if by_count else gains[0] + gains[1]
            if child[0] <= best * (1.0 + gap):
                continue
            for c in range(2):
                gains[c], theres[c] = best_shift(offsets[c], nothing, width, by_count, ends)
            gain = min(gains[0], gains[1]) if by_count else gains[0] + gains[1]
            if gain > best:
                best, angle = gain, child[1]
                shifts[0], shifts[1] = theres[0], theres[1]
            _push(heap, size, child)
            size += 1
        if size == 0:
            break
        _pop(heap, size, cell)
        size -= 1
        if cell[0] <= best * (1.0 + gap) or cells >= budget:
            break
    return angle, best, cells
