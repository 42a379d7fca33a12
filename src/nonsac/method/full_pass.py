"""Passes over all rows in constant memory: the last fit of an answer, and which rows are its inliers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.method.mixture import Mixture
from nonsac.method.noise import measured_noise
from nonsac.method.sampling import union_rows
from nonsac.method.verdict import Residuals
from nonsac.problems.contract import residual_dimension
from nonsac.problems.normal_equations import LikelyInliers, NormalEquations
from nonsac.result import Array, Result, Status, homogeneous
from nonsac.running.executors import Workers, are_elsewhere, cores, ordered_map, parsed
from nonsac.running.memory import bytes_of_block
from nonsac.sources import HeldSource
from nonsac.sources.contract import Source

_CHUNK = 8192  # rows whose columns, residuals and weights stay in the second-level cache
_PIECE = 2**20
_SAMPLED = 30_000
_MOST_PASSES = 6
_SETTLED = 3e-5  # standard errors


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
    problem: Any
    model: Array
    threshold: float
    weigher: LikelyInliers
    pivot: Array
    bounds: NDArray[np.int64]

    def __call__(self, piece: int) -> Sums:
        chunks = self.source.chunks(_CHUNK, int(self.bounds[piece]), int(self.bounds[piece + 1]))
        return reduce(add, map(self._sums, chunks))

    def _sums(self, rows: Array) -> Sums:
        if hasattr(self.problem, "row_weights"):  # as in samples: one weight that is no number would spoil all sums
            rows = rows[np.isfinite(rows).all(axis=1)]
            rows = rows[self.problem.row_weights(rows) > 0.0]
        equations, residuals = self.problem.normal_equations(self.model, rows, self.weigher, self.pivot)
        inliers = int(np.count_nonzero(residuals < self.threshold))
        return Sums(equations, inliers, _count_finite(rows))


def _count_finite(rows: Array) -> int:
    """How many rows are finite; where their sum is, all are."""
    with np.errstate(invalid="ignore", over="ignore"):
        all_finite = np.isfinite(rows.sum())
    return len(rows) if all_finite else int(np.count_nonzero(np.isfinite(rows).all(axis=1)))


def fitted_to_all(
    result: Result, workers: Workers, is_late: Callable[[], bool] = lambda: False, max_memory: int | None = None
) -> Result:
    """A trusted answer fitted to all rows of its source, by Newton's method on the likelihood of a `Mixture`.

    Each step is one pass over the source, in which every worker sums the normal equations of its pieces; from an
    answer fitted to thousands of rows it takes two or three. The noise and the share of inliers are those of some
    sampled rows. Neither the pieces nor the order in which their sums are added depend on the workers. Where it is
    late before a pass has ended the fit, or the rows do not allow one, the answer stays, and a remark says so.
    """
    if result.status not in (Status.OK, Status.AMBIGUOUS):
        return result
    begun, task = time.perf_counter(), first_pass(result)
    if task is None:
        return _not_fitted(result, "they have no noise")
    workers = _at_work(task.source, workers, max_memory)
    for number in range(_MOST_PASSES):
        if is_late():
            return _not_fitted(result, "the time was over")
        sums = reduce(add, ordered_map(task, len(task.bounds) - 1, workers))
        step = sums.equations.step()
        if not np.isfinite(step).all():
            return _not_fitted(result, "they do not determine a step")
        errors = np.sqrt(max(float(step @ sums.equations.hessian @ step), 0.0)) / task.weigher.noise
        if errors < _SETTLED or number == _MOST_PASSES - 1:
            break
        task = replace(task, model=task.problem.moved(task.model, step, task.pivot))
    covariance = result.covariance
    if covariance is not None:
        covariance = covariance * (result.num_inliers / max(sums.inliers, 1))
    seconds = result.info["seconds"] | {"all rows": time.perf_counter() - begun}
    return replace(
        result,
        T=homogeneous(task.model),
        num_inliers=sums.inliers,
        num_rows=sums.rows,
        covariance=covariance,
        info=result.info | {"seconds": seconds, "passes": number + 1},
    )


def _not_fitted(result: Result, reason: str) -> Result:
    remarks = (*result.info.get("remarks", ()), f"not fitted to all rows: {reason}")
    return replace(result, info=result.info | {"remarks": remarks})


def _at_work(source: Source, workers: Workers, max_memory: int | None) -> Workers:
    """The workers, or fewer: sending rows would take longer than summing them here, and each has a block in memory."""
    pool = parsed(workers)
    if getattr(source, "in_memory", False) and are_elsewhere(workers):
        pool = cores()
    if max_memory is not None and isinstance(pool, int):
        pool = max(1, min(pool, max_memory // max(bytes_of_block(source), 1)))
    return pool


def first_pass(result: Result) -> SumTask | None:
    """The first pass; None where the rows have no noise, so that there is nothing to gain."""
    assert result.evidence is not None
    source, problem, model = result.evidence.source, result.evidence.problem, result.T[:3]
    sampled = source.take(union_rows(len(source), 0, result.info["seed"], _SAMPLED))
    if isinstance(source, HeldSource):  # workers read the file where they are
        source = source.source
    sampled = sampled[np.isfinite(sampled).all(axis=1)]
    residuals = Residuals.of(problem, model, sampled)
    noise = min(measured_noise(residuals, result.threshold, residual_dimension(problem)), result.threshold / 5.0)
    if not noise > 0.0:
        return None
    weigher = Mixture.seen_in(residuals, noise, residual_dimension(problem)).weigher
    return SumTask(source, problem, model, result.threshold, weigher, problem.pivot(sampled), piece_bounds(source))


def piece_bounds(source: Source) -> NDArray[np.int64]:
    """Where pieces of about a million rows begin, and the number of rows; blocks are not cut."""
    even = np.arange(0, len(source), _PIECE, dtype=np.int64)
    starts = getattr(source, "block_starts", None)
    if starts is not None:
        even = starts[np.searchsorted(starts, even)]
    return np.unique(np.append(even, len(source)))
