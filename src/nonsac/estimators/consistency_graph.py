"""Which matched points agree with which others, as a graph that the cores for registration share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.consistency_graph import (
    count_common_neighbours,
    count_edges,
    fill_consistency_graph,
    multiply_counts,
    order_rows,
)
from nonsac.layouts import Array

_ITERATIONS, _CONVERGED = 30, 1e-4


@dataclass(frozen=True, eq=False)
class ConsistencyGraph:
    """Rows i and j are connected if their points are equally far apart: ||a_i - a_j| - |b_i - b_j|| < tolerance.

    Right rows agree with each other, whatever the motion is, and wrong ones by chance only. A bit for each pair takes
    N^2 / 8 bytes, and what is counted for each pair 2 N^2: 12.5 and 200 MB for 10,000 rows.

    Attributes
    ----------
    words : (N, ceil(N / 64)) uint64
        Bit j of row i is 1 if rows i and j are connected.
    """

    words: NDArray[np.uint64]

    @classmethod
    def of(cls, pairs: Array, tolerance: float) -> ConsistencyGraph:
        """The graph of pairs (N, 6), in units near the tolerance: they are compared in single precision."""
        words = np.empty((len(pairs), -(-len(pairs) // 64)), np.uint64)
        fill_consistency_graph(np.ascontiguousarray(pairs.T, np.float32), np.float32(tolerance), words)
        return cls(words)

    def __len__(self) -> int:
        return len(self.words)

    @property
    def compared(self) -> int:
        """How many pairs of rows were compared."""
        return len(self) * (len(self) - 1) // 2

    @cached_property
    def degrees(self) -> NDArray[np.int64]:
        """With how many others each row is connected."""
        degrees = np.empty(len(self), np.int64)
        count_edges(self.words, degrees)
        return degrees

    @cached_property
    def common(self) -> NDArray[np.uint16]:
        """How many others are connected with both rows of an edge (N, N); 0 for rows that are not connected.

        The second-order measure of Chen et al. (SC2-PCR, CVPR 2022, Eq. 5): wrong rows have few common neighbours.
        """
        counts = np.empty((len(self), len(self)), np.uint16)
        count_common_neighbours(self.words, counts)
        return counts

    def connected(self, numbers: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of some rows (..., k) are connected with each other, (..., k, k)."""
        first, second = numbers[..., :, None], numbers[..., None, :]
        return (self.words[first, second >> 6] >> (second & 63).astype(np.uint64)) & np.uint64(1) != 0

    def ordered(self, order: NDArray[np.int64]) -> ConsistencyGraph:
        """The same graph with its rows in another order."""
        words = np.empty_like(self.words)
        order_rows(self.words, order, words)
        return ConsistencyGraph(words)

    def leading_eigenvector(self) -> Array:
        """That of the common neighbours (N,), of length 1: how much each row belongs to the main cluster.

        Spectral matching (Leordeanu and Hebert 2005), by power iteration; zeros if no edge has a common neighbour.
        """
        vector = np.full(len(self), len(self) ** -0.5, np.float32)
        product = np.empty_like(vector)
        for _ in range(_ITERATIONS):
            multiply_counts(self.common, vector, product)
            length = np.linalg.norm(product)
            if not length > 0.0:
                return np.zeros(len(self))
            step = np.abs(product / length - vector).max()
            vector = product / length
            if step < _CONVERGED:
                break
        return vector.astype(np.float64)
