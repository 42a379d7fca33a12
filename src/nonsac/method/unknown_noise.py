"""The method if nobody gave the noise: it is found in the first samples, and measured on the answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from nonsac.estimators.contract import Estimator
from nonsac.method.noise import MORE_SURELY, first_findings, guessed_with
from nonsac.method.refine import Refinement
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis, Status

if TYPE_CHECKING:
    from nonsac.method.pipeline import Answer, Method

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
    further = first_findings(task, most, first.hypotheses, MORE_SURELY)
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


def _is_trusted(refinement: Refinement | None) -> bool:
    return refinement is not None and refinement.status in (Status.OK, Status.AMBIGUOUS)


def _is_final(refinement: Refinement | None) -> bool:
    """Whether nothing would be gained by drawing the samples again: it is trusted, or no more than chance."""
    if refinement is None or _is_trusted(refinement):
        return True
    return refinement.status is Status.LOW_SUPPORT and not refinement.remarks


def _measured(refinement: Refinement | None) -> float:
    noise = None if refinement is None else refinement.measured_noise
    return float("nan") if noise is None else noise


def _differ(measured: float, noise: float, factor: float) -> bool:
    return bool(np.isfinite(measured) and max(measured / noise, noise / measured) >= factor)
