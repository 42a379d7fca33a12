"""Whether an answer that is not trusted at the given noise would be at another one."""

from __future__ import annotations

import numpy as np

from nonsac.layouts import Array, Rows
from nonsac.method.judgement import effort_of
from nonsac.method.noise import attempt, guessed_noise, noise_remarks, noise_seen_by
from nonsac.method.refine import Refinement
from nonsac.method.residuals import Residuals, chance_rate, measured_noise
from nonsac.method.search import Search
from nonsac.method.verdict import Candidate, judge_rows
from nonsac.problems.contract import solved
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis, Remark, Status

_TOO_WIDE = 0.05
_MINIMAL_SAMPLES = 50
_ON_NOISE = (Remark.NOISE_LARGER, Remark.NOISE_SMALLER)


def remarks_on_noise(search: Search, refinement: Refinement | None) -> tuple[str, ...]:
    """What is said of the given noise if another one explains the rows, and the answer is not trusted.

    At a noise that is too large, the answer may be right, and its inliers show how large the noise is; else a noise
    is guessed, and a model is estimated at that, from the rows of one sample.
    """
    if refinement is not None and (refinement.status in (Status.OK, Status.AMBIGUOUS) or _is_told(refinement)):
        return ()
    rows, given = search.union().some(search.task.sample_size), search.noise.sigma
    if refinement is not None:
        seen = _noise_of_significant(search, rows, refinement.model, search.hypotheses, refinement.measured_noise)
        if remarks := noise_remarks(seen, given):
            return remarks
    if search.is_late() or len(rows) <= search.problem.minimal_size:
        return ()
    rng = np.random.default_rng([search.task.seed, 0, 3])
    guessed = _suspected(search, rows, refinement, rng)
    if guessed is None or not noise_remarks(guessed, given):
        return ()
    found = attempt(search.problem, search.task.estimator, rows, Noise.given(guessed, known=False), rng)
    if found is None or not found.found:
        return ()
    return noise_remarks(_noise_of_significant(search, rows, found.model, [found], guessed), given)


def _suspected(search: Search, rows: Rows, refinement: Refinement | None, rng: np.random.Generator) -> float | None:
    """Another noise, if there is reason to suspect that the given one is wrong.

    If it is so large that many wrong rows are within the threshold, no model can mean anything, and the noise is
    guessed as if it had not been given. If it is too small, the models of minimal samples are still nearly right.
    """
    problem, threshold = search.problem, search.noise.threshold
    if refinement is not None:
        by_chance = Residuals.of(problem, refinement.model, rows).background
        if chance_rate(by_chance, threshold) > _TOO_WIDE:
            return guessed_noise(problem, search.task.estimator, rows, rng)
    samples = np.stack([rng.choice(len(rows), problem.minimal_size, replace=False) for _ in range(_MINIMAL_SAMPLES)])
    found = [h.model for h in search.hypotheses if h.found][:_MINIMAL_SAMPLES]
    models = [model for model in (*found, *solved(problem, rows.values[samples])) if np.isfinite(model).all()]
    return noise_seen_by(problem, np.stack(models), rows, 3.0 * threshold) if models else None


def _is_told(refinement: Refinement) -> bool:
    return any(remark.startswith(kind) for remark in refinement.remarks for kind in _ON_NOISE)


def _noise_of_significant(
    search: Search, rows: Rows, model: Array, hypotheses: list[Hypothesis], noise: float | None
) -> float:
    """The noise that a model shows, if it has more inliers at that noise than by chance; else the given one."""
    given, problem = search.noise.sigma, search.problem
    if noise is None or not noise > 0.0:
        return given
    candidate = Candidate(problem, model, rows, Noise.given(noise, known=False))
    verdict = judge_rows(candidate, effort_of(problem, hypotheses))
    if verdict.status is not Status.OK and Remark.PARTLY_RIGHT not in verdict.remarks:
        return given
    return measured_noise(candidate.residuals, candidate.noise.threshold, problem.residual_dimension)
