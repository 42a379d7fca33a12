"""What speaks against a model that has more inliers than by chance: none of it needs to know the noise.

Real errors have heavier tails than wrong models: how residuals are spread within a threshold tells little. What tells
is whether the parts of the scene agree, and whether models beside the answer do as well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from nonsac.layouts import Array, Rows
from nonsac.method.residuals import Residuals, chance_rate
from nonsac.problems.contract import Problem
from nonsac.problems.fits import reweighted_fit
from nonsac.problems.noise import Noise

_NEAR = 3.0  # thresholds
_SPARE = 2  # rows beyond a minimal sample that a part must hold
_APART, _ERRORS = 8.0, 3.0  # degrees, and standard errors
_ITERATIONS, _MOST = 6, 5000
_LEAST_ACROSS, _OFTEN_ACROSS, _WIDER = 0.12, 0.5, (1.0, 2.0, 3.0)
_STEP = 1.25  # thresholds, in the mean over the inliers
# Shares of the threshold, and of the inliers that as many others may be: of a noise that was given, or not.
_GIVEN, _FOUND = (1.0, 0.2), (0.6, 0.15)


def certainty(ratio: float) -> float:
    """From 1 down to 0.5 where what speaks against an answer is as much as is allowed, and on to 0."""
    return max(0.0, 1.0 - 0.5 * max(ratio, 0.0) ** 4)


def disagreement(problem: Problem, model: Array, rows: Rows, noise: Noise, sigma: float) -> float | None:
    """How far models of one part of the scene are from models of the other part: 1 is as far as is allowed.

    The inliers are cut at the median along the two longest axes of either half of the rows, and the model is fitted to
    what is near it on each side. A right model agrees with itself; one that has gathered the true matches of one place,
    and what it could elsewhere, does not. Parts that determine little may differ more. `sigma` is the noise that the
    inliers show. None if no part has enough rows to be fitted, or the problem does not know its standard errors.
    """
    near = rows[problem.residuals(model[None], rows.values)[0] < _NEAR * noise.threshold].some(_MOST)
    inliers = problem.residuals(model[None], near.values)[0] < noise.threshold
    shown = Noise.given(sigma)
    if problem.standard_errors(model, near.values[inliers], shown) is None:
        return None
    most = None
    for half in problem.layout.parts(near.values):
        centred = half - half[inliers].mean(axis=0)
        for axis in np.linalg.svd(centred[inliers], full_matrices=False)[2][:2]:
            places = centred @ axis
            side = places > np.median(places[inliers])
            ratio = _apart(
                problem, model, [(near[part], near.values[part & inliers]) for part in (side, ~side)], noise, shown
            )
            if ratio is not None:
                most = max(ratio, most or 0.0)
    return most


def _apart(
    problem: Problem, model: Array, parts: Sequence[tuple[Rows, Array]], noise: Noise, shown: Noise
) -> float | None:
    """How far the models of two parts are from each other; a part is what is near the model there, and its inliers."""
    if min(len(inliers) for _, inliers in parts) < problem.minimal_size + _SPARE:
        return None
    fits = [reweighted_fit(problem, model, near, noise.threshold, _ITERATIONS) for near, _ in parts]
    errors = (problem.standard_errors(model, inliers, shown) for _, inliers in parts)
    allowed = max(_APART, _ERRORS * math.hypot(*(error[0] for error in errors if error is not None)))
    return float(problem.distance(*fits)) / allowed


def slippage(problem: Problem, model: Array, rows: Rows, noise: Noise, residuals: Residuals) -> float:
    """How many of the other rows a model beside this one explains, beyond chance: 1 is as many as are allowed.

    The model is moved by some thresholds along each axis of its information. Matches that slip along a surface, a round
    base or an epipolar line are explained by a continuum of models, none of which need be the right one. A noise that
    nobody gave may be that of the slipping: of the threshold then only the middle counts.
    """
    streaming = problem.streaming
    if streaming is None:
        return 0.0
    share, as_many = _GIVEN if noise.known else _FOUND
    threshold = share * noise.threshold
    inliers = rows.values[residuals.of_rows < threshold]
    if len(inliers) < problem.minimal_size:
        return 0.0
    pivot = streaming.pivot(inliers)
    hessian = streaming.normal_equations(model, inliers, _evenly, pivot)[0].hessian
    scale = np.sqrt(np.maximum(np.diagonal(hessian), 1e-300))
    values, axes = np.linalg.eigh(hessian / np.outer(scale, scale))
    sizes = _STEP * threshold * np.sqrt(len(inliers) / np.maximum(values, 1e-12))
    steps = np.ascontiguousarray((sizes * axes / scale[:, None]).T)
    beside = np.stack([streaming.moved(model, step, pivot) for step in (*steps, *-steps)])
    others = rows.values[residuals.of_rows >= threshold]
    counts = np.count_nonzero(problem.residuals(beside, others) < threshold, axis=1)
    beyond = counts - chance_rate(residuals.background, threshold) * len(others) - np.sqrt(counts)
    return float(max(beyond.max(), 0.0) / (as_many * len(inliers)))


def slipping_apart(problem: Problem, model: Array, rows: Rows, noise: Noise, residuals: Residuals) -> float:
    """How little of the squared residuals is across one motion: 1 is as little as is allowed.

    Errors have all directions, or one. Matches that slip around a round base err along its rotation alone, each by an
    angle of its own. A threshold may end too soon to tell, or be so large that it has other rows in it.
    """
    if problem.residual_dimension < 2:
        return 0.0
    near = (rows[residuals.of_rows < factor * noise.threshold].some(_MOST).values for factor in _WIDER)
    across = 1.0 - max(problem.share_of_one_motion(model, each, noise) for each in near)
    usual = _LEAST_ACROSS / _OFTEN_ACROSS
    return max(0.0, (_LEAST_ACROSS / max(across, 1e-3) - usual) / (1.0 - usual))


def _evenly(residuals: Array) -> tuple[Array, Array]:
    even = np.ones(len(residuals))
    return even, even
