"""How many samples of how many rows, within the bounds that were set."""

from __future__ import annotations

from typing import Literal

from nonsac.estimators.contract import Estimator
from nonsac.method.refine import Refinement
from nonsac.method.sampling import union_rows
from nonsac.method.scoring import ScoringRule
from nonsac.problems.contract import Problem
from nonsac.running.memory import bytes_for
from nonsac.sources import HeldSource
from nonsac.sources.contract import Source

Auto = Literal["auto"]

_FIRST_ROUND = 2
_FIRST_SIZE, _LARGEST_SIZE = 2000, 16_000
_LEAST_INLIERS = 20  # in a sample: I_min of the paper's rule N >= I_min / P_min
_ALL_ROWS_BUDGET = 10
_MOST_PASSES = 10
_READ_AT_ONCE = 100_000  # rows: those of the last fit, and of the first fifty samples


def planned_work(
    source: Source,
    problem: Problem,
    estimator: Estimator,
    rule: ScoringRule,
    samples: int | Auto,
    sample_size: int | Auto,
    max_samples: int,
    room: int,
) -> tuple[int, int, Estimator]:
    """The most samples, the rows of the first ones, and the estimator with its budget, within so many rows."""
    automatic = samples == "auto"
    most, planned = _plan(rule, max_samples if samples == "auto" else samples, automatic, estimator)
    size = min(_FIRST_SIZE, room // _FIRST_ROUND) if sample_size == "auto" else sample_size
    if size >= len(source) and most > 1:  # every sample would be all rows: one, with the budget of all
        planned = planned.with_budget(min(most, _ALL_ROWS_BUDGET) if automatic else most)
        most = 1
    elif automatic:
        most = min(most, max(_FIRST_ROUND, _MOST_PASSES * len(source) // max(size, 1)))
    needed = min(size, len(source)) * (min(most, _FIRST_ROUND) if automatic else most)
    if needed > room or size < problem.minimal_size:
        needed = max(needed, _FIRST_ROUND * problem.minimal_size)
        raise ValueError(
            f"max_memory is too little for {needed} sampled rows and what reading them takes: at least "
            f"{bytes_for(needed, source) / 1e6:.0f} MB; give more, fewer samples, or a file with smaller row groups"
        )
    return most, size, planned


def kept(source: Source, seed: int, room: int) -> Source:
    """The source; one of blocks with the rows that will be asked for first, from one reading of the blocks."""
    if not hasattr(source, "block_starts"):
        return source
    held = HeldSource(source)
    held.take(union_rows(len(source), 0, seed, min(_READ_AT_ONCE, room)))
    return held


def _plan(rule: ScoringRule, most: int, automatic: bool, estimator: Estimator) -> tuple[int, Estimator]:
    """A rule may spend the budget in its own way, as `FixedSample` does."""
    if not hasattr(rule, "plan"):
        return most, estimator
    if automatic:
        raise ValueError(f"samples must be a number with the rule {rule.name}, which spends them in its own way")
    return rule.plan(most, estimator)


def next_round(drawn: int) -> int:
    """As many samples as there were before."""
    return max(_FIRST_ROUND, drawn)


def next_size(refinement: Refinement | None, rows: int) -> int:
    """Rows that hold enough inliers, if they are as frequent as in the best answer so far; half of all at most."""
    share = 0.0 if refinement is None else refinement.num_inliers / max(refinement.num_rows, 1)
    needed = _LEAST_INLIERS / max(share, _LEAST_INLIERS / _LARGEST_SIZE)
    return max(_FIRST_SIZE, min(int(needed), rows // 2))
