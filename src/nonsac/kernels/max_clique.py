"""The largest set of rows that are all connected, in a graph of bits."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel
from nonsac.kernels.consistency_graph import has_edge, lowest_one, number_of_ones


@kernel
def peel(words, order, cores):
    """Take the row with the fewest neighbours left away, again and again (Batagelj and Zaversnik 2003).

    `order` (N,) receives the rows, the last one taken first, and `cores` (N,) their core numbers in that order: a row
    is in no clique of more than its core number and one. Core numbers do not grow along the order.
    """
    n, width = words.shape
    degrees = np.zeros(n, np.int64)
    first = np.zeros(n + 1, np.int64)
    for i in range(n):
        for w in range(width):
            degrees[i] += number_of_ones(words[i, w])
        first[degrees[i] + 1] += 1
    for d in range(n):
        first[d + 1] += first[d]
    rows, place, filled = np.empty(n, np.int64), np.empty(n, np.int64), first.copy()
    for i in range(n):
        place[i] = filled[degrees[i]]
        rows[place[i]] = i
        filled[degrees[i]] += 1
    for k in range(n):
        i = rows[k]
        order[n - 1 - k] = i
        cores[n - 1 - k] = degrees[i]
        for w in range(width):
            word = words[i, w]
            while word != np.uint64(0):
                j = 64 * w + lowest_one(word)
                word &= word - np.uint64(1)
                if degrees[j] > degrees[i]:  # it moves to the end of those with one less
                    there = max(first[degrees[j]], k + 1)
                    other = rows[there]
                    rows[there], rows[place[j]] = j, other
                    place[other], place[j] = place[j], there
                    first[degrees[j]] = there + 1
                    degrees[j] -= 1


@kernel
def _colour(words, candidates, least, order, colours):
    """Split candidates into sets without an edge inside, one colour each: a clique has at most one of each colour.

    Those with a colour above `least` are listed, colours ascending; returns how many, and the words looked at. The
    candidates themselves are left.
    """
    width = len(candidates)
    left, free = candidates.copy(), np.empty(width, np.uint64)
    count, colour, steps, some = 0, 0, 0, True
    while some:
        colour += 1
        some = False
        for w in range(width):
            free[w] = left[w]
        for w in range(width):
            while free[w] != np.uint64(0):
                i = 64 * w + lowest_one(free[w])
                bit = np.uint64(1) << np.uint64(i & 63)
                left[w] &= ~bit
                free[w] &= ~bit
                for v in range(w, width):
                    free[v] &= ~words[i, v]
                steps += width - w
                some = True
                if colour > least:
                    order[count], colours[count] = i, colour
                    count += 1
    return count, steps


@kernel
def _grow(words, i, clique, candidates):
    """The clique of row i and of each next row that is connected with all so far; returns its size."""
    for w in range(len(candidates)):
        candidates[w] = words[i, w]
    clique[0] = i
    size = 1
    for w in range(len(candidates)):
        while candidates[w] != np.uint64(0):
            j = 64 * w + lowest_one(candidates[w])
            clique[size] = j
            size += 1
            for v in range(w, len(candidates)):
                candidates[v] &= words[j, v]
    return size


@kernel
def _improve(words, best, budget, clique):
    """Search a graph for a clique of more than `best` rows: branch and bound by colours (San Segundo et al. 2011).

    Returns the size of the largest clique, `best` if there is no larger one, and the words looked at, more than
    `budget` if that was not enough.
    """
    n, width = words.shape
    candidates = np.zeros((n + 1, width), np.uint64)
    order, colours = np.empty((n + 1, n), np.int32), np.empty((n + 1, n), np.int32)
    left, chosen = np.zeros(n + 1, np.int64), np.empty(n + 1, np.int64)
    for i in range(n):
        candidates[0, i >> 6] |= np.uint64(1) << np.uint64(i & 63)
    left[0], steps = _colour(words, candidates[0], best, order[0], colours[0])
    depth = 0
    while depth >= 0:
        last = left[depth] - 1
        if last < 0 or depth + colours[depth, last] <= best:
            depth -= 1
            continue
        if steps > budget:
            break
        i = order[depth, last]
        left[depth] = last
        chosen[depth] = i
        any_left = False
        for w in range(width):
            candidates[depth + 1, w] = candidates[depth, w] & words[i, w]
            any_left |= candidates[depth + 1, w] != np.uint64(0)
        candidates[depth, i >> 6] &= ~(np.uint64(1) << np.uint64(i & 63))
        if any_left:
            depth += 1
            left[depth], more = _colour(words, candidates[depth], best - depth, order[depth], colours[depth])
            steps += more + width
        elif depth + 1 > best:
            best = depth + 1
            for k in range(best):
                clique[k] = chosen[k]
    return best, steps


@kernel
def largest_clique(words, cores, most, budget, clique):
    """The largest clique of a graph whose rows are in the order of `peel`.

    Greedy cliques are a lower bound. Then each row, from the most connected on, is searched with the rows before it.
    Rows with more than `most` of them are not, as the search needs that number squared.

    Parameters
    ----------
    words : (N, W) uint64, the graph
    cores : (N,) int64, of `peel`
    most, budget : int
        The budget is a number of words; half of it, at most, is spent on greedy cliques.
    clique : (N,) int64, receives the rows

    Returns
    -------
    size : int
    proven : bool
        Whether the search ended, so that no clique is larger.
    """
    n, width = words.shape
    best, steps = 0, 0
    grown, candidates = np.empty(n, np.int64), np.empty(width, np.uint64)
    for i in range(n):
        if cores[i] < best or 2 * steps > budget:
            break
        size = _grow(words, i, grown, candidates)
        steps += size * width
        if size > best:
            best = size
            for k in range(size):
                clique[k] = grown[k]
    members = np.empty(n, np.int64)
    proven = True
    for i in range(n):
        if cores[i] < best:
            break
        count = 0
        for j in range(i):
            if has_edge(words, i, j):
                members[count] = j
                count += 1
        if count < best:
            continue
        if count > most or steps > budget:
            proven = False
            break
        part = np.zeros((count, (count + 63) >> 6), np.uint64)
        for j in range(count):
            for k in range(j):
                if has_edge(words, members[j], members[k]):
                    part[j, k >> 6] |= np.uint64(1) << np.uint64(k & 63)
                    part[k, j >> 6] |= np.uint64(1) << np.uint64(j & 63)
        steps += count * count // 8
        size, more = _improve(part, best - 1, budget - steps, grown)
        steps += more
        if size > best - 1:
            best = size + 1
            for k in range(size):
                clique[k] = members[grown[k]]
            clique[size] = i
        proven = steps <= budget
    return best, proven
