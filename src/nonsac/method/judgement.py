"""Everything that is said of a model in the end: verdict, rivals, noise, covariance and remarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nonsac.estimators.ransac import minimal_samples
from nonsac.layouts import Array, Rows
from nonsac.method.noise import noise_remarks
from nonsac.method.residuals import measured_noise, noise_of_model, telling_of
from nonsac.method.verdict import Candidate, Effort, Verdict, alternative, judge_rows
from nonsac.problems.contract import Problem, solved
from nonsac.problems.fits import biweight_costs, reweighted_fit, trials_needed
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis, Status, Uncertainty

_COVARIANCE_ROWS = 5000
_RIVAL_ROWS, _NEARLY_AS_MUCH = 20_000, 0.8
_DRAWN_FROM, _MOST_DRAWN, _LIKELY = 2000, 2000, 0.99
_UNREPORTED_CONFIDENCE, _MOST_UNREPORTED = 0.99, 10**6


@dataclass(frozen=True, eq=False)
class Judgement:
    """What is said of a model.

    Attributes
    ----------
    candidate : Candidate
    verdict : Verdict
        In view of the best other answer.
    noise : float
        That the inliers show.
    covariance : (p, p) float64 or None
    uncertainty : Uncertainty or None
    """

    candidate: Candidate
    verdict: Verdict
    noise: float
    covariance: Array | None
    uncertainty: Uncertainty | None

    @classmethod
    def of(
        cls, problem: Problem, model: Array, rows: Rows, noise: Noise, hypotheses: Sequence[Hypothesis]
    ) -> Judgement:
        """What is said of a model that was chosen with these hypotheses in view."""
        candidate, effort = Candidate(problem, model, rows, noise), effort_of(problem, hypotheses)
        verdict = judge_rows(candidate, effort)
        if verdict.status is Status.OK:
            verdict = _beside_rival(candidate, verdict, hypotheses, effort)
        if noise.known:
            measured = measured_noise(candidate.residuals, noise.threshold, problem.residual_dimension)
        else:
            measured = noise_of_model(model, candidate.residuals, telling_of(problem, rows))
        trusted = verdict.status in (Status.OK, Status.AMBIGUOUS)
        covariance = _covariance(candidate) if trusted else None
        return cls(candidate, verdict, measured, covariance, _uncertainty(candidate, covariance))

    @property
    def num_inliers(self) -> int:
        return int(np.count_nonzero(self.candidate.inliers))

    @property
    def remarks(self) -> tuple[str, ...]:
        trusted = self.verdict.status in (Status.OK, Status.AMBIGUOUS)
        if not self.candidate.noise.known or not (trusted or self.verdict.remarks):
            return self.verdict.remarks
        return (*self.verdict.remarks, *noise_remarks(self.noise, self.candidate.noise.sigma))


def effort_of(problem: Problem, hypotheses: Sequence[Hypothesis]) -> Effort:
    """How long the search in all samples was.

    An estimator that does not report how many models it tested is taken to have drawn minimal samples until one of
    inliers alone had come up with 99 % probability, as RANSAC with its usual confidence does; if it found nothing, it
    may have compared any number, and need not have searched at all.
    """
    known = sum(h.tested for h in hypotheses if h.tested is not None)
    silent = [h for h in hypotheses if h.tested is None]
    assumed = sum(_assumed(problem, h) for h in silent if h.found)
    return Effort(known + assumed + _MOST_UNREPORTED * sum(not h.found for h in silent), known + assumed)


def _assumed(problem: Problem, hypothesis: Hypothesis) -> int:
    ratio = hypothesis.num_inliers / max(len(hypothesis.residuals), 1)
    return min(trials_needed(ratio, problem.minimal_size, _UNREPORTED_CONFIDENCE), _MOST_UNREPORTED)


def _covariance(candidate: Candidate) -> Array | None:
    if candidate.rows.weights is not None:  # a covariance would have to know what weights mean
        return None
    inliers = candidate.rows[candidate.inliers]
    some = inliers.some(_COVARIANCE_ROWS)  # it falls with their number
    covariance = candidate.problem.covariance(candidate.model, some.values, candidate.noise)
    return None if covariance is None else covariance * (len(some) / len(inliers))


def _uncertainty(candidate: Candidate, covariance: Array | None) -> Uncertainty | None:
    """What the covariance means, if inliers that say the same count once."""
    if covariance is None or not candidate.inliers.any():
        return None
    inliers = candidate.rows.values[candidate.inliers]
    found = candidate.problem.uncertainty(covariance, candidate.model, inliers)
    if found is None:
        return None
    return found.times(candidate.resolved.repetition**0.5)


def _beside_rival(candidate: Candidate, verdict: Verdict, hypotheses: Sequence[Hypothesis], effort: Effort) -> Verdict:
    """The verdict in view of the best other answer, which must explain rows that this one does not, beyond chance.

    Another motion of the same scene is one. If it has nearly as much support, nothing tells which is meant. It is one
    of the hypotheses, or found by drawing from the rows that the answer does not explain.
    """
    problem, noise, rows = candidate.problem, candidate.noise, candidate.rows
    rest = rows[~candidate.inliers]
    some = rest.some(_RIVAL_ROWS)
    if len(some) <= problem.minimal_size:
        return verdict
    models = np.stack([*(h.model for h in hypotheses if h.found), *_drawn(candidate, rest)])
    first = models[int(np.argmin(biweight_costs(problem, models, some, noise.threshold)))]
    rival = Candidate(problem, reweighted_fit(problem, first, some, noise.threshold, 20), some, noise)
    explained = rows.values[candidate.inliers]
    if np.median(problem.residuals(rival.model[None], explained)[0]) < 3.0 * noise.threshold:
        return verdict  # the same answer, and inliers beyond the threshold
    if judge_rows(rival, effort).status is not Status.OK:
        return verdict
    share = rival.support * len(rest) / len(rows)
    alternatives = (*verdict.alternatives, alternative(problem, rival.model, share))
    if share < _NEARLY_AS_MUCH * candidate.support:
        return replace(verdict, alternatives=alternatives)
    return replace(verdict, status=Status.AMBIGUOUS, confidence=min(verdict.confidence, 0.5), alternatives=alternatives)


def _drawn(candidate: Candidate, rest: Rows) -> Array:
    """The best model of minimal samples of the other rows, enough for one with nearly as much support; or none."""
    problem, few = candidate.problem, rest.some(_DRAWN_FROM)
    share = _NEARLY_AS_MUCH * candidate.support * len(candidate.rows) / len(rest)
    trials = trials_needed(min(share, 1.0), problem.minimal_size, _LIKELY) if share > 0.0 else _MOST_DRAWN + 1
    if trials > _MOST_DRAWN:
        return np.empty((0, *problem.model_shape))
    rng = np.random.default_rng(len(rest))
    models = solved(problem, few.values[minimal_samples(len(few), problem.minimal_size, trials, rng)])
    if not len(models):
        return models
    counts = problem.count_inliers(models, few.values, candidate.noise.threshold)
    return models[[int(np.argmax(counts))]]
