"""The runs of a comparison, as they are done in a process of their own: one method, one sample size, one seed."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from nonsac import simulate
from nonsac.estimators.contract import Estimator
from nonsac.estimators.named import chosen_estimator, default_estimator
from nonsac.layouts import Array
from nonsac.method import pipeline
from nonsac.method.scoring import FixedSample, Ideal, ScoringRule, paper_rules, select
from nonsac.method.search import SampleTask, Search
from nonsac.method.settings import Settings
from nonsac.problems.contract import Problem
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis, Result
from nonsac.running.clock import Stopwatch
from nonsac.running.metered import Used, metered
from nonsac.sources import ArraySource
from nonsac.sources.contract import Source
from nonsac.values.numeric import LEAST
from nonsac.values.quiet import quiet

ALONE, CORE, REFINED = "alone", "core", "refined"
_WARM_ROWS, _WARM_OUTLIERS, _WARM_NOISE = 400, 0.3, 0.001
_SIMULATED: dict[str, Callable[..., Any]] = {
    "relative_pose": simulate.relative_pose,
    "absolute_pose": simulate.absolute_pose,
    "register_pairs": simulate.registration,
}


@dataclass(frozen=True)
class Run:
    """What a run gave, and what it took.

    Attributes
    ----------
    model : float64 or None
        None if there is none.
    status : str or None
        Our verdict, `nonsac.Status`; None if there was none.
    confidence : float
    used : Used
    fault : str
        Why the estimator gave nothing, if it failed.
    noise : float
        At which the answer was found.
    """

    model: Array | None
    status: str | None
    confidence: float
    used: Used
    fault: str = ""
    noise: float = float("nan")


@dataclass(frozen=True)
class Subject:
    """A method and the rows that it sees; prepared, the estimator is at hand."""

    source: Source
    problem: Problem
    method: str | Estimator | Any
    call: str = ""

    def __call__(self) -> Prepared:
        return Prepared(self, chosen_estimator(self.method, self.problem))


@dataclass(frozen=True)
class Prepared:
    """What the runs of a process share."""

    subject: Subject
    estimator: Estimator

    def settings(self, noise: float | None, seed: int, **more: Any) -> Settings:
        return Settings.of("compare", {"noise": noise, "rng": seed, "workers": 1, **more}).fitting(self.subject.problem)

    def result(self, settings: Settings) -> Result:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return pipeline.run(self.subject.source, self.subject.problem, self.estimator, settings)


@dataclass(frozen=True)
class WarmUp:
    """A first run of a kind, on few rows, that is not reported: libraries are loaded, and kernels."""

    alone: bool
    noise: float | None

    def __call__(self, prepared: Prepared) -> None:
        source, noise = _few_rows(prepared.subject, self.noise)
        few = replace(prepared, subject=replace(prepared.subject, source=source))
        size = max(_WARM_ROWS // 4, prepared.subject.problem.minimal_size)
        if self.alone:
            Alone(size, noise, 0)(few)
        else:
            given = None if self.noise is None else noise
            few.result(few.settings(given, 0, max_samples=2, sample_size=size))


def _few_rows(subject: Subject, noise: float | None) -> tuple[Source, float]:
    """Simulated rows, most of which are right, and their noise; the first rows if the problem is somebody's own."""
    problem = subject.problem
    if subject.call not in _SIMULATED:
        count = min(_WARM_ROWS, len(subject.source))
        return ArraySource(subject.source.take(np.arange(count, dtype=np.int64))), noise or _WARM_NOISE
    made = _SIMULATED[subject.call](_WARM_ROWS, _WARM_OUTLIERS, _WARM_NOISE, 0)
    first, second = list(vars(made).values())[:2]
    rows = np.hstack([first, second])
    shown = float(np.median(problem.residuals(made.T[None, :3], rows[made.inliers])))  # in the unit of the problem
    weights = np.ones((_WARM_ROWS, subject.source.width - problem.width))
    return ArraySource(np.hstack([rows, weights])), max(shown, LEAST)


@dataclass(frozen=True)
class Alone:
    """The estimator alone, on one sample, as it is used without NONSAC; its answer is judged besides.

    `known` says whether somebody gave the noise, or it was measured.
    """

    sample_size: int
    noise: float
    seed: int
    known: bool = True

    def __call__(self, prepared: Prepared) -> Run:
        subject, size = prepared.subject, min(self.sample_size, len(prepared.subject.source))
        noise = Noise.given(self.noise, known=self.known)
        task = SampleTask(subject.source, subject.problem, prepared.estimator, noise, size, self.seed)
        with metered() as used:
            hypothesis = task(0)
        if not hypothesis.found:
            return Run(None, None, 0.0, used, hypothesis.fault, self.noise)
        status, confidence = _judged(task, hypothesis, prepared.settings(None, self.seed, refine="none"))
        return Run(hypothesis.model, status, confidence, used, noise=self.noise)


@quiet
def _judged(task: SampleTask, hypothesis: Hypothesis, settings: Settings) -> tuple[str | None, float]:
    """Our verdict on what was found in the first sample, as it is."""
    search = Search(task, 1, 1, None, None, None).begun(task.noise, [hypothesis])
    answer = pipeline.Answer(search, None, (), Stopwatch())
    refinement = pipeline.Method(search, settings).judged_at(task.noise, answer).refinement
    return (None, 0.0) if refinement is None else (str(refinement.status), refinement.confidence)


@dataclass(frozen=True)
class Core:
    """The estimator as the core of the method, with its default settings."""

    sample_size: int | None
    noise: float | None
    seed: int

    def __call__(self, prepared: Prepared) -> Run:
        size = "auto" if self.sample_size is None else self.sample_size
        settings = prepared.settings(self.noise, self.seed, sample_size=size)
        with metered() as used:
            result = prepared.result(settings)
        return run_of(result, used)


def run_of(result: Result, used: Used) -> Run:
    """What a result says of a run."""
    faults = [h.fault for h in result.hypotheses if h.fault]
    all_failed = bool(faults) and len(faults) == len(result.hypotheses)
    model = result.model if result.found else None
    fault = faults[0] if all_failed else ""
    return Run(model, str(result.status), result.confidence, used, fault, result.noise)


@dataclass(frozen=True)
class Rules:
    """What each of the paper's rules selects from the same hypotheses, for several numbers of them.

    `fixed` spends the budget of all samples on one, and `refined` is the whole method on as many samples.
    """

    sample_size: int
    noise: float
    seed: int
    counts: tuple[int, ...]
    known: bool = True
    truth: Array | None = field(default=None, compare=False)

    def __call__(self, prepared: Prepared) -> dict[tuple[int, str], Run]:
        subject, runs = prepared.subject, {}
        size, noise = min(self.sample_size, len(subject.source)), Noise.given(self.noise)
        task = SampleTask(subject.source, subject.problem, prepared.estimator, noise, size, self.seed)
        given = self.noise if self.known else None
        hypotheses: list[Hypothesis] = []
        spent = Used(memory=0)
        for count in sorted(self.counts):
            with metered() as used:
                hypotheses += [task(sample) for sample in range(len(hypotheses), count)]
            spent = _sum(spent, used)
            for rule in self._rules():
                with metered() as used:
                    winner = hypotheses[select(rule, hypotheses, subject.problem)[0]]
                runs[count, rule.name] = _run_of(winner, _sum(spent, used), self.noise)
            with metered() as used:
                _, estimator = FixedSample().plan(count, prepared.estimator)
                winner = replace(task, estimator=estimator)(0)
            runs[count, FixedSample().name] = _run_of(winner, used, self.noise)
            settings = prepared.settings(given, self.seed, max_samples=count, sample_size=size)
            with metered() as used:
                result = prepared.result(settings)
            runs[count, REFINED] = run_of(result, used)
        return runs

    def _rules(self) -> Sequence[ScoringRule]:
        return paper_rules() if self.truth is None else (Ideal(self.truth), *paper_rules())

    def names(self) -> list[str]:
        """Of all rules, in the order of the paper's Table 2."""
        first = ["ideal", "fixed"] if self.truth is not None else ["fixed"]
        return [*first, *(rule.name for rule in paper_rules()), REFINED]


def _run_of(hypothesis: Hypothesis, used: Used, noise: float) -> Run:
    return Run(hypothesis.model if hypothesis.found else None, None, 0.0, used, hypothesis.fault, noise)


def _sum(a: Used, b: Used) -> Used:
    known = [used.memory for used in (a, b) if used.memory is not None]
    return Used(a.seconds + b.seconds, a.cpu_seconds + b.cpu_seconds, max(known) if len(known) == 2 else None)


def reference(source: Source, problem: Problem, call: str) -> Subject:
    """The default method, which measures the noise if nobody gives it."""
    return Subject(source, problem, default_estimator(problem), call)
