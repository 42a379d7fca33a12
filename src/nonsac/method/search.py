"""Drawing samples and estimating in each: which rows, in which order, on which workers, until when."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from nonsac.estimators.contract import Estimator
from nonsac.method.sampling import sample_rows, sample_start, union_rows
from nonsac.problems.contract import Problem
from nonsac.result import Array, Hypothesis
from nonsac.running.executors import Workers, are_elsewhere, ordered_map
from nonsac.sources import ArraySource
from nonsac.sources.contract import Source


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
    threshold: float
    sample_size: int
    seed: int
    start: int = 0
    number: int = 0

    def __call__(self, sample: int) -> Hypothesis:
        return self.estimated(sample, *self.rows(sample))

    def estimated(self, sample: int, rows: Array, dropped: int) -> Hypothesis:
        """The hypothesis of a sample whose rows are at hand."""
        number = self.number + sample
        if len(rows) < self.problem.minimal_size:
            nothing = np.full((3, 4), np.nan)
            return Hypothesis(nothing, np.full(len(rows), np.inf), self.threshold, number, dropped=dropped)
        rng = np.random.default_rng([self.seed, number])
        hypothesis = self.estimator.estimate(self.problem, rows, self.threshold, rng)
        return replace(hypothesis, sample=number, dropped=dropped)

    def rows(self, sample: int) -> tuple[Array, int]:
        """The finite rows of a sample, and how many others were dropped."""
        indices = sample_rows(len(self.source), self.position(sample), self.sample_size, self.seed)
        drawn = self.source.take(indices)
        finite = np.isfinite(drawn).all(axis=1)
        return self._counting(drawn[finite]), len(drawn) - int(np.count_nonzero(finite))

    def read_ahead(self, samples: int) -> None:
        """Read the rows of the next samples in one go, where the source keeps what it reads."""
        if samples and hasattr(self.source, "hold"):
            positions = (self.position(sample) for sample in range(samples))
            rows = [sample_rows(len(self.source), position, self.sample_size, self.seed) for position in positions]
            self.source.hold(np.concatenate(rows))

    def position(self, sample: int) -> int:
        """Where in the passes over the source a sample begins."""
        return sample_start(len(self.source), self.start, sample, self.sample_size)

    def after(self, samples: int) -> SampleTask:
        """The task that goes on after so many samples of this one."""
        start = self.position(samples - 1) + self.sample_size
        return replace(self, start=start, number=self.number + samples)

    def union(self, samples: int, at_least: int = 0) -> Array:
        """The finite rows that all samples hold together up to `samples` of this task, each once, and further ones."""
        end = self.position(samples - 1) + self.sample_size if samples else self.start
        rows = self.source.take(union_rows(len(self.source), end, self.seed, at_least))
        return self._counting(rows[np.isfinite(rows).all(axis=1)])

    def _counting(self, rows: Array) -> Array:
        """The rows that have a weight, if there are weights."""
        return rows[self.problem.row_weights(rows) > 0.0] if hasattr(self.problem, "row_weights") else rows


@dataclass(frozen=True)
class TravellingTask:
    """A task for workers that could not read its source: each is sent the rows of its sample, and nothing else."""

    task: SampleTask

    def __call__(self, sample: int) -> Hypothesis:
        return self.task(sample)

    def packed(self, sample: int) -> Callable[[int], Hypothesis]:
        """What a worker needs for one sample."""
        nothing = ArraySource(np.empty((0, self.task.source.width)))
        return SampleWithRows(replace(self.task, source=nothing), *self.task.rows(sample))


@dataclass(frozen=True)
class SampleWithRows:
    """A sample whose rows have been read."""

    task: SampleTask
    rows: Array
    dropped: int

    def __call__(self, sample: int) -> Hypothesis:
        return self.task.estimated(sample, self.rows, self.dropped)


@dataclass
class Search:
    """The samples drawn so far, and what ends the drawing: `room` bounds the rows of all samples."""

    task: SampleTask
    most: int
    workers: Workers
    stop: Stop | None
    progress: Callable[[int, int], object] | None
    deadline: float | None
    room: int = 2**62
    hypotheses: list[Hypothesis] = field(default_factory=list)
    stopped: bool = False
    late: bool = False

    def begun(self, threshold: float) -> Search:
        """The same search, with a threshold and nothing drawn yet."""
        return replace(self, task=replace(self.task, threshold=threshold), hypotheses=[], _union=None)

    def draw(self, count: int) -> None:
        """Estimate in so many further samples, or fewer."""
        count = min(count, self._left())
        before = len(self.hypotheses)
        self.task.read_ahead(count)
        for hypothesis in ordered_map(self._travelling(), count, self.workers):
            self.hypotheses.append(hypothesis)
            if self.progress is not None:
                self.progress(len(self.hypotheses), self.most)
            self.stopped = self.stop is not None and self.stop(self.hypotheses, self.task.problem)
            self.late = self.is_late() and self._left() > 0
            if self.stopped or self.late:
                break
        self.task = self.task.after(len(self.hypotheses) - before)

    def _travelling(self) -> Callable[[int], Hypothesis]:
        """The task, or, where workers could not read the rows, one that is sent them."""
        if getattr(self.task.source, "in_memory", False) and are_elsewhere(self.workers):
            return TravellingTask(self.task)
        return self.task

    def is_late(self) -> bool:
        """Whether the time is over."""
        return self.deadline is not None and time.perf_counter() > self.deadline

    @property
    def ended(self) -> bool:
        return self.stopped or self.late or self._left() <= 0

    def _left(self) -> int:
        """How many samples may still be drawn."""
        size = min(self.task.sample_size, len(self.task.source))
        return min(self.most - len(self.hypotheses), (self.room - self.task.start) // size)

    def union(self, at_least: int = 0) -> Array:
        """The finite rows of all samples, each once, and further ones up to a number; read when first asked for."""
        at_least = min(at_least, self.room)
        key = (self.task.start, at_least)
        if self._union is None or self._union[0] != key:
            self._union = key, self.task.union(0, at_least)
        return self._union[1]

    _union: tuple[tuple[int, int], Array] | None = field(default=None, repr=False)
