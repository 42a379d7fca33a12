"""The calls that most users need: choose the parts, run the pipeline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from nonsac.arguments import points_argument, warn_dropped, warn_dropped_rows
from nonsac.clouds import Agreement, CommonFrame, SurfaceRefiner, coarse_overlap
from nonsac.correspondences import PAIRS, rows_of_arrays, rows_of_source
from nonsac.estimators import Estimator, OrientedPairs, Pcr99
from nonsac.executors import Workers
from nonsac.pipeline import Auto, Stopwatch, estimate
from nonsac.problems import OrientedRegistration, Problem, Registration, Weighted
from nonsac.refine import Refiner
from nonsac.result import VERSION, Array, Result, Status, failed
from nonsac.sampling import canonical_seed
from nonsac.scoring import ScoringRule, TruncatedLp
from nonsac.sources import AllPairsSource, Source
from nonsac.surfaces import Surface

Random = int | np.random.Generator | None
Progress = Callable[[int, int], object]


def register_clouds(
    source: ArrayLike,
    target: ArrayLike,
    *,
    samples: int = 40,
    sample_size: int = 2000,
    workers: Workers = None,
    rng: Random = 0,
    progress: Progress | None = None,
) -> Result:
    """Register two raw point clouds: no matches, no descriptors, no initial guess.

    Both clouds are thinned, every source point is hypothesised to match every target point, and NONSAC samples of
    these pairs give motions, which are ranked by how well they make the clouds overlap. The best distinct answers
    are compared on the dense surfaces, and the winner is aligned finely on the full clouds.

    Parameters
    ----------
    source, target : (n, 3) and (k, 3) array
        Points in one unit; the clouds need to overlap in part only. Rows with NaN or infinity are dropped.
    samples, sample_size : int
        At most this many samples of this many hypothesised pairs; fewer where several samples agree early.
    workers : None, int or concurrent.futures.Executor
        One thread for each core, this many threads, or an executor. The answer is the same, bit for bit.
    rng : int, numpy Generator or None
    progress : callable, optional
        Called as `progress(done, samples)`.

    Returns
    -------
    Result
        `T` maps the source into the target's frame. `num_inliers` of `num_rows` thinned points of both clouds lie in
        the other's surface. `status` is `AMBIGUOUS` where a clearly different answer does nearly as well (see
        `alternatives`), `LOW_SUPPORT` where too little of the clouds coincides.

    Raises
    ------
    ValueError, TypeError
        Where an array is not (n, 3) numbers; the message names it.
    """
    clock = Stopwatch()
    seed = canonical_seed(rng)
    a, dropped_source = _finite_cloud(source, "source")
    b, dropped_target = _finite_cloud(target, "target")
    info = {
        "seed": seed,
        "version": VERSION,
        "dropped_source": dropped_source,
        "dropped_target": dropped_target,
    }
    if min(len(a), len(b)) < 3:
        return failed(Status.TOO_FEW, float("nan"), info)
    frame = CommonFrame.of(a, b)
    full_source, full_target = frame.normalised(a, frame.source_origin), frame.normalised(b, frame.target_origin)
    info |= {"stray_source": len(a) - len(full_source), "stray_target": len(b) - len(full_target)}
    reason = _unusable(full_source) or _unusable(full_target)
    if reason is not None:
        return failed(reason, float("nan"), info)
    overlap = coarse_overlap(Surface.from_points(full_source), Surface.from_points(full_target))
    clock.lap("preparation")

    estimator = OrientedPairs.for_overlap(overlap)
    search = partial(
        estimate,
        AllPairsSource(overlap.source.oriented, overlap.target.oriented),
        OrientedRegistration(),
        noise=overlap.reach / 5.0,
        samples=samples,
        sample_size=sample_size,
        rule=TruncatedLp(1.0),
        refine=SurfaceRefiner(overlap, full_source, full_target),
        workers=workers,
        rng=seed,
        progress=progress,
    )
    result = search(estimator, stop=Agreement(overlap.reach))
    seconds = clock.laps | result.info["seconds"]
    if not result.success:  # harder than it looked: all samples, and twice the candidates in each
        result = search(estimator.with_budget(2))
        seconds |= {stage: seconds[stage] + again for stage, again in result.info["seconds"].items()}
    return frame.restore(replace(result, info=result.info | info | {"seconds": seconds}))


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


def _finite_cloud(points: ArrayLike, name: str) -> tuple[Array, int]:
    """The finite points as float64, and how many were dropped."""
    array = points_argument(points, name, 3)
    finite = np.isfinite(array).all(axis=1)
    dropped = int(len(array) - finite.sum())
    warn_dropped(dropped, len(array), f"{name} points", stacklevel=4)
    return np.array(array[finite] if dropped else array, np.float64, order="C"), dropped


def _unusable(points: Array) -> Status | None:
    """Why these points cannot be registered, if they cannot."""
    if len(points) < 3:
        return Status.TOO_FEW
    centred = points - points.mean(axis=0)
    spread = np.linalg.svd(centred.T @ centred / len(points), compute_uv=False)
    if not spread[0] > 0:
        return Status.DEGENERATE
    return Status.DEGENERATE if spread[1] < 1e-8 * spread[0] else None
