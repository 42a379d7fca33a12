"""What some forty calls answer, to the last bit: run before and after a change that should not touch any answer.

    python benchmarks/golden.py write before.json
    python benchmarks/golden.py compare before.json

Bits depend on the processor and on the versions of NumPy and numba, so the file is not committed.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import nonsac

DATA = Path(os.environ.get("NONSAC_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
Call = Callable[[], nonsac.Result]


def cases(folder: Path) -> Iterator[tuple[str, Call]]:
    yield from _pairs(folder)
    yield from _relative(folder)
    yield from _absolute(folder)
    yield from _pipeline()
    yield from _clouds()
    yield from _many(folder)
    if DATA.is_dir():
        yield from _real()


def _pairs(folder: Path) -> Iterator[tuple[str, Call]]:
    data = nonsac.simulate.registration(20_000, 0.98, 0.01, 0)
    both, rows = (data.source, data.target), np.hstack([data.source, data.target])
    weights = np.random.default_rng(0).uniform(0.1, 2.0, len(rows))
    few = (data.source[:900], data.target[:900])
    holes = data.source.copy()
    holes[::7] = np.nan
    np.save(folder / "pairs.npy", rows)
    named = nonsac.simulate.registration(500, 0.5, 0.01, 5)
    text = np.hstack([named.source, named.target])
    np.savetxt(folder / "pairs.csv", text, delimiter=",", header="x1,y1,z1,x2,y2,z2", comments="")
    yield "pairs", lambda: nonsac.register_pairs(*both, noise=0.01)
    yield "pairs, noise unknown", lambda: nonsac.register_pairs(*both)
    yield "pairs, three workers", lambda: nonsac.register_pairs(*both, noise=0.01, workers=3, samples=7)
    yield "pairs, free scale", lambda: nonsac.register_pairs(*both, noise=0.01, scale=None)
    yield "pairs, weights", lambda: nonsac.register_pairs(*both, noise=0.01, weights=weights)
    yield "pairs, weights, full", lambda: nonsac.register_pairs(*both, noise=0.01, weights=weights, refine="full")
    yield "pairs, full", lambda: nonsac.register_pairs(*both, noise=0.01, refine="full")
    yield "pairs, one sample", lambda: nonsac.register_pairs(*few, noise=0.01)
    yield "pairs, not finite", lambda: nonsac.register_pairs(holes, data.target, noise=0.01)
    yield "pairs, .npy", lambda: nonsac.register_pairs(nonsac.open_source(folder / "pairs.npy"), noise=0.01)
    yield "pairs, text", lambda: nonsac.register_pairs(nonsac.open_source(folder / "pairs.csv"), noise=0.01)
    yield "pairs, memory", lambda: nonsac.register_pairs(*both, noise=0.01, max_memory="9 MB")
    yield "pairs, ten times the noise", lambda: nonsac.register_pairs(*both, noise=0.1)


def _relative(folder: Path) -> Iterator[tuple[str, Call]]:
    data = nonsac.simulate.relative_pose(10_000, 0.8, 0.0025, 1)
    both = (data.points1, data.points2)
    weights = np.random.default_rng(1).uniform(0.1, 2.0, 10_000)
    camera1, camera2 = "SIMPLE_RADIAL 1600 1200 1000 800 600 -0.1", (900.0, 910.0, 640.0, 480.0)
    first, second = nonsac.Camera.parse(camera1), nonsac.Camera.parse(camera2)
    pixels = (first.project(0.4 * both[0]), second.project(0.4 * both[1]))
    source = nonsac.ArraySource(np.hstack([*pixels, weights[:, None]]))
    yield "relative", lambda: nonsac.relative_pose(*both, noise=0.0025)
    yield "relative, noise unknown", lambda: nonsac.relative_pose(*both)
    yield "relative, weights", lambda: nonsac.relative_pose(*both, noise=0.0025, weights=weights)
    yield "relative, union", lambda: nonsac.relative_pose(*both, noise=0.0025, refine="union")
    yield "relative, none", lambda: nonsac.relative_pose(*both, noise=0.0025, refine="none", rule="pair_0.2")
    yield "relative, full", lambda: nonsac.relative_pose(*both, noise=0.0025, refine="full")
    yield "relative, cameras", lambda: nonsac.relative_pose(*pixels, camera1, camera2, noise=1.0)
    yield "relative, source", lambda: nonsac.relative_pose(source, None, camera1, camera2, noise=1.0, refine="full")
    yield "relative, 300 rows", lambda: nonsac.relative_pose(both[0][:300], both[1][:300], noise=0.0025)
    turned = nonsac.simulate.relative_pose(4000, 0.0, 0.0, 3)
    moved = turned.points1 @ np.eye(2) + 0.001 * np.random.default_rng(2).standard_normal((4000, 2))
    yield "relative, no baseline", lambda: nonsac.relative_pose(turned.points1, moved, noise=0.001)


def _absolute(folder: Path) -> Iterator[tuple[str, Call]]:
    data = nonsac.simulate.absolute_pose(10_000, 0.9, 0.005, 2)
    both = (data.points2d, data.points3d)
    weights = np.random.default_rng(3).uniform(0.1, 2.0, 10_000)
    flat = data.points3d * [1.0, 1.0, 0.0] + [0.0, 0.0, 4.0]
    seen = flat[:, :2] / flat[:, 2:] + 0.003 * np.random.default_rng(4).standard_normal((10_000, 2))
    yield "absolute", lambda: nonsac.absolute_pose(*both, noise=0.005)
    yield "absolute, noise unknown", lambda: nonsac.absolute_pose(*both)
    yield "absolute, weights", lambda: nonsac.absolute_pose(*both, noise=0.005, weights=weights)
    yield "absolute, full", lambda: nonsac.absolute_pose(*both, noise=0.005, refine="full")
    yield "absolute, planar", lambda: nonsac.absolute_pose(seen, flat, noise=0.003)


def _pipeline() -> Iterator[tuple[str, Call]]:
    data = nonsac.simulate.registration(5000, 0.97, 0.01, 4)
    source = nonsac.ArraySource(np.hstack([data.source, data.target]))
    two = nonsac.simulate.relative_pose(5000, 0.7, 0.0025, 4)
    matches = nonsac.ArraySource(np.hstack([two.points1, two.points2]))
    cores = {"for pairs": nonsac.Pcr99.for_pairs(), "ransac": nonsac.Ransac(500), "published": nonsac.Pcr99()}
    for name, core in cores.items():
        yield (
            f"estimate, {name}",
            lambda core=core: nonsac.estimate(
                source, nonsac.Registration(), core, noise=0.01, samples=5, sample_size=1000
            ),
        )
    for rule in ("fixed", "most_inliers", "closest_triplet", "minimum_q3", "tlp_2"):
        yield f"estimate, {rule}", lambda rule=rule: nonsac.estimate(
            matches, nonsac.RelativePose(), nonsac.Ransac(300), noise=0.0025, samples=5, sample_size=500, rule=rule,
            refine="none",
        )  # fmt: skip


def _clouds() -> Iterator[tuple[str, Call]]:
    scans = nonsac.simulate.demo_scans(0, points=3000)
    other = nonsac.simulate.demo_scans(7, points=3000)
    noise = np.random.default_rng(0).uniform(size=(2, 3000, 3))
    yield "clouds", lambda: nonsac.register_clouds(scans.source, scans.target)
    yield "clouds, one worker", lambda: nonsac.register_clouds(other.source, other.target, workers=1, rng=3)
    yield "clouds, volumes", lambda: nonsac.register_clouds(*noise, samples=3)


def _many(folder: Path) -> Iterator[tuple[str, Call]]:
    data = nonsac.simulate.registration(3000, 0.9, 0.01, 6)
    path = folder / "many.npz"
    np.savez(path, source=data.source, target=data.target)
    jobs = [nonsac.Job("register_pairs", str(path), noise=0.01, rng=seed) for seed in range(3)]
    for seed in range(3):
        yield f"job {seed}", lambda seed=seed: list(nonsac.estimate_many(jobs, workers=2))[seed][1]
    yield "processes", lambda: _on_processes(data)


def _on_processes(data: Any) -> nonsac.Result:
    with ProcessPoolExecutor(2) as pool:
        return nonsac.register_pairs(data.source, data.target, noise=0.01, workers=pool, samples=4)


def _real() -> Iterator[tuple[str, Call]]:
    for path in sorted((DATA / "strecha").glob("rel_*.npz"))[:5]:
        d = np.load(path)
        good = d["ratio"] < 0.85
        both = d["x1"][good], d["x2"][good]
        for noise in (None, 0.5):
            yield (
                f"{path.stem}, {noise}",
                lambda both=both, d=d, noise=noise: nonsac.relative_pose(*both, d["K1"], d["K2"], noise=noise),
            )
    for path in sorted((DATA / "strecha").glob("pnp_*.npz"))[:2]:
        d = np.load(path)
        yield path.stem, lambda d=d: nonsac.absolute_pose(d["x"], d["X"], d["K"])
    for path in sorted((DATA / "corr3d_fpfh").glob("*.npz"))[:3]:
        d = np.load(path)
        yield path.stem, lambda d=d: nonsac.register_pairs(d["src"], d["tgt"], noise=float(d["tau"]) / 5)


def facts(result: nonsac.Result) -> dict[str, Any]:
    """What an answer holds, as exact text."""
    covariance = result.covariance
    return {
        "status": str(result.status),
        "confidence": float(result.confidence).hex(),
        "T": _hex(result.T),
        "covariance": None if covariance is None else _hex(covariance),
        "inliers": f"{result.num_inliers} of {result.num_rows}",
        "noise": float(result.noise).hex(),
        "threshold": float(result.threshold).hex(),
        "alternatives": [_hex(other.T) for other in result.alternatives],
        "hypotheses": [[_hex(h.model), h.tested, float(h.score).hex()] for h in result.hypotheses],
        "remarks": [str(remark) for remark in result.info.get("remarks", ())],
    }


def _hex(numbers: Any) -> list[str]:
    return [float(number).hex() for number in np.asarray(numbers, np.float64).ravel()]


def answers() -> dict[str, Any]:
    found = {}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, call in cases(Path(folder)):
            found[name] = facts(call())
    return found


def differences(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """One line for each call and fact that is another one."""
    lines = [f"{name}: only {side}" for name, side in _only_in_one(before, now)]
    for name in before.keys() & now.keys():
        changed = [fact for fact in before[name] if before[name][fact] != now[name].get(fact)]
        lines += [f"{name}: {fact}: {_told(before[name][fact], now[name].get(fact))}" for fact in changed]
    return sorted(lines)


def _only_in_one(before: dict[str, Any], now: dict[str, Any]) -> list[tuple[str, str]]:
    return [(name, "before" if name in before else "now") for name in before.keys() ^ now.keys()]


def _told(before: Any, now: Any) -> str:
    """Both, or by how much the largest of their numbers differs."""
    try:
        pairs = [(float.fromhex(a), float.fromhex(b)) for a, b in zip(before, now, strict=True)]
        return f"differs by at most {max(abs(a - b) for a, b in pairs):.3g}"
    except (TypeError, ValueError):
        return f"{str(before)[:60]} -> {str(now)[:60]}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=["write", "compare"])
    parser.add_argument("file", type=Path)
    arguments = parser.parse_args()
    now = answers()
    if arguments.action == "write":
        arguments.file.write_text(json.dumps(now, indent=1))
        print(f"{len(now)} calls")
        return 0
    lines = differences(json.loads(arguments.file.read_text()), now)
    print("\n".join(lines) or f"{len(now)} calls, all bits equal")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
