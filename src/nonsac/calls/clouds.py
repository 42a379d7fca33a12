"""Registration of two raw clouds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from nonsac.calls.arguments import points_argument, warn_dropped
from nonsac.clouds.frame import CommonFrame
from nonsac.clouds.problem import OrientedRegistration
from nonsac.clouds.refine import SurfaceRefiner, coarse_overlap
from nonsac.clouds.search import Agreement, OrientedPairs
from nonsac.clouds.surfaces import Surface
from nonsac.kernels.ahead import compile_for
from nonsac.layouts import Array
from nonsac.method.pipeline import run
from nonsac.method.scoring import TruncatedLp
from nonsac.method.settings import Progress, Settings
from nonsac.problems.noise import Noise
from nonsac.result import Evidence, Result, Status, failed
from nonsac.running.clock import Stopwatch
from nonsac.running.executors import Workers
from nonsac.seeds import canonical_seed
from nonsac.sources import AllPairsSource
from nonsac.values.quiet import quiet
from nonsac.values.version import VERSION


def register_clouds(
    source: ArrayLike,
    target: ArrayLike,
    *,
    samples: int = 40,
    sample_size: int = 2000,
    workers: Workers = None,
    rng: int | np.random.Generator | None = 0,
    progress: Progress | None = None,
) -> Result:
    """Register two raw point clouds: no matches, no descriptors, no initial guess.

    Both clouds are thinned, every source point is hypothesised to match every target point, and NONSAC samples of
    these pairs give motions, which are ranked by how well they make the clouds overlap. The best distinct answers
    are compared on the dense surfaces, and the winner is aligned finely on the full clouds.

    Parameters
    ----------
    source, target : (n, 3) and (k, 3) array
        Points in one unit; the clouds need to overlap in part only. Rows with NaN or infinity are dropped. Organised
        clouds (h, w, 3), tensors, DataFrames with columns x, y and z, and clouds and meshes of Open3D, laspy, trimesh
        and such are taken as well.
    samples, sample_size : int
        At most this many samples of this many hypothesised pairs; fewer if several samples agree early.
    workers : None, int or concurrent.futures.Executor
        One thread for each core, this many threads, or an executor. The answer is the same, bit for bit.
    rng : int, numpy Generator or None
        The seed; None takes fresh entropy, which is recorded in `info["seed"]`.
    progress : callable, optional
        Called as `progress(done, samples)`.

    Returns
    -------
    Result
        `T` maps the source into the target's frame. `num_inliers` of `num_rows` thinned points of both clouds lie in
        the other's surface. `status` is `AMBIGUOUS` if a clearly different answer does nearly as well (see
        `alternatives`), `LOW_SUPPORT` if too little of the clouds coincides; then `info["remarks"]` says if they are of
        very different sizes, as in different units.

    Raises
    ------
    ValueError, TypeError
        If an array is not (n, 3) numbers; the message names it.
    """
    problem = OrientedRegistration()
    given = {"samples": samples, "sample_size": sample_size, "workers": workers, "rng": rng, "progress": progress}
    settings = replace(Settings.of("register_clouds", given).fitting(problem), rng=canonical_seed(rng))
    a, dropped_source = _finite_cloud(source, "source")
    b, dropped_target = _finite_cloud(target, "target")
    info = {
        "seed": settings.rng,
        "version": VERSION,
        "dropped_source": dropped_source,
        "dropped_target": dropped_target,
    }
    if min(len(a), len(b)) < 3:
        return failed(Status.TOO_FEW, Evidence(problem), info)
    compile_for("register_clouds")
    return _registered(a, b, problem, settings, info)


@quiet
def _registered(a: Array, b: Array, problem: OrientedRegistration, settings: Settings, info: dict[str, Any]) -> Result:
    """The registration of clouds of finite points."""
    clock = Stopwatch()
    frame = CommonFrame.of(a, b)
    full_source, full_target = frame.normalised(a, frame.source_origin), frame.normalised(b, frame.target_origin)
    info |= {"stray_source": len(a) - len(full_source), "stray_target": len(b) - len(full_target)}
    reason = _unusable(full_source) or _unusable(full_target)
    if reason is not None:
        return failed(reason, Evidence(problem), info)
    overlap = coarse_overlap(Surface.from_points(full_source), Surface.from_points(full_target))
    clock.lap("preparation")

    estimator = OrientedPairs.for_overlap(overlap)
    pairs = AllPairsSource(overlap.source.oriented, overlap.target.oriented)
    settings = replace(
        settings,
        noise=Noise.within(overlap.reach).sigma,
        rule=TruncatedLp(1.0),
        refine=SurfaceRefiner(overlap, full_source, full_target),
    )
    result = run(pairs, problem, estimator, settings, Agreement(overlap.reach))
    seconds = clock.laps | result.info["seconds"]
    if not result.success:  # harder than it looked: all samples, and twice the candidates in each
        result = run(pairs, problem, estimator.with_budget(2), settings)
        seconds |= {stage: seconds[stage] + again for stage, again in result.info["seconds"].items()}
    result = replace(result, info=result.info | info | {"seconds": seconds})
    return frame.restore(result if result.success else _with_remarks(result, frame.remarks()))


def _with_remarks(result: Result, remarks: tuple[str, ...]) -> Result:
    """An answer to clouds that are sound, but seem to be in different units."""
    if not remarks:
        return result
    status = Status.LOW_SUPPORT if result.status is Status.DEGENERATE else result.status
    return replace(result, status=status, info=result.info | {"remarks": (*result.remarks, *remarks)})


def _finite_cloud(points: ArrayLike, name: str) -> tuple[Array, int]:
    """The finite points as float64, and how many were dropped."""
    array = points_argument(points, name, 3, organised=True)
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
