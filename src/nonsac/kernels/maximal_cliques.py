"""Sets of connected rows that no other row could join, in a graph of bits: for each row the heaviest that holds it."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel
from nonsac.kernels.consistency_graph import has_edge, lowest_one, number_of_ones


@kernel
def _branches(part, candidates, excluded, branches):
    """The candidates to try next: those not connected with the row that most of them are (Tomita et al. 2006).

    A maximal clique holds that row, or one of these. Returns the words looked at.
    """
    width = len(candidates)
    best, most, steps = -1, -1, 0
    for w in range(width):
        word = candidates[w] | excluded[w]
        while word != np.uint64(0):
            i = 64 * w + lowest_one(word)
            word &= word - np.uint64(1)
            shared = 0
            for v in range(width):
                shared += number_of_ones(part[i, v] & candidates[v])
            steps += width
            if shared > most:
                best, most = i, shared
    for w in range(width):
        branches[w] = candidates[w] & ~part[best, w]
    return steps


@kernel
def _keep(clique, weight, heaviest, owners, starts, rows, count):
    """Note a clique if it is the heaviest of one of its rows; returns how many are noted, or -1 if there is no room."""
    wanted = False
    for i in clique:
        wanted |= weight > heaviest[i]
    if not wanted:
        return count
    end = starts[count] + len(clique)
    if count + 2 > len(starts) or end > len(rows):
        return -1
    for k in range(len(clique)):
        i = clique[k]
        rows[starts[count] + k] = i
        if weight > heaviest[i]:
            heaviest[i] = weight
            owners[i] = count
    starts[count + 1] = end
    return count + 1


@kernel
def heaviest_cliques(words, counts, budget, each, heaviest, owners, starts, rows):
    """For each row the maximal clique of at least three rows, of those met, that has the largest sum of edge weights.

    Bron and Kerbosch's search with pivots, a row at a time and the most connected first: those after it are its
    candidates, so that a search that is broken off has met the cliques of the rows that have the most.

    Parameters
    ----------
    words : (N, W) uint64, the graph, its rows in that order
    counts : (N, N) uint16, the weights of the edges
    budget, each : int
        Words to look at in all, and for each row after its first maximal clique.
    heaviest : (N,) int64, receives the weight for each row, 0 if there is none
    owners : (N,) int64, receives the number of the clique, -1 if there is none
    starts : (C,) int64, receives where in `rows` (M,) int64 the rows of each clique begin

    Returns
    -------
    int
        How many cliques were looked at, noted or not.
    """
    n = words.shape[0]
    heaviest[:] = 0
    owners[:] = -1
    starts[0] = 0
    noted, met, steps = 0, 0, 0
    members, clique = np.empty(n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        after, m = 0, 0
        for j in range(n):
            if has_edge(words, i, j):
                members[m] = j
                m += 1
                after += j > i
        if after < 2:  # a clique of three is met from its first row
            continue
        width = (m + 63) >> 6
        part = np.zeros((m, width), np.uint64)
        for j in range(m):
            for k in range(j):
                if has_edge(words, members[j], members[k]):
                    part[j, k >> 6] |= np.uint64(1) << np.uint64(k & 63)
                    part[k, j >> 6] |= np.uint64(1) << np.uint64(j & 63)
        steps += m * m // 8
        candidates, excluded = np.zeros((after + 1, width), np.uint64), np.zeros((after + 1, width), np.uint64)
        branches, weights = np.zeros((after + 1, width), np.uint64), np.zeros(after + 2, np.int64)
        for j in range(m):
            bit = np.uint64(1) << np.uint64(j & 63)
            if members[j] > i:
                candidates[0, j >> 6] |= bit
            else:
                excluded[0, j >> 6] |= bit
        clique[0] = i
        depth, found, limit = 0, False, steps + each
        steps += _branches(part, candidates[0], excluded[0], branches[0])
        while depth >= 0 and not (found and steps > limit):
            chosen = -1
            for w in range(width):
                if branches[depth, w] != np.uint64(0):
                    chosen = 64 * w + lowest_one(branches[depth, w])
                    break
            if chosen < 0:
                depth -= 1
                continue
            place, bit = chosen >> 6, np.uint64(1) << np.uint64(chosen & 63)
            any_candidate, any_excluded = False, False
            for w in range(width):
                candidates[depth + 1, w] = candidates[depth, w] & part[chosen, w]
                excluded[depth + 1, w] = excluded[depth, w] & part[chosen, w]
                any_candidate |= candidates[depth + 1, w] != np.uint64(0)
                any_excluded |= excluded[depth + 1, w] != np.uint64(0)
            branches[depth, place] &= ~bit
            candidates[depth, place] &= ~bit
            excluded[depth, place] |= bit
            clique[depth + 1] = members[chosen]
            weight = weights[depth]
            for k in range(depth + 1):
                weight += np.int64(counts[clique[k], members[chosen]])
            steps += width
            if any_candidate:
                depth += 1
                weights[depth] = weight
                steps += _branches(part, candidates[depth], excluded[depth], branches[depth])
            elif not any_excluded and depth >= 1:
                found = True
                met += 1
                noted = _keep(clique[: depth + 2], weight, heaviest, owners, starts, rows, noted)
                if noted < 0:
                    return met
        if steps > budget:
            break
    return met
