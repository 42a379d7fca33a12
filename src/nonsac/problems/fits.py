"""Robust fits of any problem's model to rows, from a start that is nearly right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, refitted

_BLOCK = 8192
RANKED_ON, SPARE = 10_000, 5  # rows that rank models, if there are many, and how many more are then compared on all


def reweighted_fit(problem: Problem, model: Array, rows: Rows, threshold: float, iterations: int) -> Array:
    """The fit with Tukey's biweight, which is zero beyond the threshold; the model itself if there is none.

    Only rows near the start are looked at, three thresholds wide; if the fit moves far, the caller starts again.
    """
    near = rows[problem.residuals(model[None], rows.values)[0] < 3.0 * threshold]
    fitted = problem.fit_robustly(model, near.values, near.times(np.ones(len(near))), threshold, iterations)
    return fitted if np.isfinite(fitted).all() else model


def inlier_fit(problem: Problem, model: Array, rows: Rows, threshold: float) -> Array:
    """The least-squares model of a model's inliers, or the model itself if they do not determine one."""
    inliers = problem.residuals(model[None], rows.values)[0] < threshold
    fitted = refitted(problem, model, rows.values, rows.times(inliers.astype(np.float64)))
    return fitted if np.isfinite(fitted).all() else model


def biweight_costs(problem: Problem, models: Array, rows: Rows, threshold: float) -> Array:
    """Tukey's biweight loss summed over the rows, for each model: what `reweighted_fit` makes small.

    In units in which a row beyond the threshold costs 1; rows count by their weight. Infinite for a model of NaN.
    """
    weights = rows.mean_weights
    costs = np.zeros(len(models))
    for start in range(0, len(rows), _BLOCK):
        block = slice(start, start + _BLOCK)
        ratios = np.minimum(problem.residuals(models, rows.values[block]) / threshold, 1.0)
        share = 1.0 - ratios * ratios
        losses = 1.0 - share * share * share  # numpy's power of 3 takes ten times as long
        costs += losses.sum(axis=1) if weights is None else losses @ weights[block]
    return np.where(np.isfinite(costs), costs, np.inf)


def cheapest(problem: Problem, models: Array, rows: Rows, threshold: float, most: int) -> NDArray[np.int64]:
    """Numbers of the models with the least biweight costs, `most` of them at most, best first.

    Of many rows some tell which models are worth comparing on all.
    """
    few, numbers = rows.some(RANKED_ON), np.arange(len(models))
    if len(few) < len(rows) and len(models) > SPARE * most:
        ranked = np.argsort(biweight_costs(problem, models, few, threshold), kind="stable")
        numbers = np.sort(ranked[: SPARE * most])
    costs = biweight_costs(problem, models[numbers], rows, threshold)
    return numbers[np.argsort(costs, kind="stable")[:most]]


def trials_needed(inlier_ratio: float, size: int, confidence: float) -> int:
    """Minimal samples until one holds inliers only, with this confidence (Hartley and Zisserman, Sec. 4.7.1)."""
    chance = min(inlier_ratio, 1.0) ** size
    if chance >= 1.0:
        return 1
    if chance < 1e-15:
        return 2**62
    return max(1, int(np.ceil(np.log(1.0 - confidence) / np.log1p(-chance))))
