"""How many rows could agree with two given ones at most, by the angle about the axis that the two leave."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel
from nonsac.kernels.consistency_graph import has_edge, lowest_one
from nonsac.kernels.kabsch import fit_similarity


@kernel
def most_overlapping(middles, halves, count, starts, ends):
    """The angle in most arcs of a circle, middle +- half, and in how many; `starts` and `ends` (2 N,) to work in."""
    turn = 2.0 * np.pi
    n = 0
    for i in range(count):
        start = (middles[i] - halves[i]) % turn
        starts[n], ends[n] = start, start + 2.0 * halves[i]
        n += 1
        if ends[n - 1] >= turn:  # the arc goes on at the beginning
            starts[n], ends[n] = start - turn, ends[n - 1] - turn
            n += 1
    starts[:n].sort()
    ends[:n].sort()
    best, angle, open_arcs, closed = 0, 0.0, 0, 0
    for i in range(n):
        while ends[closed] < starts[i]:
            closed += 1
        open_arcs = i + 1 - closed
        if open_arcs > best:
            best, angle = open_arcs, starts[i]
    return best, angle


@kernel
def _frame(x, y, z, frame):
    """Columns: two unit vectors across a vector and the vector's own, right-handed."""
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    if abs(x) < 0.6:
        a, b, c = 0.0, z, -y
    else:
        a, b, c = -z, 0.0, x
    length = np.sqrt(a * a + b * b + c * c)
    a, b, c = a / length, b / length, c / length
    frame[0, 0], frame[1, 0], frame[2, 0] = a, b, c
    frame[0, 1], frame[1, 1], frame[2, 1] = y * c - z * b, z * a - x * c, x * b - y * a
    frame[0, 2], frame[1, 2], frame[2, 2] = x, y, z


@kernel
def _count_near(pairs, model, radius, near):
    count = 0
    for i in range(len(pairs)):
        squared = 0.0
        for r in range(3):
            error = model[r, 3] - pairs[i, 3 + r]
            for c in range(3):
                error += model[r, c] * pairs[i, c]
            squared += error * error
        near[i] = 1.0 if squared < radius * radius else 0.0
        count += squared < radius * radius
    return count


@kernel
def arcs_about(pairs, words, j, k, error, middles, halves, first, second):
    """For each row that is connected with j and k the angles at which it can agree with both.

    With b_i - b_j = R (a_i - a_j) but for an `error`, R turns the vector from a_j to a_k nearly onto that of b, and an
    angle about it is left. `first` and `second` (3, 3) receive the frames between which the angle is measured.

    Returns how many arcs there are, and how many rows agree at any angle; -1 if the two rows leave more than an angle.
    """
    p, q = np.empty(3), np.empty(3)
    for c in range(3):
        p[c] = pairs[k, c] - pairs[j, c]
        q[c] = pairs[k, 3 + c] - pairs[j, 3 + c]
    length = np.sqrt(max(p[0] * p[0] + p[1] * p[1] + p[2] * p[2], q[0] * q[0] + q[1] * q[1] + q[2] * q[2]))
    shorter = np.sqrt(min(p[0] * p[0] + p[1] * p[1] + p[2] * p[2], q[0] * q[0] + q[1] * q[1] + q[2] * q[2]))
    if not length > error or not shorter > 0.0:
        return 0, -1
    slack = np.arcsin(error / length)
    _frame(p[0], p[1], p[2], first)
    _frame(q[0], q[1], q[2], second)
    count, anywhere = 0, 0
    for w in range(words.shape[1]):
        word = words[j, w] & words[k, w]
        while word != np.uint64(0):
            i = 64 * w + lowest_one(word)
            word &= word - np.uint64(1)
            for c in range(3):
                p[c], q[c] = 0.0, 0.0
            for r in range(3):
                before, after = pairs[i, r] - pairs[j, r], pairs[i, 3 + r] - pairs[j, 3 + r]
                for c in range(3):
                    p[c] += first[r, c] * before
                    q[c] += second[r, c] * after
            across_p, across_q = np.sqrt(p[0] * p[0] + p[1] * p[1]), np.sqrt(q[0] * q[0] + q[1] * q[1])
            length_p, length_q = np.sqrt(across_p * across_p + p[2] * p[2]), np.sqrt(across_q * across_q + q[2] * q[2])
            longer = max(length_p, length_q)
            spread = np.pi if not longer > error else slack + np.arcsin(error / longer)
            if spread >= np.pi or not across_p * across_q > 0.0:
                anywhere += 1
                continue
            cosine = (np.cos(spread) * length_p * length_q - p[2] * q[2]) / (across_p * across_q)
            if cosine > 1.0:
                continue
            if cosine <= -1.0:
                anywhere += 1
                continue
            middles[count] = np.arctan2(q[1], q[0]) - np.arctan2(p[1], p[0])
            halves[count] = np.arccos(cosine) + 1e-9
            count += 1
    return count, anywhere


@kernel
def _turned(first, second, angle, pairs, j, model):
    """The motion that takes one frame to the other, turned by the angle, and row j's point onto its match."""
    cosine, sine = np.cos(angle), np.sin(angle)
    for r in range(3):
        x = cosine * second[r, 0] + sine * second[r, 1]
        y = -sine * second[r, 0] + cosine * second[r, 1]
        model[r, 3] = pairs[j, 3 + r]
        for c in range(3):
            model[r, c] = x * first[c, 0] + y * first[c, 1] + second[r, 2] * first[c, 2]
            model[r, 3] -= model[r, c] * pairs[j, c]


@kernel
def bound_edges(pairs, words, order, error, budget, bounds, model):
    """Lower the bounds of edges: no motion has more inliers than its bound, and the rows of the edge among them.

    Parameters
    ----------
    pairs : (N, 6) float64, whose inliers have residuals below 1
    words : (N, W) uint64, the graph of rows that may be inliers together
    order : (N,) int64, in which rows are looked at
    error : float, of the difference of two inliers
    budget : int, arcs to look at
    bounds : (N, N) uint16, the common neighbours of edges and two; receives the bounds
    model : (3, 4) float64, receives the motion with the most inliers that was met

    Returns
    -------
    lower, stabbed : int
        The inliers of that motion, and how many edges were looked at.
    """
    n = len(pairs)
    middles, halves, starts, ends = np.empty(n), np.empty(n), np.empty(2 * n), np.empty(2 * n)
    first, second, trial, near = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 4)), np.empty(n)
    lower, stabbed, arcs = 0, 0, 0
    for place in range(n):
        j = order[place]
        for other in range(place + 1, n):
            k = order[other]
            if not has_edge(words, j, k) or bounds[j, k] < lower or arcs > budget:
                continue
            count, anywhere = arcs_about(pairs, words, j, k, error, middles, halves, first, second)
            arcs += count + 10
            if anywhere < 0:
                continue
            stabbed += 1
            overlapping, angle = most_overlapping(middles, halves, count, starts, ends)
            bound = overlapping + anywhere + 2
            bounds[j, k] = min(np.int64(bounds[j, k]), bound)
            bounds[k, j] = bounds[j, k]
            if bound <= lower:
                continue
            _turned(first, second, angle, pairs, j, trial)
            for step in range(2):
                inliers = _count_near(pairs, trial, 1.0, near)
                arcs += n // 4
                if inliers > lower:
                    lower = inliers
                    for r in range(3):
                        for c in range(4):
                            model[r, c] = trial[r, c]
                if step == 0 and not fit_similarity(pairs, near, False, 1.0, trial):
                    break
    return lower, stabbed


@kernel
def rows_left(words, bounds, lower, is_left):
    """Which rows (N,) may be among `lower` inliers or more: those with as many neighbours left, again and again."""
    n = len(is_left)
    for i in range(n):
        is_left[i] = True
    changed = True
    while changed:
        changed = False
        for i in range(n):
            if not is_left[i]:
                continue
            neighbours = 0
            for j in range(n):
                if is_left[j] and has_edge(words, i, j) and bounds[i, j] >= lower:
                    neighbours += 1
            if neighbours + 1 < lower:
                is_left[i] = False
                changed = True
