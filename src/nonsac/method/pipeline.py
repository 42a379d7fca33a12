"""NONSAC on one page: sample, estimate in each sample, select, refine, judge (Lee, Vandewalle and Civera, Fig. 1)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import Any

import numpy as np

from nonsac.estimators.contract import Estimator
from nonsac.method import refine as refiners
from nonsac.method import scoring
from nonsac.method.budget import Auto, kept, next_round, next_size, planned_work
from nonsac.method.full_pass import fitted_to_all
from nonsac.method.noise import guessed_noise
from nonsac.method.refine import Refinement, Refiner
from nonsac.method.scoring import ScoringRule
from nonsac.method.search import SampleTask, Search, Stop
from nonsac.problems.contract import Problem
from nonsac.result import VERSION, Array, Evidence, Hypothesis, Result, Status, failed, homogeneous, threshold_of
from nonsac.running.clock import Stopwatch
from nonsac.running.executors import Workers
from nonsac.running.memory import bytes_of, peak_memory, rows_within
from nonsac.seeds import canonical_seed
from nonsac.sources.contract import Source

_CLEAR = 0.99
_MOST_REPETITIONS, _SAME_NOISE, _SAMPLES_FOR_NOISE = 3, 1.25, 3
_MOST_SAMPLES = 10**6
_NO_BOUND = 2**62
_ENOUGH_FOR_SPECIAL_CASES = 8


def estimate(
    source: Source,
    problem: Problem,
    estimator: Estimator,
    *,
    noise: float | None = None,
    samples: int | Auto = "auto",
    sample_size: int | Auto = "auto",
    max_samples: int = 100,
    time_limit: float | None = None,
    max_memory: int | str | None = None,
    rule: str | ScoringRule = "tlp_0.1",
    refine: str | Refiner = "union",
    stop: Stop | None = None,
    workers: Workers = None,
    rng: int | np.random.Generator | None = 0,
    progress: Callable[[int, int], object] | None = None,
) -> Result:
    """Estimate a model from any amount of dirty data.

    Draws non-minimal samples, runs the core estimator on each, selects one hypothesis by the scoring rule, refines it
    and says how far to trust it. Memory is set by the samples, not by the source.

    Parameters
    ----------
    source : Source
        The rows, one correspondence each.
    problem : Problem
        The mathematics, for instance `Registration()`.
    estimator : Estimator
        Finds a model in one sample, for instance `Pcr99.for_pairs()`.
    noise : float, optional
        Standard deviation of an inlier, in the unit of the residual; the inlier threshold is 5 `noise`. Where it is
        left out it is measured, at two to three times the work, and with many outliers an answer is less easily
        trusted. A given one that is off by a factor of three is remarked on in `info`.
    samples : "auto" or int
        The paper's m. "auto" draws two samples, then as many again, and so on, until the answer is clear (a confidence
        of 0.99), `max_samples` are drawn, or ten times as many rows as there are. Samples do not overlap until fewer
        rows than a sample needs are left; then all rows are drawn anew.
    sample_size : "auto" or int
        The paper's N. "auto" takes 2,000 rows, and more in later rounds where the inliers seen so far are so few that
        such a sample holds less than 20 of them (the paper's N >= I_min / P_min), at most 16,000. Where all rows fit
        into one sample, one is drawn, and searched with the budget of all `samples`, or of ten.
    max_samples : int
        Where samples="auto" gives up.
    time_limit : float, optional
        Seconds after which no further sample, or pass over all rows, is begun; one that has begun is finished. Where
        that left samples undrawn and no answer is supported, the status is `TIME_LIMIT`. The same input may then give
        another answer.
    max_memory : int or str, optional
        Bytes, or words such as "500 MB", that the estimate may take beside what this process holds: bounds how many
        rows are sampled (with "auto"), and the rows of the last fit. Without it 100 samples of 2,000 rows take 60 MB.
    rule : str or ScoringRule
        How the hypothesis is selected: a name (see `nonsac.scoring`) or a rule object. It decides the answer with
        refine="none"; refiners that compare all hypotheses anew, as "union" does, overrule it.
    refine : "union", "polish", "full", "none" or Refiner
        "union" searches once more where the samples' findings meet, rescores all hypotheses on all sampled rows and
        refits the best; "polish" then fits it to at least 100,000 rows, or all; "full" fits a trusted answer to all
        rows, in some passes over the source in constant memory; "none" returns the selected one.
    stop : callable, optional
        Called as `stop(hypotheses, problem)` after each sample; ends the sampling where it says so.
    workers : None, int, concurrent.futures.Executor, Dask client or str
        One thread for each core, this many threads, a pool, or a cluster: a client, "dask" for the one that there is,
        or a scheduler's address (tcp://host:8786). The answer is the same, bit for bit, even where workers die.
    rng : int, numpy Generator or None
        The seed; None takes fresh entropy, which is recorded in `info["seed"]`.
    progress : callable, optional
        Called as `progress(done, samples)`, where `samples` are the most that there may be.

    Returns
    -------
    Result

    Raises
    ------
    ValueError
        Where an argument is out of its range; the message names it. Bad data do not raise: they end in a status.
    """
    _check_objects(source, problem, estimator)
    _check_numbers(source, problem, noise, samples, sample_size, max_samples, time_limit)
    selector = scoring.by_name(rule) if isinstance(rule, str) or not _is_object(rule, ScoringRule) else rule
    refiner = refiners.by_name(refine) if isinstance(refine, str) or not _is_object(refine, Refiner) else refine
    if getattr(refiner, "all_rows", False) and not hasattr(problem, "normal_equations"):
        raise ValueError(f'refine="full" needs a problem with normal_equations, {type(problem).__name__} has none')
    room = _NO_BOUND if max_memory is None else rows_within(bytes_of(max_memory), source)
    most, size, planned = planned_work(source, problem, estimator, selector, samples, sample_size, max_samples, room)
    seed, deadline = canonical_seed(rng), None if time_limit is None else time.perf_counter() + time_limit
    task = SampleTask(kept(source, seed, room), problem, planned, float("nan"), size, seed)
    search = Search(task, most, workers, stop, progress, deadline, room)
    method = Method(search, selector, refiner, samples == "auto", sample_size == "auto")
    if len(source) < problem.minimal_size:
        info = method.described(Stopwatch(), ())
        return failed(
            Status.TOO_FEW, float("nan") if noise is None else noise, info, evidence=Evidence(source, problem)
        )
    result = method.run(float(noise)) if noise is not None else _run_with_measured_noise(method, estimator)
    if getattr(refiner, "all_rows", False):
        bound = None if max_memory is None else bytes_of(max_memory)
        result = fitted_to_all(result, workers, search.is_late, bound)
    return replace(result, info=result.info | {"peak_memory": peak_memory()})


@dataclass(frozen=True)
class Method:
    """The parts that were chosen, and the method itself."""

    search: Search
    selector: ScoringRule
    refiner: Refiner
    automatic_samples: bool
    automatic_size: bool

    def run(self, noise: float) -> Result:
        """Sample, estimate in each sample, select, refine and judge; again with more samples until that is clear."""
        search, clock = self.search.begun(threshold_of(noise)), Stopwatch()
        while True:
            search.draw(next_round(len(search.hypotheses)) if self.automatic_samples else search.most)
            clock.lap("hypotheses")
            winner, scores = scoring.select(self.selector, search.hypotheses, search.task.problem)
            clock.lap("selection")
            refinement = _refined(search, self.refiner, winner)
            clock.lap("refinement")
            if search.ended or _is_settled(refinement, len(search.hypotheses)):
                break
            if self.automatic_size:
                search.task = replace(search.task, sample_size=next_size(refinement, len(search.task.source)))
        hypotheses = scoring.scored(search.hypotheses, scores)
        info = self.described(clock, hypotheses) | {
            "sample_size": min(search.task.sample_size, len(search.task.source))
        }
        return _result(search, refinement, hypotheses, noise, info)

    def described(self, clock: Stopwatch, hypotheses: tuple[Hypothesis, ...]) -> dict[str, Any]:
        """What another run needs to give the same answer, and what this one took."""
        return {
            "seed": self.search.task.seed,
            "version": VERSION,
            "rule": self.selector.name,
            "samples": len(hypotheses),
            "sample_size": self.search.task.sample_size,
            "dropped_rows": sum(h.dropped for h in hypotheses),
            "remarks": (),
            "seconds": clock.laps,
        }


def _run_with_measured_noise(method: Method, estimator: Estimator) -> Result:
    """The method at a noise level guessed on the first sample, and again where its answer shows another one."""
    task = method.search.task
    rng = np.random.default_rng([task.seed, 0, 2])
    rows = task.union(min(_SAMPLES_FOR_NOISE, method.search.most))  # more than one, as some may not be finite
    noise = guessed_noise(task.problem, estimator, rows[rng.permutation(len(rows))[: task.sample_size]], rng)
    if hasattr(method.refiner, "with_unknown_noise"):  # a model that is right in part looks right at its own noise
        method = replace(method, refiner=method.refiner.with_unknown_noise())
    least = 0.1 * noise
    for _ in range(_MOST_REPETITIONS):
        result = method.run(noise)
        measured = max(result.info.get("measured_noise", float("nan")), least)
        if not np.isfinite(measured) or max(measured / noise, noise / measured) < _SAME_NOISE:
            break
        hopeless = result.status is Status.LOW_SUPPORT and not result.info["remarks"]
        if hopeless or method.search.is_late():
            break
        noise = measured
    remarks = tuple(remark for remark in result.info["remarks"] if not remark.startswith("noise"))
    return replace(result, info=result.info | {"remarks": remarks})


def _refined(search: Search, refiner: Refiner, winner: int) -> Refinement | None:
    """What the refiner makes of the hypotheses, and of one more from a joint search; None where there is none."""
    task, hypotheses = search.task, search.hypotheses
    if not hypotheses[winner].found:
        return None
    joint = []
    if getattr(refiner, "joint", False) and hasattr(task.estimator, "search_jointly"):
        rng = np.random.default_rng([task.seed, task.number, 1])
        joint = [task.estimator.search_jointly(task.problem, hypotheses, search.union(), task.threshold, rng)]
    return refiner.refine(task.problem, [*hypotheses, *joint], winner, search.union, task.threshold)


def _is_settled(refinement: Refinement | None, samples: int) -> bool:
    """Whether more samples would not change the verdict."""
    if refinement is None:
        return False
    if refinement.status is Status.OK:
        return refinement.confidence >= _CLEAR
    return refinement.status is not Status.LOW_SUPPORT and samples >= _ENOUGH_FOR_SPECIAL_CASES


def _result(
    search: Search,
    refinement: Refinement | None,
    hypotheses: tuple[Hypothesis, ...],
    noise: float,
    info: dict[str, Any],
) -> Result:
    task = search.task
    evidence = Evidence(task.source, task.problem)
    if refinement is None:
        status = Status.TIME_LIMIT if search.late else _reason(task.problem, search.union(), task.threshold)
        return failed(status, noise, info, hypotheses, evidence)
    late = search.late and refinement.status is Status.LOW_SUPPORT
    info |= {"remarks": refinement.remarks}
    if refinement.measured_noise is not None:
        info |= {"measured_noise": refinement.measured_noise}
    return Result(
        T=homogeneous(refinement.model),
        status=Status.TIME_LIMIT if late else refinement.status,
        confidence=refinement.confidence,
        num_inliers=refinement.num_inliers,
        num_rows=refinement.num_rows,
        noise=noise if refinement.noise is None else refinement.noise,
        threshold=task.threshold if refinement.threshold is None else refinement.threshold,
        hypotheses=hypotheses,
        alternatives=refinement.alternatives,
        covariance=refinement.covariance,
        info=info,
        evidence=evidence,
    )


def _is_object(value: object, kind: type) -> bool:
    """Whether a value fulfils a contract, and is not merely the class of one that does."""
    return isinstance(value, kind) and not isinstance(value, type)


def _reason(problem: Problem, rows: Array, threshold: float) -> Status:
    """Why no sample gave a model."""
    if len(rows) < problem.minimal_size:
        return Status.TOO_FEW
    nothing = np.full((3, 4), np.nan)
    return Status.LOW_SUPPORT if problem.determined(nothing, rows, threshold) else Status.DEGENERATE


def _check_objects(source: Source, problem: Problem, estimator: Estimator) -> None:
    for name, value, kind in (
        ("source", source, Source),
        ("problem", problem, Problem),
        ("estimator", estimator, Estimator),
    ):
        if not _is_object(value, kind):
            raise TypeError(f"{name} must be an object of the kind {kind.__module__}.{kind.__name__}, got {value!r}")
    if source.width != problem.width:
        raise ValueError(f"source has rows of {source.width} columns, {type(problem).__name__} needs {problem.width}")


def _check_numbers(
    source: Source,
    problem: Problem,
    noise: float | None,
    samples: int | Auto,
    sample_size: int | Auto,
    max_samples: int,
    time_limit: float | None,
) -> None:
    if noise is not None and not _is_positive(noise):
        raise ValueError(
            f"noise must be a positive number, the standard deviation of an inlier, or None, got {noise!r}"
        )
    if time_limit is not None and not _is_positive(time_limit):
        raise ValueError(f"time_limit must be None or a positive number of seconds, got {time_limit!r}")
    counts: tuple[tuple[str, Any, int], ...] = (
        ("samples", samples, 1),
        ("sample_size", sample_size, problem.minimal_size),
        ("max_samples", max_samples, 1),
    )
    for name, value, least in counts:
        if isinstance(value, str) and value == "auto" and name != "max_samples":
            continue
        if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
            automatic = "" if name == "max_samples" else '"auto" or '
            raise ValueError(f"{name} must be {automatic}an integer of at least {least}, got {value!r}")
        if int(value) > _MOST_SAMPLES and name != "sample_size":
            raise ValueError(f"{name} must be at most {_MOST_SAMPLES:,}, got {value!r}")


def _is_positive(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and 0.0 < float(value) < np.inf
