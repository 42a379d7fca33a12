"""Drawing samples and estimating in each: which rows, in which order, on which workers, until when."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.contract import Estimator, checked_hypothesis
from nonsac.layouts import Array, Rows
from nonsac.method.sampling import sample_rows, sample_start, union_rows
from nonsac.problems.contract import ContractBroken, Problem, blame, rows_of
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis
from nonsac.running.executors import Workers, are_elsewhere, ordered_map
from nonsac.sources import ArraySource
from nonsac.sources.contract import Source
from nonsac.values.quiet import quiet

_TOGETHER = 4  # samples that may travel to workers elsewhere at once: a tenth of a second's work


class Stop(Protocol):
    """Says after each sample whether the hypotheses so far are enough."""

    def __call__(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> bool: ...


@dataclass(frozen=True)
class SampleTask:
    """One sample from its number to its hypothesis; travels to any worker.

    Its rows are those after `start` in the passes over the source, and `number` samples were drawn before.
    """

    source: Source
    problem: Problem
    estimator: Estimator
    noise: Noise
    sample_size: int
    seed: int
    start: int = 0
    number: int = 0

    def __call__(self, sample: int) -> Hypothesis:
        return self.estimated(sample, *self.rows(sample))

    @quiet
    def estimated(self, sample: int, rows: Rows, dropped: int) -> Hypothesis:
        """The hypothesis of a sample whose rows are at hand."""
        number, problem = self.number + sample, self.problem
        nothing = Hypothesis(problem.no_model, np.full(len(rows), np.inf), self.noise.threshold, number, tested=0)
        if len(rows) < problem.minimal_size:
            return replace(nothing, dropped=dropped)
        rng = np.random.default_rng([self.seed, number])
        try:
            hypothesis = self.estimator.estimate(problem, rows, self.noise, rng)
        except ContractBroken:
            raise
        except Exception as error:  # of somebody's estimator: it costs this sample, and the result says so
            blame(problem, rows, self.noise.threshold, error)
            return replace(nothing, dropped=dropped, fault=f"{type(error).__name__}: {error}")
        return replace(checked_hypothesis(hypothesis, problem, self.estimator), sample=number, dropped=dropped)

    @quiet
    def rows(self, sample: int) -> tuple[Rows, int]:
        """The usable rows of a sample, and how many were dropped because they are not finite."""
        indices = sample_rows(len(self.source), self.position(sample), self.sample_size, self.seed)
        drawn = taken(self.source, indices)
        finite = np.isfinite(drawn).all(axis=1)
        return rows_of(self.problem, drawn[finite]), len(drawn) - int(np.count_nonzero(finite))

    def read_ahead(self, samples: int) -> None:
        """Read the rows of the next samples in one go, if the source keeps what it reads."""
        if samples and self.source.about.keeps_rows:
            positions = (self.position(sample) for sample in range(samples))
            rows = [sample_rows(len(self.source), position, self.sample_size, self.seed) for position in positions]
            self.source.hold(np.concatenate(rows))

    def packed(self, sample: int) -> Callable[[int], Hypothesis]:
        """The sample with its rows, for workers that could not read the source."""
        nothing = ArraySource(np.empty((0, self.source.width)))
        return SampleWithRows(replace(self, source=nothing), *self.rows(sample))

    def position(self, sample: int) -> int:
        """Where in the passes over the source a sample begins."""
        return sample_start(len(self.source), self.start, sample, self.sample_size)

    def after(self, samples: int) -> SampleTask:
        """The task that goes on after so many samples of this one."""
        start = self.position(samples - 1) + self.sample_size
        return replace(self, start=start, number=self.number + samples)

    def union(self, samples: int, at_least: int = 0) -> Rows:
        """The usable rows that all samples hold together up to `samples` of this task, each once, and further ones."""
        end = self.position(samples - 1) + self.sample_size if samples else self.start
        return rows_of(self.problem, taken(self.source, union_rows(len(self.source), end, self.seed, at_least)))


def taken(source: Source, indices: NDArray[np.int64]) -> Array:
    """`Source.take`, if it gave what the contract says."""
    rows = source.take(indices)
    if not isinstance(rows, np.ndarray) or rows.dtype != np.float64 or rows.shape != (len(indices), source.width):
        kind = f"{rows.dtype} {rows.shape}" if isinstance(rows, np.ndarray) else type(rows).__name__
        raise ContractBroken(
            f"{type(source).__name__}.take gave {kind} for {len(indices)} rows of {source.width} columns: return a "
            "float64 array (len(indices), width), as a source must"
        )
    return rows


@dataclass(frozen=True)
class SampleWithRows:
    """A sample whose rows have been read."""

    task: SampleTask
    rows: Rows
    dropped: int

    def __call__(self, sample: int) -> Hypothesis:
        return self.task.estimated(sample, self.rows, self.dropped)


@dataclass
class Search:
    """The samples drawn so far, and what ends the drawing: `max_rows` bounds the rows of all samples."""

    task: SampleTask
    most: int
    workers: Workers
    stop: Stop | None
    progress: Callable[[int, int], object] | None
    deadline: float | None
    max_rows: int = 2**62
    max_memory: int | None = None
    hypotheses: list[Hypothesis] = field(default_factory=list)
    stopped: bool = False
    late: bool = False

    def begun(self, noise: Noise, found: Sequence[Hypothesis] = ()) -> Search:
        """The same search, with a noise and nothing drawn yet but the first samples, in which this was found."""
        begun = replace(self, task=replace(self.task, noise=noise), hypotheses=[], _union=None)
        for hypothesis in found:
            begun._take(hypothesis)
        begun.task = begun.task.after(len(found)) if found else begun.task
        return begun

    def at(self, noise: Noise) -> Search:
        """The same search, whose findings are judged at another noise."""
        return replace(self, task=replace(self.task, noise=noise), hypotheses=list(self.hypotheses))

    def draw(self, count: int) -> None:
        """Estimate in so many further samples, or fewer."""
        count = min(count, self._left())
        if count <= 0:
            return
        before = len(self.hypotheses)
        self.task.read_ahead(count)
        elsewhere = are_elsewhere(self.workers)
        pack = self.task.packed if elsewhere and self.task.source.about.in_memory else None
        may_end = self.stop is not None or self.deadline is not None
        together = _TOGETHER if elsewhere and not may_end else 1
        for hypothesis in ordered_map(self.task, count, self.workers, pack, together):
            self._take(hypothesis)
            if self.stopped or self.late:
                break
        self.task = self.task.after(len(self.hypotheses) - before)

    def _take(self, hypothesis: Hypothesis) -> None:
        self.hypotheses.append(hypothesis)
        if self.progress is not None:
            self.progress(len(self.hypotheses), self.most)
        self.stopped = self.stop is not None and self.stop(self.hypotheses, self.task.problem)
        self.late = self.is_late() and self._left() > 0

    def is_late(self) -> bool:
        """Whether the time limit was reached."""
        return self.deadline is not None and time.perf_counter() > self.deadline

    @property
    def ended(self) -> bool:
        return self.stopped or self.late or self._left() <= 0

    def _left(self) -> int:
        """How many samples may still be drawn."""
        size = min(self.task.sample_size, len(self.task.source))
        return min(self.most - len(self.hypotheses), (self.max_rows - self.task.start) // size)

    @property
    def problem(self) -> Problem:
        return self.task.problem

    @property
    def noise(self) -> Noise:
        return self.task.noise

    def union(self, at_least: int = 0) -> Rows:
        """The usable rows of all samples, each once, and further ones up to a number; read when first asked for."""
        wanted = max(self.task.start, min(at_least, self.max_rows))
        if self._union is None or self._union[0] != wanted:
            self._union = wanted, self.task.union(0, wanted)
        return self._union[1]

    _union: tuple[int, Rows] | None = field(default=None, repr=False)
