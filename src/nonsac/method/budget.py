"""How many samples of how many rows, within the bounds that were set."""

from __future__ import annotations

from dataclasses import dataclass

from nonsac.estimators.contract import Estimator
from nonsac.method.block_draw import drawn_blocks
from nonsac.method.refine import Refinement
from nonsac.method.sampling import union_rows
from nonsac.method.settings import Settings
from nonsac.problems.contract import Problem
from nonsac.running.memory import bytes_for, rows_within
from nonsac.sources import HeldSource
from nonsac.sources.contract import Source

_FIRST_ROUND = 2
_FIRST_SIZE, LARGEST_SIZE = 2000, 16_000
_LEAST_INLIERS = 20  # in a sample: I_min of the paper's rule N >= I_min / P_min
_ALL_ROWS_BUDGET = 10
_MOST_PASSES = 10
_READ_AT_ONCE = 100_000  # rows: those of the last fit, and of the first fifty samples
_NO_BOUND = 2**62


@dataclass(frozen=True)
class Budget:
    """What is to be drawn.

    Attributes
    ----------
    samples : int
        The most samples.
    sample_size : int
        Rows of the first ones.
    estimator : Estimator
        With the budget for one sample.
    max_rows : int
        Rows that all samples may hold together.
    """

    samples: int
    sample_size: int
    estimator: Estimator
    max_rows: int

    @classmethod
    def of(cls, source: Source, problem: Problem, estimator: Estimator, settings: Settings) -> Budget:
        """The budget that the settings allow for this source."""
        max_rows = _NO_BOUND if settings.max_memory is None else rows_within(settings.max_memory, source)
        automatic = settings.samples == "auto"
        most, planned = settings.rule.plan(None if settings.samples == "auto" else settings.samples, estimator)
        most = settings.max_samples if most is None else most
        size = min(_FIRST_SIZE, max_rows // _FIRST_ROUND) if settings.sample_size == "auto" else settings.sample_size
        if size >= len(source) and most > 1:  # every sample would be all rows: one, with the budget of all
            planned = planned.with_budget(min(most, _ALL_ROWS_BUDGET) if automatic else most)
            most = 1
        elif automatic:
            most = min(most, max(_FIRST_ROUND, _MOST_PASSES * len(source) // max(size, 1)))
        needed = min(size, len(source)) * (min(most, _FIRST_ROUND) if automatic else most)
        if needed > max_rows or size < problem.minimal_size:
            raise _too_little_memory(max(needed, _FIRST_ROUND * problem.minimal_size), source)
        return cls(most, size, planned, max_rows)


def _too_little_memory(rows: int, source: Source) -> ValueError:
    return ValueError(
        f"max_memory is too little for {rows} sampled rows and what reading them takes: at least "
        f"{bytes_for(rows, source) / 1e6:.0f} MB; give more, fewer samples, or a file with smaller row groups"
    )


def chosen_blocks(source: Source, budget: Budget, settings: Settings, seed: int) -> Source:
    """The source, or the rows of some of its blocks that hold what all samples may ask for."""
    if settings.draw == "rows":
        return source
    size = LARGEST_SIZE if settings.sample_size == "auto" else settings.sample_size
    return drawn_blocks(source, min(max(budget.samples * size, _READ_AT_ONCE), budget.max_rows), seed)


def kept(source: Source, seed: int, max_rows: int) -> Source:
    """The source; one of blocks with the rows that will be asked for first, from one reading of the blocks."""
    if source.about.blocks is None:
        return source
    held = HeldSource(source)
    held.take(union_rows(len(source), 0, seed, min(_READ_AT_ONCE, max_rows)))
    return held


def first_round(found: int) -> int:
    """Two samples to begin with, less those in which something was found; each further round is as many as before."""
    return max(_FIRST_ROUND - found, 0)


def next_size(refinement: Refinement | None, rows: int) -> int:
    """Rows that hold enough inliers, if they are as frequent as in the best answer so far; half of all at most."""
    share = 0.0 if refinement is None else refinement.num_inliers / max(refinement.num_rows, 1)
    needed = _LEAST_INLIERS / max(share, _LEAST_INLIERS / LARGEST_SIZE)
    return max(_FIRST_SIZE, min(int(needed), rows // 2))
