"""Graphs for tests, as matrices and as bits."""

import numpy as np


def random_edges(rng, n, share):
    edges = np.triu(rng.random((n, n)) < share, 1)
    return edges | edges.T


def words_of(edges):
    """A bit for each entry of a square matrix, in words of 64."""
    n = len(edges)
    padded = np.zeros((n, 64 * -(-n // 64)), np.uint8)
    padded[:, :n] = edges
    return np.ascontiguousarray(np.packbits(padded, axis=1, bitorder="little")).view(np.uint64)


def is_clique(edges, rows):
    return bool(edges[np.ix_(rows, rows)].sum() == len(rows) * (len(rows) - 1))
