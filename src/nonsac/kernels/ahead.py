"""Kernels compiled side by side on all cores, before they are called: numba compiles one at a time in a process."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

Progress = Callable[[int, int], object]

# What each kernel that Python calls is compiled for; what takes longest comes first.
SIGNATURES = {
    "five_point.five_point_poses": "f8[:,:,::1], f8[:,:,::1]",
    "pose_fit.fit_relative_pose": "f8[:,::1], f8[::1], f8, i8, f8[::1], f8[:,::1]",
    "pose_fit.fit_absolute_pose": "f8[:,::1], f8[::1], f8, i8, f8[::1], f8[:,::1]",
    "p3p.p3p_poses": "f8[:,:,::1], f8[:,:,::1]",
    "kabsch.fit_each": "f8[:,:,::1], b1, f8, f8[:,:,::1]",
    "guaranteed_removal.bound_edges": "f8[:,::1], u8[:,::1], i8[::1], f8, i8, u2[:,::1], f8[:,::1]",
    "direction_search.best_direction": "f8[:,::1], f8[::1], f8, b1, i8, f8, i8, f8[::1]",
    "nearest_field.align_to_field": ("f8[:,:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8, f8, i4[:,:,::1], i8"),
    "oriented_pairs.consistent_pairs": "f4[:,::1], f4, f4, f4, i4[:,::1]",
    "oriented_pairs.motions_of_pairs": "f8[:,:,::1], f8, f8[:,:,::1]",
    "kabsch.fit_similarity": "f8[:,::1], f8[::1], b1, f8, f8[:,::1]",
    "max_clique.largest_clique": "u8[:,::1], i8[::1], i8, i8, i8[::1]",
    "maximal_cliques.heaviest_cliques": "u8[:,::1], u2[:,::1], i8, i8, i8[::1], i8[::1], i8[::1], i8[::1]",
    "nearest_field.score_models": "f8[:,:,::1], f4[:,::1], f8[::1], f8, u1[:,:,::1], i4[::1]",
    "consistency.count_consistent_distances": "f4[:,::1], f4, i4[::1]",
    "consistency_graph.fill_consistency_graph": "f4[:,::1], f4, u8[:,::1]",
    "direction_search.best_angle": "f8[:,::1], f8[:,::1], f8, b1, f8, i8, f8[::1]",
    "ladder.count_on_ladder": "f8[:,::1], f8, i8, i8[:,::1]",
    "planes.fit_planes": "f8[:,::1], i8[:,::1], f8[:,::1], f8[:,::1], f8[::1]",
    "nearest_field.fill_nearest": "f8[:,::1], f8[::1], f8, f8, i4[:,:,::1]",
    "consistency.ranked_triplets": "f8[:,::1], b1, b1, f8, f8, i8, i8[::1], i8[:,::1]",
    "ladder.epipolar_ladder": "f4[:,:,::1], f4[:,::1], i8, i8[:,::1]",
    "ladder.registration_ladder": "f4[:,:,::1], f4[:,::1], i8, i8[:,::1]",
    "sampson.count_epipolar_inliers": "f4[:,:,::1], f4[:,::1], i8[::1]",
    "sampson.epipolar_residuals": "f8[:,:,::1], f8[:,::1], f8[:,::1]",
    "consistency.count_consistent_ratios": "f8[:,::1], b1, f8, f8, i4[::1]",
    "registration.registration_equations": "f8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1]",
    "nearest_field.surface_distances": (
        "f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8, f8, i4[:,:,::1], f8, f8, f8[::1]"
    ),
    "facts.distant_rows": "f8[:,::1], f8[::1], i8, b1[::1]",
    "homography.homography_errors": "f8[:,:,::1], f8[:,::1], f8, f8, f8[:,::1]",
    "ladder.likelihood_ratios": "f8[::1], f8[::1], f8[::1], f8, i8, f8[::1]",
    "consistency.sum_consistent_ratios": "f8[:,::1], b1, f8, f8, f8[::1]",
    "consistency.sum_consistent_distances": "f8[:,::1], f8, f8[::1]",
    "sampson.sampson_equations": "f8[:,::1], f8[::1], f8[::1], f8[:,:,::1], f8[:,::1], f8[::1]",
    "registration.registration_matrix": "f8[::1], b1, f8[:,::1], f8[::1]",
    "ladder.reprojection_ladder": "f4[:,:,::1], f4[:,::1], f4, i8, i8[:,::1]",
    "reprojection.reprojection_equations": "f8[:,::1], f8[::1], f8[::1], f8, f8[:,::1], f8[:,::1], f8[::1]",
    "reprojection.count_reprojection_inliers": "f4[:,:,::1], f4[:,::1], f4, i8[::1]",
    "registration.count_registration_inliers": "f4[:,:,::1], f4[:,::1], f4, i8[::1]",
    "ladder.best_on_ladder": "i8[:,::1], i8, i8, f8[::1], i8, f8[::1], i8[::1]",
    "reprojection.reprojection_residuals": "f8[:,:,::1], f8[:,::1], f8[:,::1]",
    "nearest_field.nearest_distances": "f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8, f8, i4[:,:,::1], f8[::1]",
    "nearest_field.fill_cost": "f8[:,::1], f8[::1], f8, f8, i4[:,:,::1], u1[:,:,::1]",
    "permutation.permute_positions": "i8, i8, i8, i8, u8[::1], i8[::1]",
    "registration.registration_residuals": "f8[:,:,::1], f8[:,::1], f8[:,::1]",
    "nearest_field.keep_distinct": "f8[:,:,::1], f8, f8, i8[::1]",
    "sampson.essential_directions": "f8[:,::1], f8[::1], f8[:,:,::1]",
    "consistency.screened_triplets": "f8[:,::1], i8[:,::1], b1, b1, f8, f8, i8[:,::1]",
    "sampson.epipolar_geometries": "f8[:,:,::1], f8, f8, f8[:,:,::1]",
    "reprojection.reprojection_jacobian": "f8[:,::1], f8, f8[:,::1], f8[:,::1], f8[:,:,::1]",
    "sampson.sampson_jacobian": "f8[:,::1], f8[::1], f8[:,::1], f8[::1], f8[:,::1]",
    "pose_math.rotate": "f8[:,::1], f8, f8, f8",
    "pose_fit.move": "f8[:,::1], f8[::1], f8[:,::1]",
    "losses.likely_inliers": "f8[::1], f8, f8, i8, f8[::1], f8[::1]",
    "minimal_samples.distinct_rows": "f8[:,::1], i8, i8[:,::1]",
    "minimal_samples.gather_rows": "f8[:,::1], i8[:,::1], f8[:,:,::1]",
    "losses.mirror": "f8[:,::1]",
    "consistency_graph.count_common_neighbours": "u8[:,::1], u2[:,::1]",
    "consistency_graph.multiply_counts": "u2[:,::1], f4[::1], f4[::1]",
    "consistency_graph.strongest_edges": "u2[:,::1], i8[:,::1]",
    "consistency_graph.best_triangles": "u8[:,::1], u2[:,::1], i8[:,::1], i8, i8[:,::1]",
    "guaranteed_removal.rows_left": "u8[:,::1], u2[:,::1], i8, b1[::1]",
    "consistency_graph.order_rows": "u8[:,::1], i8[::1], u8[:,::1]",
    "max_clique.peel": "u8[:,::1], i8[::1], i8[::1]",
    "consistency_graph.count_edges": "u8[:,::1], i8[::1]",
    "consistency_graph.local_maxima": "f8[:,::1], i8[::1], f8, b1[::1]",
}

_MINIMAL = ("minimal_samples.distinct_rows", "minimal_samples.gather_rows")
_JUDGED = ("facts.distant_rows", "losses.likely_inliers")
NEEDED = {
    "register_clouds": (
        *(name for name in SIGNATURES if name.split(".")[0] in ("nearest_field", "oriented_pairs", "planes")),
        *("kabsch.fit_similarity", "registration.registration_residuals", "permutation.permute_positions"),
    ),
    "register_pairs": (
        *(name for name in SIGNATURES if name.split(".")[0] in ("kabsch", "registration")),
        *("consistency.count_consistent_distances", "consistency.ranked_triplets", "pose_math.rotate", *_JUDGED),
        "minimal_samples.distinct_rows",
    ),
    "relative_pose": (
        *("five_point.five_point_poses", "pose_fit.fit_relative_pose", "pose_fit.move", "pose_math.rotate"),
        *(name for name in SIGNATURES if name.split(".")[0] == "sampson"),
        *("losses.mirror", "homography.homography_errors", *_MINIMAL, *_JUDGED),
    ),
    "absolute_pose": (
        *("p3p.p3p_poses", "pose_fit.fit_absolute_pose", "pose_fit.move"),
        *(name for name in SIGNATURES if name.split(".")[0] == "reprojection"),
        *("losses.mirror", *_MINIMAL, *_JUDGED),
    ),
}
_ON_LADDER = ("ladder.best_on_ladder", "ladder.likelihood_ratios")
NEEDED_WITHOUT_NOISE = {
    "register_pairs": ("ladder.registration_ladder", *_ON_LADDER),
    "relative_pose": ("ladder.epipolar_ladder", *_ON_LADDER),
    "absolute_pose": ("ladder.reprojection_ladder", *_ON_LADDER),
}

_looked_after: set[str] = set()


def compile_for(call: str, noise: object = None) -> None:
    """Compile on all cores what a call needs, if it is not on disk; once in a process, and not in workers.

    Whatever fails here is no error: the call compiles what is still missing.
    """
    names = NEEDED[call] if noise is not None else NEEDED[call] + NEEDED_WITHOUT_NOISE.get(call, ())
    if _looked_after.issuperset(names) or multiprocessing.parent_process() is not None:
        return
    _looked_after.update(names)
    compile_side_by_side(names)


def compile_side_by_side(names: Iterable[str], progress: Progress = lambda done, total: None) -> None:
    """Compile kernels in as many processes as there are cores; each takes the next one that no other has taken."""
    wanted = set(names)
    missing = [name for name in SIGNATURES if name in wanted and not _is_there(name)]
    if not missing:
        return
    with tempfile.TemporaryDirectory(prefix="nonsac-") as claims:
        others = min(_cores(), len(missing)) - 1 if _can_help() else 0
        helpers = [_start_helper(claims, missing) for _ in range(others)]
        try:
            compile_unclaimed(Path(claims), missing, progress)
            for helper in helpers:
                helper.wait()
        finally:
            for helper in helpers:
                helper.kill()
                helper.wait()


def compile_unclaimed(claims: Path, names: Sequence[str], progress: Progress = lambda done, total: None) -> None:
    """Compile, one after the other, the kernels for which nobody has yet put a file into the folder of claims."""
    for name in names:
        try:
            (claims / name).touch(exist_ok=False)
        except FileExistsError:
            continue
        except FileNotFoundError:  # all is done, and the folder is gone
            return
        progress(sum(1 for _ in claims.iterdir()) - 1, len(names))
        entry_of(name).compile(signature_of(name))


def signature_of(name: str) -> Any:
    """The types of a kernel's arguments, as numba finds them in a call."""
    from numba.core.sigutils import normalize_signature

    return normalize_signature(f"({SIGNATURES[name]},)")[0]


def entry_of(name: str) -> Any:
    module, kernel = name.split(".")
    return getattr(import_module(f"nonsac.kernels.{module}"), kernel).entry


def _is_there(name: str) -> bool:
    """Whether a kernel is compiled, or on disk, or cannot be shared through files."""
    dispatcher = entry_of(name)
    if not hasattr(dispatcher, "overloads") or dispatcher.overloads:
        return True
    keeps = getattr(dispatcher._cache, "holds_something", None)
    return keeps is None or keeps()


def _start_helper(claims: str, names: Sequence[str]) -> subprocess.Popen[bytes]:
    package = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join([package, *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-P", "-m", "nonsac.kernels.ahead", claims, *names]
    silent = subprocess.DEVNULL
    return subprocess.Popen(
        command, env=os.environ | {"PYTHONPATH": path}, stdin=silent, stdout=silent, stderr=silent, close_fds=True
    )


def _can_help() -> bool:
    """Whether the running program is Python: not one that has it built in, of which a second copy would be started."""
    return Path(sys.executable or "").name.startswith("python")


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


if __name__ == "__main__":
    compile_unclaimed(Path(sys.argv[1]), sys.argv[2:])
