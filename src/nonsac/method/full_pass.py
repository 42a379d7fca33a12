"""Passes over all rows in constant memory: the last fit of an answer."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from nonsac.layouts import Array, Rows, hashed
from nonsac.method.mixture import Mixture
from nonsac.method.refine import Refinement
from nonsac.method.residuals import Residuals, measured_noise
from nonsac.method.sampling import union_rows
from nonsac.method.search import Search
from nonsac.method.union_refit import UnionRefit
from nonsac.problems.contract import Problem, rows_of
from nonsac.problems.normal_equations import LikelyInliers, NormalEquations, Streaming, weighted
from nonsac.result import Remark, Status
from nonsac.running.executors import Workers, are_elsewhere, cores, ordered_map, parsed
from nonsac.running.memory import bytes_of_block
from nonsac.sources.contract import Source
from nonsac.sources.some_blocks import whole
from nonsac.values.quiet import quiet

_CHUNK = 8192  # rows whose columns, residuals and weights stay in the second-level cache
_PIECE = 2**20
_SAMPLED = 30_000
_MOST_PASSES = 6
_SETTLED = 3e-5  # standard errors
_OFTEN = 1e-3  # share of the sampled rows


@dataclass(frozen=True)
class FullFit(UnionRefit):
    """`UnionRefit`, then a fit of a trusted answer to all rows, by Newton's method on the likelihood of a `Mixture`.

    Each step is one pass over the source, in which every worker sums the normal equations of its pieces; from an
    answer fitted to thousands of rows it takes two or three. The noise and the share of inliers are those of some
    sampled rows. Neither the pieces nor the order in which their sums are added depend on the workers. If the time
    limit is reached before a pass has ended the fit, or the rows do not allow one, the answer stays, and a remark says
    so.
    """

    def check(self, problem: Problem) -> None:
        if problem.streaming is None:
            raise ValueError(f'refine="full" needs a problem with `streaming`, {type(problem).__name__} has none')

    def finish(self, search: Search, refinement: Refinement) -> Refinement:
        if refinement.status not in (Status.OK, Status.AMBIGUOUS):
            return refinement
        task = first_pass(search, refinement.model)
        if task is None:
            return _not_fitted(refinement, "the inliers fit exactly")
        workers = _at_work(task.source, search.workers, search.max_memory)
        for number in range(_MOST_PASSES):
            if search.is_late():
                return _not_fitted(refinement, "the time limit was reached")
            sums = reduce(add, ordered_map(task, len(task.bounds) - 1, workers))
            step = sums.equations.step()
            if not np.isfinite(step).all():
                return _not_fitted(refinement, "they do not determine a step")
            errors = np.sqrt(max(float(step @ sums.equations.hessian @ step), 0.0)) / task.weigher.noise
            if errors < _SETTLED or number == _MOST_PASSES - 1:
                break
            task = replace(task, model=task.streaming.moved(task.model, step, task.pivot))
        covariance, uncertainty = refinement.covariance, refinement.uncertainty
        if covariance is not None:
            share = refinement.num_inliers / max(sums.inliers, 1)
            covariance = covariance * share
            uncertainty = None if uncertainty is None else uncertainty.times(share**0.5)
        return replace(
            refinement,
            model=task.model,
            num_inliers=sums.inliers,
            num_rows=sums.rows,
            covariance=covariance,
            uncertainty=uncertainty,
            info=refinement.info | {"passes": number + 1},
        )


@dataclass(frozen=True)
class Sums:
    """What a piece of the rows adds: its normal equations, its inliers, and its rows, of which some are not finite."""

    equations: NormalEquations
    inliers: int
    rows: int

    def __add__(self, other: Sums) -> Sums:
        return Sums(self.equations + other.equations, self.inliers + other.inliers, self.rows + other.rows)


@dataclass(frozen=True)
class SumTask:
    """From the number of a piece to its sums; travels to any worker, which reads the piece where it runs."""

    source: Source
    problem: Problem
    streaming: Streaming
    model: Array
    threshold: float
    weigher: LikelyInliers
    pivot: Array
    bounds: NDArray[np.int64]
    repeated: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))

    @quiet
    def __call__(self, piece: int) -> Sums:
        chunks = self.source.chunks(_CHUNK, int(self.bounds[piece]), int(self.bounds[piece + 1]))
        return reduce(add, map(self._sums, chunks))

    def _sums(self, table: Array) -> Sums:
        rows = Rows.of(table, self.problem.width)
        if rows.weights is not None:  # as in samples: one weight that is no number would spoil all sums
            rows = rows.usable()
        if len(self.repeated):
            rows = rows[~np.isin(hashed(rows.values), self.repeated)]
        weigher = weighted(self.weigher, rows.weights)
        equations, residuals = self.streaming.normal_equations(self.model, rows.values, weigher, self.pivot)
        inliers = int(np.count_nonzero(residuals < self.threshold))
        return Sums(equations, inliers, _count_finite(rows.values))


def _count_finite(rows: Array) -> int:
    """How many rows are finite; if their sum is, all are."""
    with np.errstate(invalid="ignore", over="ignore"):
        all_finite = np.isfinite(rows.sum())
    return len(rows) if all_finite else int(np.count_nonzero(np.isfinite(rows).all(axis=1)))


def _not_fitted(refinement: Refinement, reason: str) -> Refinement:
    return replace(refinement, remarks=(*refinement.remarks, Remark.NOT_FITTED_TO_ALL.detailed(reason)))


def _at_work(source: Source, workers: Workers, max_memory: int | None) -> Workers:
    """The workers, or fewer: sending rows would take longer than summing them here, and each has a block in memory."""
    pool = parsed(workers)
    if source.about.in_memory and are_elsewhere(workers):
        pool = cores()
    if max_memory is not None and isinstance(pool, int):
        pool = max(1, min(pool, max_memory // max(bytes_of_block(source), 1)))
    return pool


def first_pass(search: Search, model: Array) -> SumTask | None:
    """The first pass; None if the inliers fit exactly, so that there is nothing to gain."""
    source, problem, noise = search.task.source, search.problem, search.noise
    assert problem.streaming is not None
    drawn = source.take(union_rows(len(source), 0, search.task.seed, _SAMPLED))
    sampled = rows_of(problem, drawn)
    source = whole(source)  # workers read the file where they are
    residuals = Residuals.of(problem, model, sampled)
    sigma = min(measured_noise(residuals, noise.threshold, problem.residual_dimension), noise.sigma)
    if not sigma > 0.0:
        return None
    weigher = Mixture.seen_in(residuals, sigma, problem.residual_dimension).weigher
    pivot = problem.streaming.pivot(sampled.values)
    bounds = piece_bounds(source)
    repeated = _often_repeated(drawn[:, : problem.width]) if sampled.copies else np.empty(0, np.uint64)
    return SumTask(source, problem, problem.streaming, model, noise.threshold, weigher, pivot, bounds, repeated)


def _often_repeated(rows: Array) -> NDArray[np.uint64]:
    """Hashes of rows that come so often that their copies, which say nothing new, would move a fit."""
    different, counts = np.unique(hashed(rows), return_counts=True)
    return different[counts > max(_OFTEN * len(rows), 2.0)]


def piece_bounds(source: Source) -> NDArray[np.int64]:
    """Where pieces of about a million rows begin, and the number of rows; blocks are not cut."""
    even = np.arange(0, len(source), _PIECE, dtype=np.int64)
    starts = source.about.blocks
    if starts is not None:
        even = starts[np.searchsorted(starts, even)]
    return np.unique(np.append(even, len(source)))
