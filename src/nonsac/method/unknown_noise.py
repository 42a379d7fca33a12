"""The method if nobody gave the noise: it is found in the first samples, and measured on the answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from nonsac.estimators.contract import Estimator, checked_hypothesis
from nonsac.layouts import Rows
from nonsac.method.noise import guessed_noise
from nonsac.method.refine import Refinement
from nonsac.method.residuals import Residuals, noise_of_model, telling_of
from nonsac.method.search import SampleTask
from nonsac.problems.contract import ContractBroken, Problem, blame, residuals_of
from nonsac.problems.fits import reweighted_fit
from nonsac.problems.ladder import BEYOND, LADDER, Telling
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis, Status

if TYPE_CHECKING:
    from nonsac.method.pipeline import Answer, Method

_SURELY, _MORE_SURELY = 2.5, 8.0  # a model that is right in part means something, too
_LOG_CHANCE = float(np.log(1e-6))
_SAMPLES_FOR_NOISE, _SAMPLES_FOR_GUESS, _JOINTLY_AFTER = 12, 3, (2, 4, 8)
_NO_CHANGE = 0.1
_TURNS, _FIT, _LEAST_RUNG = 3, 10, 0.01
_MOST_REPETITIONS, _SAME_NOISE, _ANOTHER_NOISE = 3, 1.25, 3.0
_MUCH_LESS = 2.0  # a fit to ever nearer rows would show ever less
_LEAST_SHARE = 0.1


def run_at_any_noise(method: Method, estimator: Estimator) -> Answer:
    """The method at the noise that is found with the model, in the first samples.

    If the answer is not to be trusted, that may have been a model that is right in part: further samples are then
    looked at. Estimators that need a noise are called with several first.
    """
    task, most = method.search.task, method.search.most
    first = first_findings(task, most)
    if first is None:
        return _run_from(method, guessed_with(task, estimator, most))
    answer = _run_from(method, first.noise, first.hypotheses)
    if _is_trusted(answer.refinement) or method.search.is_late():
        return answer
    further = first_findings(task, most, first.hypotheses, _MORE_SURELY)
    if further is None or further.noise == first.noise:
        return answer
    another = _run_from(method, further.noise, further.hypotheses)
    return another if _is_trusted(another.refinement) else answer


def _run_from(method: Method, noise: float, found: Sequence[Hypothesis] = ()) -> Answer:
    """The method at a noise that nobody gave, with what was found in the first samples; judged at that of the answer.

    If that is very different, the samples are drawn again.
    """
    least = _LEAST_SHARE * noise
    for _ in range(_MOST_REPETITIONS):
        searched_at, answer = noise, method.run(Noise.given(noise, known=False), found)
        for _ in range(_MOST_REPETITIONS):
            measured = max(_measured(answer.refinement), least)
            if not _differ(measured, noise, _SAME_NOISE if measured > noise else _MUCH_LESS):
                break
            noise = measured
            answer = method.judged_at(Noise.given(noise, known=False), answer)
        if _is_final(answer.refinement) or not _differ(noise, searched_at, _ANOTHER_NOISE):
            break
        if method.search.is_late():
            break
        found = ()
    return answer


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
    found, looked_at = list(before), []
    for sample in range(len(found), min(_SAMPLES_FOR_NOISE, samples)):
        rows, dropped = task.rows(sample)
        rng = np.random.default_rng([task.seed, task.number + sample])
        hypothesis = _at_any_noise(task, rows, rng)
        if hypothesis is None:
            if not found:
                return None
            break
        found.append(replace(hypothesis, sample=sample, dropped=dropped))
        looked_at.append(rows)
        if _is_sure(hypothesis, surely):
            break
        if len(looked_at) in _JOINTLY_AFTER:
            joint = _jointly(task, found, Rows.joined(looked_at), rng)
            if joint is not None and _is_sure(joint, surely):
                return Findings(tuple(found), Noise.within(joint.threshold).sigma)
    best = min(range(len(found)), key=lambda number: found[number].log_chance)
    if best >= len(before):
        found[best] = _settled(task.problem, found[best], looked_at[best - len(before)])
    return Findings(tuple(found), Noise.within(found[best].threshold).sigma)


def _is_sure(found: Hypothesis, surely: float) -> bool:
    """Whether a model is so far beyond chance, out of all that were tested."""
    return found.log_chance < surely * _LOG_CHANCE - np.log(max(found.tested or 1, 1))


def _jointly(task: SampleTask, found: Sequence[Hypothesis], rows: Rows, rng: np.random.Generator) -> Hypothesis | None:
    """What a joint search finds, judged on all rows of the samples, as its own were chosen."""
    name = "search_jointly_at_any_noise"
    try:
        joint = task.estimator.search_jointly_at_any_noise(task.problem, found, rng)
    except ContractBroken:
        raise
    except Exception:  # of somebody's estimator: the samples' own findings are there
        return None
    if joint is None or not checked_hypothesis(joint, task.problem, task.estimator, name).found:
        return None
    settled = _settled(task.problem, joint, rows)
    score = Telling(task.problem, rows).of(settled.model, settled.threshold * LADDER / LADDER[-1 - BEYOND]).score
    tested = sum(each.tested or 0 for each in (*found, joint))
    return replace(settled, log_chance=-score, tested=tested)


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


def _is_trusted(refinement: Refinement | None) -> bool:
    return refinement is not None and refinement.status in (Status.OK, Status.AMBIGUOUS)


def _is_final(refinement: Refinement | None) -> bool:
    """Whether nothing would be gained by drawing the samples again: it is trusted, or no more than chance."""
    if refinement is None or _is_trusted(refinement):
        return True
    return refinement.is_chance


def _measured(refinement: Refinement | None) -> float:
    noise = None if refinement is None else refinement.measured_noise
    return float("nan") if noise is None else noise


def _differ(measured: float, noise: float, factor: float) -> bool:
    return bool(np.isfinite(measured) and max(measured / noise, noise / measured) >= factor)
