"""NONSAC on one page: sample, estimate in each sample, select, refine, judge (Lee, Vandewalle and Civera, Fig. 1)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from nonsac.estimators.contract import Estimator
from nonsac.layouts import Array
from nonsac.method import scoring
from nonsac.method.block_draw import blocks_behind, remarks_on_blocks
from nonsac.method.budget import Budget, chosen_blocks, first_round, kept, next_size
from nonsac.method.doubts import certainty
from nonsac.method.refine import Refinement, refined
from nonsac.method.search import SampleTask, Search, Stop
from nonsac.method.settings import Settings
from nonsac.method.unknown_noise import run_at_any_noise
from nonsac.method.wrong_noise import remarks_on_noise
from nonsac.problems.contract import Problem
from nonsac.problems.noise import Noise
from nonsac.result import Evidence, Hypothesis, Remark, Result, Status, failed
from nonsac.running.clock import Stopwatch
from nonsac.running.memory import peak_memory
from nonsac.seeds import canonical_seed
from nonsac.sources.contract import Source
from nonsac.sources.some_blocks import whole
from nonsac.values.quiet import quiet
from nonsac.values.version import VERSION

_CLEAR, _NEARLY_CLEAR = 0.99, 0.9
_ENOUGH_FOR_SPECIAL_CASES = 8
_ENOUGH_FAILURES = 8
# Models tested without a find. Of two views they are those of 300,000 minimal samples, one of which is right with 95 %
# probability if 10 % of the rows are; in proportion for more samples than by default.
_ENOUGH_MODELS, _ENOUGH_FOR_EACH_SAMPLE = 125_000, 1250


@quiet
def run(source: Source, problem: Problem, estimator: Estimator, settings: Settings, stop: Stop | None = None) -> Result:
    """Estimate a model from a source whose rows fit the problem."""
    if estimator.needs_weights and source.width <= problem.width:
        raise ValueError(
            "this estimator draws rows in the order of their weights, and these have none: give weights=, or a column "
            "weight"
        )
    budget = Budget.of(source, problem, estimator, settings)
    seed = canonical_seed(settings.rng)
    deadline = None if settings.time_limit is None else time.perf_counter() + settings.time_limit
    unknown = Noise.given(float("nan"), known=False)
    noise = unknown if settings.noise is None else Noise.given(settings.noise)
    source = kept(chosen_blocks(source, budget, settings, seed), seed, budget.max_rows)
    task = SampleTask(source, problem, budget.estimator, noise, budget.sample_size, seed)
    search = Search(
        task,
        budget.samples,
        settings.workers,
        stop,
        settings.progress,
        deadline,
        budget.max_rows,
        settings.max_memory,
    )
    method = Method(search, settings)
    if len(source) < problem.minimal_size:
        return Answer(search, None, (), Stopwatch()).result(settings, Status.TOO_FEW)
    answer = method.run(noise) if noise.known else run_at_any_noise(method, estimator)
    answer = answer.finished(settings)
    remarks = remarks_on_noise(answer.search, answer.refinement) if noise.known else ()
    return answer.result(settings, remarks=(*remarks, *remarks_on_blocks(answer.search, answer.model)))


@dataclass(frozen=True)
class Method:
    """The method itself, with the parts that were chosen."""

    search: Search
    settings: Settings

    def run(self, noise: Noise, found: Sequence[Hypothesis] = ()) -> Answer:
        """Sample, estimate in each sample, select, refine and judge; again with more samples until that is clear.

        `found` is what was found in the first samples.
        """
        search, clock, settings = self.search.begun(noise, found), Stopwatch(), self.settings
        count, before = first_round(len(found)) if settings.samples == "auto" else search.most, None
        while True:
            search.draw(count)
            clock.lap("hypotheses")
            winner, scores = scoring.select(settings.rule, search.hypotheses, search.problem)
            clock.lap("selection")
            refinement = None
            if search.hypotheses[winner].found:
                refinement = _certain_enough(refined(settings.refine, search, winner), settings)
            clock.lap("refinement")
            if search.ended or _is_settled(refinement, before, search.hypotheses, settings):
                return Answer(search, refinement, scoring.scored(search.hypotheses, scores), clock)
            if settings.sample_size == "auto":
                search.task = replace(search.task, sample_size=next_size(refinement, len(search.task.source)))
            count, before = len(search.hypotheses), refinement

    def judged_at(self, noise: Noise, answer: Answer) -> Answer:
        """What is made of the same hypotheses at another noise."""
        search, settings = answer.search.at(noise), self.settings
        winner = scoring.select(settings.rule, search.hypotheses, search.problem)[0]
        refinement = _certain_enough(refined(settings.refine, search, winner), settings)
        answer.clock.lap("refinement")
        return replace(answer, search=search, refinement=refinement)


@dataclass(frozen=True)
class Answer:
    """What the method came to, and how it got there."""

    search: Search
    refinement: Refinement | None
    hypotheses: tuple[Hypothesis, ...]
    clock: Stopwatch

    @property
    def model(self) -> Array | None:
        return None if self.refinement is None else self.refinement.model

    def finished(self, settings: Settings) -> Answer:
        """The answer after the refiner's last step."""
        if self.refinement is None:
            return self
        refinement = settings.refine.finish(self.search, self.refinement)
        if refinement is not self.refinement:
            self.clock.lap("all rows")
        return replace(self, refinement=refinement)

    def result(self, settings: Settings, reason: Status | None = None, remarks: tuple[str, ...] = ()) -> Result:
        """The answer as users get it; without a model, with the reason why there is none."""
        search, refinement, noise = self.search, self.refinement, self.search.noise
        evidence = Evidence(search.problem, whole(search.task.source))
        info = self._described(settings, remarks)
        if refinement is None:
            reason = reason or (Status.TIME_LIMIT if search.late else _reason(search))
            return failed(reason, evidence, info, noise.sigma, noise.threshold, self.hypotheses)
        late = search.late and refinement.status is Status.LOW_SUPPORT
        return Result(
            model=refinement.model,
            status=Status.TIME_LIMIT if late else refinement.status,
            confidence=refinement.confidence,
            num_inliers=refinement.num_inliers,
            num_rows=refinement.num_rows,
            noise=noise.sigma if refinement.noise is None else refinement.noise,
            threshold=noise.threshold if refinement.threshold is None else refinement.threshold,
            hypotheses=self.hypotheses,
            alternatives=refinement.alternatives,
            covariance=refinement.covariance,
            uncertainty=refinement.uncertainty,
            info=info | refinement.info,
            evidence=evidence,
        )

    def _described(self, settings: Settings, remarks: tuple[str, ...]) -> dict[str, Any]:
        """What another run needs to give the same answer, and what this one took."""
        refinement, task = self.refinement, self.search.task
        info = {
            "seed": task.seed,
            "version": VERSION,
            "estimator": type(task.estimator).__name__,
            "rule": settings.rule.name,
            "samples": len(self.hypotheses),
            "sample_size": min(task.sample_size, len(task.source)),
            "dropped_rows": sum(h.dropped for h in self.hypotheses),
            "remarks": (*(() if refinement is None else refinement.remarks), *remarks, *_on_failures(self.hypotheses)),
            "seconds": self.clock.laps,
            "peak_memory": peak_memory(),
        }
        if (blocks := blocks_behind(task.source)) is not None:
            info["blocks"] = len(blocks.firsts)
        if refinement is not None and refinement.measured_noise is not None:
            info["measured_noise"] = refinement.measured_noise
        return info


def _is_settled(
    refinement: Refinement | None, before: Refinement | None, hypotheses: list[Hypothesis], settings: Settings
) -> bool:
    """Whether more samples would not change the verdict, or hardly ever: half as many told nearly as much, say."""
    if refinement is None:
        return len(hypotheses) >= _ENOUGH_FAILURES and all(h.fault for h in hypotheses)
    if refinement.status is Status.OK:
        least = min(refinement.confidence, 0.0 if before is None else before.confidence)
        return refinement.confidence >= _CLEAR or least >= _NEARLY_CLEAR
    if refinement.is_chance:  # a search so long would have found most of what is there
        tested = sum(hypothesis.tested or 0 for hypothesis in hypotheses)
        return tested >= max(_ENOUGH_MODELS, _ENOUGH_FOR_EACH_SAMPLE * settings.max_samples)
    return (
        refinement.status not in (Status.LOW_SUPPORT, Status.UNCERTAIN) and len(hypotheses) >= _ENOUGH_FOR_SPECIAL_CASES
    )


def _certain_enough(refinement: Refinement, settings: Settings) -> Refinement:
    """The same, not trusted if it is more uncertain than the settings allow."""
    if refinement.status is not Status.OK or refinement.uncertainty is None or settings.max_uncertainty is None:
        return refinement
    doubt = 1.0 - certainty(refinement.uncertainty.within(settings.max_uncertainty))
    confidence = max(0.0, refinement.confidence - doubt)
    return replace(refinement, status=Status.OK if confidence >= 0.5 else Status.UNCERTAIN, confidence=confidence)


def _reason(search: Search) -> Status:
    """Why no sample gave a model."""
    problem, rows = search.problem, search.union()
    if len(rows) < problem.minimal_size:
        return Status.DEGENERATE if rows.copies else Status.TOO_FEW
    determined = problem.determined(problem.no_model, rows.values, search.noise)
    return Status.LOW_SUPPORT if determined else Status.DEGENERATE


def _on_failures(hypotheses: tuple[Hypothesis, ...]) -> tuple[str, ...]:
    """What is said if the estimator failed in some samples."""
    faults = [h.fault for h in hypotheses if h.fault]
    if not faults:
        return ()
    return (Remark.ESTIMATOR_FAILED.detailed(f"{len(faults)} of {len(hypotheses)} ({faults[0]})"),)
