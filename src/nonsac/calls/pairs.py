"""Registration of matched 3D points."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from nonsac.calls.arguments import warn_dropped_rows
from nonsac.calls.rows import rows_of_arrays, rows_of_source
from nonsac.estimators import Pcr99
from nonsac.estimators.contract import Estimator
from nonsac.layouts import PAIRS
from nonsac.method.budget import Auto
from nonsac.method.pipeline import estimate
from nonsac.method.refine import Refiner
from nonsac.method.scoring import ScoringRule
from nonsac.problems import Registration, Weighted
from nonsac.problems.contract import Problem
from nonsac.result import Result
from nonsac.running.executors import Workers
from nonsac.sources.contract import Source

Random = int | np.random.Generator | None
Progress = Callable[[int, int], object]


def register_pairs(
    source: ArrayLike | Source,
    target: ArrayLike | None = None,
    *,
    noise: float | None = None,
    scale: float | None = 1.0,
    weights: ArrayLike | None = None,
    samples: int | Auto = "auto",
    sample_size: int | Auto = "auto",
    max_samples: int = 100,
    time_limit: float | None = None,
    max_memory: int | str | None = None,
    estimator: Estimator | None = None,
    rule: str | ScoringRule = "tlp_0.1",
    refine: str | Refiner = "polish",
    workers: Workers = None,
    rng: Random = 0,
    progress: Progress | None = None,
) -> Result:
    """Register matched 3D points: row i of `source` is hypothesised to match row i of `target`.

    Parameters
    ----------
    source, target : (n, 3) array
        Rows with NaN or infinity are dropped.

        Or `source` alone: a source of rows (see `nonsac.open_source`) with the columns x1 y1 z1 x2 y2 z2 and perhaps a
        weight, in this order; where it has columns of these names, they are picked by them.
    noise : float, optional
        Standard deviation of a right match per coordinate, in the unit of the data; measured where it is left out. Rows
        with a residual below 5 `noise` are inliers.
    scale : float or None
        The known scale between the clouds, 1 for a rigid motion; None estimates it.
    weights : (n,) array, optional
        How much each match counts, not negative, in any unit.
    samples, sample_size, max_samples, time_limit, max_memory, estimator, rule, refine, workers, rng, progress
        As in `nonsac.estimate`; the default estimator is the paper's variant of PCR-99 (Sec. 4.3), or the published
        one where the scale is free.

    Returns
    -------
    Result
        `T` maps the source into the target's frame.

    Raises
    ------
    ValueError, TypeError
        Where the arrays are not (n, 3) numbers of equal length, or another argument is out of its range.
    """
    if isinstance(source, Source):
        rows = rows_of_source(source, PAIRS, "source", target=target, weights=weights)
    else:
        arrays = {"source": source, "target": target}
        hint = ". For unmatched clouds use register_clouds."
        rows = rows_of_arrays("register_pairs", arrays, PAIRS.widths, weights, hint)
    if estimator is None:
        estimator = Pcr99() if scale is None else Pcr99.for_pairs()
    problem: Problem = Weighted(Registration(scale)) if rows.weighted else Registration(scale)
    result = estimate(
        rows.through([None, None]),
        problem,
        estimator,
        noise=noise,
        samples=samples,
        sample_size=sample_size,
        max_samples=max_samples,
        time_limit=time_limit,
        max_memory=max_memory,
        rule=rule,
        refine=refine,
        workers=workers,
        rng=rng,
        progress=progress,
    )
    warn_dropped_rows(result, "with NaN or infinite coordinates", stacklevel=2)
    return result
