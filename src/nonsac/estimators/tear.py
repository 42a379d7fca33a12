"""TEAR: a row of the rotation and of the translation at a time, by branch and bound on absolute residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from nonsac.estimators.pair_core import PairCore
from nonsac.kernels.direction_search import best_angle, best_direction
from nonsac.layouts import Array
from nonsac.problems.contract import Problem


@dataclass(frozen=True)
class Tear(PairCore):
    """TEAR (Huang, Peng, Vidal and Liu, "Scalable 3D registration via truncated entry-wise absolute residuals", CVPR
    2024), from the paper.

    The sum of truncated absolute residuals of each coordinate falls into parts that share rows of the rotation only
    (Sec. 3). First the first row, a direction, and the first coordinate of the translation: branch and bound over the
    sphere, where the best shift of each direction is found by sorting. Then, among the rows within the truncation, the
    angle of the other two rows about it, with their shifts. Memory is linear in the rows.

    For a known scale. A search ends when no bound exceeds the best sum by more than the gap, or with its budget of
    cells: an answer is then the best one met. A thousand cells of 1,000 rows take some .3 s, of 10,000 rows some 5 s.

    Parameters
    ----------
    truncation : float
        Of the absolute residual of a coordinate, in inlier thresholds; 0.6 are three standard deviations.
    gap : float
    cells : int
    """

    truncation: float = 0.6
    gap: float = 0.02
    cells: int = 5000

    def with_budget(self, factor: int) -> Self:
        return replace(self, cells=self.cells * factor)

    def candidates(self, pairs: Array, free_scale: bool, rng: np.random.Generator) -> tuple[Array, int]:
        first, second = np.ascontiguousarray(pairs[:, :3]), np.ascontiguousarray(pairs[:, 3:])
        row, shifts, width = np.zeros(3), np.zeros(2), self.truncation
        gain, shift, _, looked_at = best_direction(
            first, second[:, 0].copy(), width, False, 6, self.gap, self.cells, row
        )
        near = np.abs(second[:, 0] - first @ row - shift) < self.truncation
        if not gain > 0.0 or near.sum() < 3:
            return np.empty((0, 3, 4)), looked_at
        across = complement(row)
        flat = np.ascontiguousarray(first[near] @ across.T)
        angle, _, more = best_angle(flat, second[near, 1:].copy(), width, False, self.gap, self.cells, shifts)
        turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ across
        model = np.column_stack([np.vstack([row, turned]), [shift, *shifts]])
        return model[None], looked_at + more


def complement(direction: Array) -> Array:
    """Two unit vectors (2, 3) that make a right-handed frame with a unit vector before them."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    second = np.cross(direction, helper)
    second /= np.linalg.norm(second)
    return np.stack([second, np.cross(direction, second)])


def default(problem: Problem) -> Tear:
    return Tear()
