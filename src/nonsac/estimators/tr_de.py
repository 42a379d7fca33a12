"""TR-DE: the axis of the rotation and the shift along it first, then the angle and the shift across it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from nonsac.estimators.pair_core import PairCore
from nonsac.estimators.tear import complement
from nonsac.kernels.direction_search import best_angle, best_direction
from nonsac.layouts import Array
from nonsac.problems.contract import Problem


@dataclass(frozen=True)
class TrDe(PairCore):
    """TR-DE (Chen et al., "Deterministic point cloud registration via novel transformation decomposition", CVPR 2022),
    from the paper.

    A rotation moves no point along its axis r, so r . (b - a) is the same for all right rows: two unknowns of the axis
    and one of the translation (2 + 1), then the angle and two of the translation (1 + 2; Sec. 3). Both are searched by
    branch and bound for the most rows within the width; the best shifts of an axis or an angle are found by interval
    stabbing. The second search is among the rows that agree with the first, and bounds the coordinates across the axis
    one by one. Memory is linear in the rows.

    For a known scale. A search ends when no bound exceeds the best count by more than the gap, or with its budget of
    cells: an answer is then the best one met. A thousand cells of 1,000 rows take some .3 s, of 10,000 rows some 5 s.

    Parameters
    ----------
    width : float
        Within which a coordinate agrees, in inlier thresholds; 0.6 are three standard deviations.
    gap : float
    cells : int
    """

    width: float = 0.6
    gap: float = 0.02
    cells: int = 5000

    def with_budget(self, factor: int) -> Self:
        return replace(self, cells=self.cells * factor)

    def candidates(self, pairs: Array, free_scale: bool, rng: np.random.Generator) -> tuple[Array, int]:
        first, second, axis = pairs[:, :3], pairs[:, 3:], np.zeros(3)
        moves, nothing = np.ascontiguousarray(first - second), np.zeros(len(pairs))
        _, along, _, looked_at = best_direction(moves, nothing, self.width, True, 3, self.gap, self.cells, axis)
        near = np.abs(moves @ axis + along) <= self.width
        if near.sum() < 3:
            return np.empty((0, 3, 4)), looked_at
        frame, shifts = np.vstack([axis, complement(axis)]), np.zeros(2)
        before, after = (np.ascontiguousarray(half[near] @ frame[1:].T) for half in (first, second))
        angle, _, more = best_angle(before, after, self.width, True, self.gap, self.cells, shifts)
        turn = np.eye(3)
        turn[1:, 1:] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        model = np.column_stack([frame.T @ turn @ frame, frame.T @ [along, *shifts]])
        return model[None], looked_at + more


def default(problem: Problem) -> TrDe:
    return TrDe()
