"""What the verdict says of wrong matches that have structure: further kinds of data for verdict.py.

    python benchmarks/verdict.py --structured [--data FOLDER] [--seeds 300] [--workers 2] [--journal FILE]

Simulated data of nonsac.simulate, in images with a focal length of 1,000 pixels, and real data, each file of which is
tried once. Every set is tried with the noise given and with it left out. An answer is right if the rotation is within
10 degrees and, for two views, the direction of the translation within 20 (10 for narrow fields of view); where there is
no truth, none is. The CPU time of each call is taken in a process that has made one of the same kind before.
"""

from __future__ import annotations

import sys
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import journal
import numpy as np
from common import RESULTS, commit, median, write
from verdict_page import CELLS

import nonsac
from nonsac import simulate
from nonsac.evaluation import rotation_error
from nonsac.layouts import Array
from nonsac.result import Result

JSON = RESULTS / "verdict_structured.json"
RIGHT_ROTATION, RIGHT_DIRECTION, RIGHT_NARROW_DIRECTION = 10.0, 20.0, 10.0  # degrees
FOCAL = 1000.0
CAMERA = nonsac.Camera("PINHOLE", (FOCAL, FOCAL, 0.0, 0.0))


@dataclass(frozen=True)
class Case:
    """A call that lacks the noise, the noise that it may be given, and the truth."""

    call: Callable[..., Result]
    noise: float
    truth: Array


@dataclass(frozen=True)
class Kind:
    """A line of the table. `make` takes a generator, or the path of a file where the data are real."""

    name: str
    problem: str
    make: Callable[[Any], Case]
    direction: float = np.inf  # within which that of the translation is right, in degrees
    narrow: bool = False
    files: str = ""  # pattern

    def paths(self, data: Path) -> list[Path]:
        """The files of real data."""
        return sorted(data.glob(self.files))

    def case(self, data: Path, seed: int) -> Case:
        """One set of the data."""
        if self.files:
            return self.make(self.paths(data)[seed])
        return self.make(np.random.default_rng([seed, zlib.crc32(self.name.encode())]))


@dataclass(frozen=True)
class Task:
    """One trial; the outcome depends on these alone, and on the data."""

    kind: str
    given: bool  # the noise
    seed: int

    @property
    def group(self) -> str:
        """Of tasks that use the same code."""
        return KINDS[self.kind].problem


@dataclass(frozen=True)
class Outcome:
    """What came of a trial; angles in degrees, None where there is none. A bound is what 95 % of errors are below."""

    kind: str
    given: bool
    seed: int
    status: str
    confidence: float
    right: bool
    rotation: float | None
    direction: float | None
    rotation_bound: float | None
    direction_bound: float | None
    cpu_ms: float

    @property
    def trusted(self) -> bool:
        """Whether the result claims success."""
        return self.status == nonsac.Status.OK

    @property
    def cell(self) -> str:
        """Of the table."""
        return f"{'trusted' if self.trusted else 'untrusted'}_{'right' if self.right else 'wrong'}"


_REHEARSED: set[tuple[str, bool]] = set()  # by this process


@dataclass(frozen=True)
class Study:
    """From a task's number to its outcome; travels to any process."""

    tasks: tuple[Task, ...]
    data: Path

    def __call__(self, number: int) -> Outcome:
        task = self.tasks[number]
        kind = KINDS[task.kind]
        case = kind.case(self.data, task.seed)
        estimate = partial(case.call, noise=case.noise if task.given else None, workers=1, rng=task.seed)
        if (task.kind, task.given) not in _REHEARSED:
            estimate()  # kernels are loaded when they are first used
            _REHEARSED.add((task.kind, task.given))
        start = time.process_time()
        result = estimate()
        return outcome(task, kind, case.truth, result, 1000.0 * (time.process_time() - start))


def outcome(task: Task, kind: Kind, truth: Array, result: Result, cpu_ms: float) -> Outcome:
    """How far off an answer is, and what is said of it."""
    rotation = float(rotation_error(result.T[:3, :3], truth[:3, :3]))
    direction = angle(result.T[:3, 3], truth[:3, 3]) if np.isfinite(kind.direction) else 0.0
    uncertainty = result.uncertainty
    return Outcome(
        **asdict(task),
        status=str(result.status),
        confidence=result.confidence,
        right=rotation < RIGHT_ROTATION and direction < kind.direction,
        rotation=rounded(rotation),
        direction=rounded(direction) if np.isfinite(kind.direction) else None,
        rotation_bound=None if uncertainty is None else rounded(uncertainty.rotation),
        direction_bound=None if uncertainty is None else rounded(uncertainty.translation),
        cpu_ms=round(cpu_ms, 2),
    )


def angle(first: Array, second: Array) -> float:
    """Between two directions, in degrees; NaN if one is no direction."""
    lengths = np.linalg.norm(first) * np.linalg.norm(second)
    return float(np.degrees(np.arccos(np.clip(first @ second / lengths, -1.0, 1.0)))) if lengths else float("nan")


def rounded(value: float) -> float | None:
    """For JSON, which has no NaN and no infinity."""
    return round(float(value), 4) if np.isfinite(value) else None


# --- simulated data ----------------------------------------------------


def two_views(name: str, noise: float, matches: Callable[..., Any], *sizes: float, **options: Any) -> Kind:
    """Of `matches(*sizes, rng=..., **options)`; the noise is in normalised coordinates."""

    def make(rng: np.random.Generator) -> Case:
        drawn = matches(*sizes, rng=rng, **options)
        call = partial(nonsac.relative_pose, FOCAL * drawn.points1, FOCAL * drawn.points2, CAMERA)
        return Case(call, FOCAL * noise, drawn.T)

    return Kind(f"two images: {name}", "relative-pose", make, RIGHT_DIRECTION)


def one_view(name: str, noise: float, matches: Callable[..., Any], *sizes: float) -> Kind:
    """The same for points of the world."""

    def make(rng: np.random.Generator) -> Case:
        drawn = matches(*sizes, rng=rng)
        call = partial(nonsac.absolute_pose, FOCAL * drawn.points2d, drawn.points3d, CAMERA)
        return Case(call, FOCAL * noise, drawn.T)

    return Kind(f"image and 3D points: {name}", "absolute-pose", make)


def pairs(name: str, noise: float, matches: Callable[..., Any], *sizes: float, **options: Any) -> Kind:
    """The same for pairs of 3D points; the noise is in their unit."""

    def make(rng: np.random.Generator) -> Case:
        drawn = matches(*sizes, rng=rng, **options)
        return Case(partial(nonsac.register_pairs, drawn.source, drawn.target), noise, drawn.T)

    return Kind(f"3D pairs: {name}", "registration", make)


def narrow_view(matches: int, degrees: int) -> Kind:
    """30 % wrong, noise of 0.15 % of half the width."""

    def make(rng: np.random.Generator) -> Case:
        drawn = simulate.narrow_view(matches, 0.3, 0.0015, rng, degrees=degrees)
        call = partial(nonsac.relative_pose, FOCAL * drawn.points1, FOCAL * drawn.points2, CAMERA)
        return Case(call, FOCAL * 0.0015 * np.tan(np.radians(0.5 * degrees)), drawn.T)

    name = f"two images: {degrees} degrees of view, {matches} matches"
    return Kind(name, "relative-pose", make, RIGHT_NARROW_DIRECTION, narrow=True)


SIMULATED = (
    two_views("8 blobs, 1,500 matches", 0.0003, simulate.blobs_in_images, 1500, 8, 0.0003),
    two_views("30 blobs, 1,500 matches", 0.001, simulate.blobs_in_images, 1500, 30, 0.001),
    pairs("8 blobs, 1,000 pairs", 0.01, simulate.blobs_in_space, 1000, 8, 0.01),
    pairs("20 blobs, 1,000 pairs", 0.03, simulate.blobs_in_space, 1000, 20, 0.03),
    pairs("statue, 50 % on its base, 85 % of the others wrong", 0.01, simulate.statue, 600, 0.85, 0.01, base=0.5),
    pairs("statue, 70 % on its base, 93 % of the others wrong", 0.01, simulate.statue, 600, 0.93, 0.01, base=0.7),
    two_views("periodic wall, 80 % slipped by one period", 0.0005, simulate.periodic_texture, 600, 0.8, 0.0005),
    two_views("periodic wall, 80 % slipped, each by its own number of periods", 0.0005, simulate.periodic_texture,
              600, 0.8, 0.0005, scattered=True),
    two_views("camera that turns, 70 % displaced by up to 20 pixels", 0.0005, simulate.local_displacements,
              600, 0.7, 0.02, 0.0005),
    two_views("camera that turns, all displaced by up to 10 pixels", 0.0003, simulate.local_displacements,
              600, 1.0, 0.01, 0.0003),
    two_views("30 % on a moving object, 30 % wrong", 0.001, simulate.moving_object, 800, 0.3, 0.3, 0.001),
    one_view("two planes, 50 % wrong", 0.002, simulate.two_planes, 200, 0.5, 0.002),
    *(narrow_view(matches, degrees) for degrees in (5, 10, 15) for matches in (20, 50, 200)),
    two_views("200 honest matches, 80 % wrong", 0.001, simulate.relative_pose, 200, 0.8, 0.001),
    two_views("1,000 honest matches, 90 % wrong", 0.001, simulate.relative_pose, 1000, 0.9, 0.001),
    two_views("10,000 honest matches, 90 % wrong", 0.0025, simulate.relative_pose, 10000, 0.9, 0.0025),
    one_view("100 honest matches, 90 % wrong", 0.002, simulate.absolute_pose, 100, 0.9, 0.002),
    one_view("10,000 honest matches, 97 % wrong", 0.01, simulate.absolute_pose, 10000, 0.97, 0.01),
    pairs("2,000 honest pairs, 99 % wrong", 0.01, simulate.registration, 2000, 0.99, 0.01),
    pairs("20,000 honest pairs, 99.5 % wrong", 0.01, simulate.registration, 20000, 0.995, 0.01),
)  # fmt: skip


# --- real data ---------------------------------------------------------


def real_pairs(name: str, folder: str, mutual: bool) -> Kind:
    """3D points; `tau` bounds the inliers, so it is the threshold."""

    def make(path: Path) -> Case:
        with np.load(path) as file:
            kept = file["mutual"] if mutual else slice(None)
            source, target = (file[key][kept].astype(np.float64) for key in ("src", "tgt"))
            call = partial(nonsac.register_pairs, source, target)
            return Case(call, float(file["tau"]) / 5.0, file["T_tgt_src"])

    said = f"real 3D pairs: {name}, {'mutual' if mutual else 'all'} matches"
    return Kind(said, "registration", make, files=f"{folder}/*.npz")


def real_two_views(name: str, files: str, noise: float, ratio: float, direction: float) -> Kind:
    """Matches whose descriptors' ratio is below a bound; the noise is in pixels."""

    def make(path: Path) -> Case:
        with np.load(path) as file:
            kept = file["ratio"] < ratio
            first, second = (file[key][kept].astype(np.float64) for key in ("x1", "x2"))
            return Case(partial(nonsac.relative_pose, first, second, file["K1"], file["K2"]), noise, motion(file))

    return Kind(f"real two images: {name}", "relative-pose", make, direction, files=files)


def real_one_view(name: str, files: str, noise: float) -> Kind:
    """The same for points of the world."""

    def make(path: Path) -> Case:
        with np.load(path) as file:
            points, seen = file["X"], file["x"].astype(np.float64)
            return Case(partial(nonsac.absolute_pose, seen, points, file["K"]), noise, motion(file))

    return Kind(f"real image and 3D points: {name}", "absolute-pose", make, files=files)


def motion(file: Any) -> Array:
    """R and t as a matrix."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = file["R"], file["t"]
    return T


REAL = (
    *(real_pairs("scans", "corr3d_fpfh", mutual) for mutual in (False, True)),
    *(real_pairs("statues", "corr3d_statues", mutual) for mutual in (False, True)),
    *(real_two_views(f"narrow view, ratio below {ratio:g}", "narrow_view/rel_*.npz", 0.5, ratio, RIGHT_NARROW_DIRECTION)
      for ratio in (0.7, 0.8, 0.9, 0.96)),
    *(real_two_views(f"buildings, noise of {noise:g} px", "strecha/rel_*.npz", noise, np.inf, RIGHT_DIRECTION)
      for noise in (0.5, 1.0)),
    *(real_one_view(f"buildings, noise of {noise:g} px", "strecha/pnp_*.npz", noise) for noise in (0.5, 1.0)),
)  # fmt: skip

KINDS = {kind.name: kind for kind in (*SIMULATED, *REAL)}


# --- running -----------------------------------------------------------


def measure(data: Path, seeds: int, workers: int, kept: Path | None) -> None:
    """Run all tasks and write the JSON."""
    if missing := {kind.files for kind in REAL if not kind.paths(data)}:
        sys.exit(f"no {', '.join(sorted(missing))} in {data.name}; give their folder (--data), or set NONSAC_DATA")
    study = Study(all_tasks(data, seeds), data)
    settings = {"seeds": seeds, "trials": {name: len(trials(data, seeds, name)) for name in KINDS}}
    settings |= {"right_rotation": RIGHT_ROTATION, "right_direction": RIGHT_DIRECTION}
    settings |= {"right_narrow_direction": RIGHT_NARROW_DIRECTION, "commit": commit()}
    outcomes = journal.run(study, Outcome, workers, kept, settings)
    rows = [row(KINDS[name], [each for each in outcomes if each.kind == name]) for name in KINDS]
    write(JSON, "verdict_structured", commit=settings.pop("commit"), settings=settings, results=rows)


def all_tasks(data: Path, seeds: int) -> tuple[Task, ...]:
    """What is run, in the order of the table."""
    return tuple(
        Task(name, given, seed) for name in KINDS for given in (True, False) for seed in trials(data, seeds, name)
    )


def trials(data: Path, seeds: int, name: str) -> range:
    """Of a kind: the seeds, or the numbers of the files."""
    return range(len(KINDS[name].paths(data)) if KINDS[name].files else seeds)


def row(kind: Kind, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """A line of the table, of both halves."""
    halves = [[each for each in outcomes if each.given == given] for given in (True, False)]
    given, left_out = (half(kind, each) for each in halves)
    return {"kind": kind.name, "narrow": kind.narrow, "trials": len(halves[0]), "noise_given": given,
            "noise_left_out": left_out, "cpu_ratio": left_out["cpu_ms"] / given["cpu_ms"]}  # fmt: skip


def half(kind: Kind, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Answers with the noise given, or without."""
    statuses = [each.status for each in outcomes]
    counts = {cell: sum(each.cell == cell for each in outcomes) for cell in CELLS}
    told = {"statuses": {status: statuses.count(status) for status in sorted(set(statuses))}}
    if kind.narrow:
        told |= {"bounds": bounds(outcomes), "bounds_of_trusted": bounds([each for each in outcomes if each.trusted])}
    return counts | {"cpu_ms": median([each.cpu_ms for each in outcomes])} | told


def bounds(outcomes: Sequence[Outcome]) -> dict[str, int]:
    """How many answers state an uncertainty, and how many of their errors are within it."""
    stated = [each for each in outcomes if None not in (each.rotation_bound, each.direction_bound)]
    return {
        "answers": len(stated),
        "rotation_within": sum(each.rotation <= each.rotation_bound for each in stated),
        "direction_within": sum(each.direction <= each.direction_bound for each in stated),
    }
