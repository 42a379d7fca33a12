"""How large the noise of the inliers is, before there is a model, and what is said if it was given wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nonsac.estimators.contract import Estimator, checked_hypothesis
from nonsac.layouts import Array, Rows
from nonsac.method.residuals import Residuals, background, chance_rate, measured_noise, noise_of_model, telling_of
from nonsac.method.search import SampleTask
from nonsac.problems.contract import ContractBroken, Problem, blame, residuals_of, solved
from nonsac.problems.fits import reweighted_fit
from nonsac.problems.ladder import log_chance
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis, Remark

__all__ = ["MORE_SURELY", "attempt", "guessed_noise", "noise_remarks", "noise_seen_by"]

_RUNGS = 4.0 ** -np.arange(1.0, 7.0)  # thresholds, as shares of the residuals of wrong rows
_MODELS = 50
_FALLBACK_SHARE = 0.01
_LEAST_SHARE = 1e-6  # exact rows leave residuals of rounding only
_VERY_DIFFERENT = 3.0
_SURELY, MORE_SURELY = 2.5, 8.0
_SAMPLES_FOR_NOISE, _SAMPLES_FOR_GUESS = 12, 3
_NO_CHANGE = 0.1
_TURNS, _FIT, _LEAST_RUNG = 3, 10, 0.01
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


class Findings(NamedTuple):
    """What was found in the first samples without a noise: the hypotheses, and the noise of the best one."""

    hypotheses: tuple[Hypothesis, ...]
    noise: float


def first_findings(
    task: SampleTask, samples: int, before: Sequence[Hypothesis] = (), surely: float = _SURELY
) -> Findings | None:
    """What the estimator finds in the first sample, or some, if it needs no noise; None if it does.

    Samples are looked at, after those whose findings are given, until a model is found that no wrong rows would give by
    chance, nor a model that is right in part; `surely` says how far it must be beyond chance. Its noise is measured on
    the rows of its sample, and the model fitted again with that, by turns.
    """
    found = list(before)
    for sample in range(len(found), min(_SAMPLES_FOR_NOISE, samples)):
        rows, dropped = task.rows(sample)
        rng = np.random.default_rng([task.seed, task.number + sample])
        hypothesis = _at_any_noise(task, rows, rng)
        if hypothesis is None:
            if not found:
                return None
            break
        found.append(replace(_settled(task.problem, hypothesis, rows), sample=sample, dropped=dropped))
        if hypothesis.log_chance < surely * _LOG_CHANCE - np.log(max(hypothesis.tested or 1, 1)):
            break
    best = min(found, key=lambda hypothesis: hypothesis.log_chance)
    return Findings(tuple(found), Noise.within(best.threshold).sigma)


def _at_any_noise(task: SampleTask, rows: Rows, rng: np.random.Generator) -> Hypothesis | None:
    """What the estimator finds; None if it needs a noise, or fails."""
    if len(rows) <= task.problem.minimal_size:
        return None
    try:
        found = task.estimator.estimate_at_any_noise(task.problem, rows, rng)
    except ContractBroken:
        raise
    except Exception as error:
        blame(task.problem, rows, 1.0, error)
        return None
    if found is None or not found.found:
        return None
    return checked_hypothesis(found, task.problem, task.estimator, "estimate_at_any_noise")


def _settled(problem: Problem, found: Hypothesis, rows: Rows) -> Hypothesis:
    """The model at the noise that it shows."""
    threshold = found.threshold
    model = reweighted_fit(problem, found.model, rows, threshold, _FIT)
    telling = telling_of(problem, rows)
    for _ in range(_TURNS):
        noise = noise_of_model(model, Residuals.of(problem, model, rows), telling)
        before, threshold = threshold, max(Noise.given(noise).threshold, _LEAST_RUNG * found.threshold)
        if not noise > 0.0:
            threshold = before
            break
        if abs(threshold - before) < _NO_CHANGE * before:
            break
        model = reweighted_fit(problem, model, rows, threshold, _FIT)
    residuals = residuals_of(problem, model[None], rows.values)[0]
    return replace(found, model=model, residuals=residuals, threshold=threshold)


def guessed_with(task: SampleTask, estimator: Estimator, samples: int) -> float:
    """`guessed_noise` from rows of the first samples."""
    rng = np.random.default_rng([task.seed, 0, 2])
    rows = task.union(min(_SAMPLES_FOR_GUESS, samples))  # more than one, as some may not be finite
    return guessed_noise(task.problem, estimator, rows[rng.permutation(len(rows))[: task.sample_size]], rng)


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
    table = rows.some(_ROWS_SEEN).values
    by_chance, residuals = (
        np.sort(residuals_of(problem, models, values), axis=1)
        for values in (background(problem, table, _ROWS_SEEN), table)
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
    residuals = residuals_of(problem, models, background(problem, rows, 500)) if len(models) else np.empty(0)
    finite = residuals[np.isfinite(residuals)]
    return float(np.median(finite)) if len(finite) else float("nan")
