"""Robust fits of a model to rows, from a start that is nearly right."""

from __future__ import annotations

import numpy as np

from nonsac.problems.contract import Problem
from nonsac.result import Array

_BLOCK = 8192


def reweighted_fit(problem: Problem, model: Array, rows: Array, threshold: float, iterations: int) -> Array:
    """Iteratively reweighted least squares with Tukey's biweight, which is zero beyond the threshold.

    Only rows near the start are looked at, three thresholds wide; where the fit moves far, the caller starts again.
    """
    rows = rows[problem.residuals(model[None], rows)[0] < 3.0 * threshold]
    if hasattr(problem, "refit_robustly"):
        fitted = problem.refit_robustly(model, rows, np.ones(len(rows)), threshold, iterations)
        return fitted if np.isfinite(fitted).all() else model
    previous = np.zeros(len(rows))
    for _ in range(iterations):
        ratio = problem.residuals(model[None], rows)[0] / threshold
        weights = np.where(ratio < 1.0, (1.0 - ratio**2) ** 2, 0.0)
        if np.abs(weights - previous).max(initial=0.0) < 1e-9:
            break
        fitted = problem.refit(model, rows, weights)
        if not np.isfinite(fitted).all():
            break
        model, previous = fitted, weights
    return model


def inlier_fit(problem: Problem, model: Array, rows: Array, threshold: float) -> Array:
    """The least-squares model of a model's inliers, or the model itself where they do not determine one."""
    inliers = problem.residuals(model[None], rows)[0] < threshold
    fitted = problem.refit(model, rows, inliers.astype(np.float64))
    return fitted if np.isfinite(fitted).all() else model


def biweight_costs(problem: Problem, models: Array, rows: Array, threshold: float) -> Array:
    """Tukey's biweight loss summed over the rows, for each model: what `reweighted_fit` makes small.

    In units in which a row beyond the threshold costs 1; rows count by their weight. Infinite for a model of NaN.
    """
    weights = row_weights(problem, rows)
    costs = np.zeros(len(models))
    for start in range(0, len(rows), _BLOCK):
        block = slice(start, start + _BLOCK)
        ratios = np.minimum(problem.residuals(models, rows[block]) / threshold, 1.0)
        share = 1.0 - ratios * ratios
        losses = 1.0 - share * share * share  # numpy's power of 3 takes ten times as long
        costs += losses.sum(axis=1) if weights is None else losses @ weights[block]
    return np.where(np.isfinite(costs), costs, np.inf)


def row_weights(problem: Problem, rows: Array) -> Array | None:
    """The weights that rows carry, where the problem is `Weighted`."""
    return problem.row_weights(rows) if hasattr(problem, "row_weights") else None
