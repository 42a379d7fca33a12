"""How large the noise of the inliers is, before there is a model, and what is said if it was given wrong."""

from __future__ import annotations

import numpy as np

from nonsac.estimators.contract import Estimator, checked_hypothesis
from nonsac.layouts import Array, Rows
from nonsac.method.residuals import Residuals, chance_rate, measured_noise
from nonsac.problems.contract import ContractBroken, Problem, background, blame, residuals_of, solved
from nonsac.problems.ladder import log_chance
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis, Remark

__all__ = ["attempt", "guessed_noise", "noise_remarks", "noise_seen_by"]

_RUNGS = 4.0 ** -np.arange(1.0, 7.0)  # thresholds, as shares of the residuals of wrong rows
_MODELS = 50
_FALLBACK_SHARE = 0.01
_LEAST_SHARE = 1e-6  # exact rows leave residuals of rounding only
_VERY_DIFFERENT = 3.0
_ROWS_SEEN, _LOG_CHANCE = 2000, float(np.log(1e-6))


def noise_remarks(measured: float, given: float) -> tuple[str, ...]:
    """What is said if the inliers show another noise than the given one."""
    ratio = measured / given
    if ratio > _VERY_DIFFERENT:
        return (Remark.NOISE_LARGER.detailed(f"by a factor of {_rounded(ratio)}"),)
    if ratio < 1.0 / _VERY_DIFFERENT:
        return (Remark.NOISE_SMALLER.detailed(f"by a factor of {_rounded(1.0 / max(ratio, 1e-9))}"),)
    return ()


def _rounded(factor: float) -> str:
    """Two digits, without an exponent."""
    two_digits = float(f"{factor:.2g}")
    return f"{two_digits:,.0f}" if two_digits >= 10.0 else f"{two_digits:g}"


def guessed_noise(problem: Problem, estimator: Estimator, rows: Rows, rng: np.random.Generator) -> float:
    """A noise level at which an estimate from these rows is least likely to come about by chance.

    Thresholds from a quarter of the residuals of wrong rows downwards are tried, each with an estimate of its
    own; the number of inliers is compared with that among the problem's background rows (Moisan and Stival, IJCV
    2004). If no estimate means anything, a hundredth of those residuals, or 1 if the rows have no extent.
    """
    try:
        unit = _residuals_of_wrong_rows(problem, rows.values, rng)
    except Exception as error:
        blame(problem, rows, 1.0, error)
        raise
    if not (np.isfinite(unit) and unit > 0.0):
        return 1.0
    best, least = _FALLBACK_SHARE * unit, 0.0
    for threshold in unit * _RUNGS:
        hypothesis = attempt(problem, estimator, rows, Noise.within(threshold, known=False), rng)
        if hypothesis is None or not hypothesis.found:
            continue
        residuals = Residuals.of(problem, hypothesis.model, rows)
        rate = chance_rate(residuals.background, float(threshold))
        meaning = log_chance(hypothesis.num_inliers - problem.minimal_size, len(rows), rate)
        if meaning < least:
            best, least = measured_noise(residuals, float(threshold), problem.residual_dimension), meaning
            if not np.isfinite(best):
                best = Noise.within(threshold).sigma
    return max(best, _LEAST_SHARE * unit)


def noise_seen_by(problem: Problem, models: Array, rows: Rows, above: float) -> float | None:
    """A noise level above some threshold at which one of some models (M, ...) has more inliers than by chance.

    Cheap, as nothing is estimated, and enough if the models are nearly right, as those of minimal samples are.
    """
    some = rows.some(_ROWS_SEEN)
    table = some.values
    by_chance, residuals = (
        np.sort(residuals_of(problem, models, values), axis=1)
        for values in (background(problem, some, _ROWS_SEEN), table)
    )
    best, least = None, _LOG_CHANCE - np.log(len(models) * len(_RUNGS))
    for threshold in float(np.nanmedian(by_chance)) * _RUNGS:
        if not threshold > above:
            continue
        for near, near_by_chance in zip(residuals, by_chance, strict=True):
            inliers = int(np.searchsorted(near, threshold))
            meaning = log_chance(inliers - problem.minimal_size, len(table), chance_rate(near_by_chance, threshold))
            if meaning < least:
                best, least = Noise.within(threshold).sigma, meaning
    return best


def attempt(
    problem: Problem, estimator: Estimator, rows: Rows, noise: Noise, rng: np.random.Generator
) -> Hypothesis | None:
    """What the estimator finds at this noise; None if it fails."""
    try:
        found = estimator.estimate(problem, rows, noise, rng)
    except ContractBroken:
        raise
    except Exception as error:
        blame(problem, rows, noise.threshold, error)
        return None
    return checked_hypothesis(found, problem, estimator)


def _residuals_of_wrong_rows(problem: Problem, rows: Array, rng: np.random.Generator) -> float:
    """What residuals rows without a match have, typically."""
    if len(rows) <= problem.minimal_size:
        return float("nan")
    samples = np.stack([rng.choice(len(rows), problem.minimal_size, replace=False) for _ in range(_MODELS)])
    models = solved(problem, rows[samples])
    residuals = residuals_of(problem, models, background(problem, Rows(rows), 500)) if len(models) else np.empty(0)
    finite = residuals[np.isfinite(residuals)]
    return float(np.median(finite)) if len(finite) else float("nan")
