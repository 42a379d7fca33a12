"""Table 2 as the paper's text has it, if that differs from what is done by default."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac import simulate
from nonsac.estimators import Pcr99
from nonsac.layouts import Array
from nonsac.problems import RelativePose
from nonsac.problems.contract import Problem
from nonsac.reproduce.experiments import EXPERIMENTS, absolute_rows, relative_rows

__all__ = ["LITERAL", "PlainSampson"]


@dataclass(frozen=True)
class PlainSampson(RelativePose):
    """Relative poses with Sampson's distance of all matches, wherever their rays meet (Sec. 4.1)."""

    def residuals(self, models: Array, rows: Array) -> Array:
        essential = np.cross(models[:, None, :, 3], np.swapaxes(models[:, :, :3], 1, 2), axis=2).swapaxes(1, 2)
        first, second = (np.column_stack([half, np.ones(len(rows))]).T for half in (rows[:, :2], rows[:, 2:]))
        lines2, lines1 = essential @ first, np.swapaxes(essential, 1, 2) @ second
        off = (second * lines2).sum(axis=1)
        squares = (lines2[:, :2] ** 2).sum(axis=1) + (lines1[:, :2] ** 2).sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(squares > 0.0, np.abs(off) / np.sqrt(squares), np.inf)

    def count_inliers(self, models: Array, rows: Array, threshold: float, weights: Array | None = None) -> NDArray[Any]:
        return Problem.count_inliers(self, models, rows, threshold, weights)

    def count_on_ladder(self, models: Array, rows: Array, thresholds: Array) -> NDArray[np.int64]:
        return Problem.count_on_ladder(self, models, rows, thresholds)


LITERAL = {
    "relative-pose": replace(
        EXPERIMENTS["relative-pose"],
        problem=PlainSampson(),
        simulate=partial(relative_rows, make=partial(simulate.relative_pose, sees_all=True)),
    ),
    "absolute-pose": replace(
        EXPERIMENTS["absolute-pose"],
        simulate=partial(absolute_rows, make=partial(simulate.absolute_pose, sees_all=True)),
    ),
    "registration": replace(
        EXPERIMENTS["registration"], estimator=replace(Pcr99.for_pairs(), refit="once", rank="sum")
    ),
}
