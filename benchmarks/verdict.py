"""Whether the verdict is right: answers to data with a truth and without one, against what `success` says of them.

    python benchmarks/verdict.py [--data FOLDER] [--seeds 1000] [--cloud-seeds 200] [--workers 2] [--journal FILE]
    python benchmarks/verdict.py --miscalibrated [--seeds 200]
    python benchmarks/verdict.py --structured [--data FOLDER] [--seeds 300] [--workers 2] [--journal FILE]
    python benchmarks/verdict.py --page
    python benchmarks/verdict.py --check

The first writes benchmarks/results/verdict.json, then the picture and the block of docs/verdict.md that
`verdict_page.py` makes of it. The second measures cameras that are not what is said of them (see miscalibration.py),
the third wrong matches that have structure (see structured.py). --page only makes the picture and the blocks of the
first and the third anew, and --check compares these blocks with the JSON. Real data are looked for in the folder that
NONSAC_DATA names. With a journal, each outcome is kept as a line of JSON, and a run that was stopped goes on there.
"""

from __future__ import annotations

import argparse
import json
import sys
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import journal
import miscalibration
import numpy as np
import structured
import structured_page
import verdict_page
from common import RESULTS, commit, write

import nonsac
from clouds import DATA, Condition, Trial, turn_about
from nonsac.evaluation import rotation_error
from nonsac.io import read_cloud
from nonsac.layouts import Array
from nonsac.reproduce.experiments import EXPERIMENTS
from nonsac.result import Result
from nonsac.simulate import demo_scans, random_rotation

JSON = RESULTS / "verdict.json"
WRONG = 10.0  # degrees
WRONG_SHIFT = 0.1  # of a raw cloud's centroid, as a share of the target's diagonal
CLOUDS = "clouds"
# Past the paper's grid, to where no answer is right any more: its own cells are all but without wrong ones.
LIMITS = {
    "relative-pose": (0.91, 0.92, 0.93, 0.94, 0.95, 0.96),
    "absolute-pose": (0.975, 0.98, 0.985, 0.99, 0.9925, 0.995),
    "registration": (0.9955, 0.996, 0.9965, 0.997, 0.9975, 0.998),
}
CONDITIONS = (
    Condition(points=5000),
    Condition(points=5000, noise=0.01),
    Condition(points=1000),
    Condition(points=2500, clutter=1.0),
)


@dataclass(frozen=True)
class Task:
    """One trial; the outcome depends on these alone, and on the data."""

    problem: str
    kind: str
    seed: int

    @property
    def group(self) -> tuple[str, str]:
        """Of tasks that use the same code."""
        return self.problem, self.kind

    def generator(self) -> np.random.Generator:
        """The trial's own."""
        return np.random.default_rng([self.seed, zlib.crc32(f"{self.problem} {self.kind}".encode())])


@dataclass(frozen=True)
class Case:
    """What a trial is about: `estimate` runs it, `judge` gives the error in degrees and whether an answer is right."""

    name: str
    estimate: Callable[[], Result]
    judge: Callable[[Array], tuple[float, bool]]


@dataclass(frozen=True)
class Outcome:
    """What came of a trial; no degrees where there is no truth or no answer."""

    problem: str
    kind: str
    seed: int
    case: str
    status: str
    confidence: float
    right: bool
    degrees: float | None

    @property
    def trusted(self) -> bool:
        """Whether the result claims success."""
        return self.status == nonsac.Status.OK


@dataclass(frozen=True)
class Study:
    """From a task's number to its outcome; travels to any process."""

    tasks: tuple[Task, ...]
    data: Path
    samples: int

    def __call__(self, number: int) -> Outcome:
        task = self.tasks[number]
        case = KINDS[task.kind](self, task, task.generator())
        result = case.estimate()
        degrees, right = case.judge(result.T)
        error = round(degrees, 3) if np.isfinite(degrees) else None
        return Outcome(**asdict(task), case=case.name, status=str(result.status), confidence=result.confidence,
                       right=right, degrees=error)  # fmt: skip


def no_answer_is_right(T: Array) -> tuple[float, bool]:
    """The judge of data without a truth."""
    return float("nan"), False


def judge_rotation(truth: Array, T: Array) -> tuple[float, bool]:
    """The judge of simulated rows."""
    degrees = float(rotation_error(T[:3, :3], truth[:3, :3]))
    return degrees, degrees < WRONG


# --- rows --------------------------------------------------------------


def simulated(study: Study, task: Task, ratios: Sequence[float], rng: np.random.Generator) -> tuple[str, Any, Array]:
    """Name, estimate and truth of one cell; the seeds are spread over the outlier ratios and the noises."""
    experiment = EXPERIMENTS[task.problem]
    position, ratio = divmod(task.seed, len(ratios))
    noise, outlier_ratio = experiment.noises[position % len(experiment.noises)], ratios[ratio]
    rows, truth = experiment.simulate(study.samples * experiment.sample_size, outlier_ratio, noise, rng)
    estimate = partial(
        experiment.refined,
        rows,
        noise=noise,
        max_samples=study.samples,
        sample_size=experiment.sample_size,
        rng=task.seed,
    )
    return f"outliers {outlier_ratio:g}, noise {noise:g}", estimate, truth


def outliers(study: Study, task: Task, rng: np.random.Generator) -> Case:
    """No row is right."""
    name, estimate, _ = simulated(study, task, (1.0,), rng)
    return Case(name, estimate, no_answer_is_right)


def grid(study: Study, task: Task, rng: np.random.Generator) -> Case:
    """The cells of the paper's Table 2."""
    name, estimate, truth = simulated(study, task, EXPERIMENTS[task.problem].outlier_ratios, rng)
    return Case(name, estimate, partial(judge_rotation, truth))


def limit(study: Study, task: Task, rng: np.random.Generator) -> Case:
    """More outliers than in the paper's grid."""
    name, estimate, truth = simulated(study, task, LIMITS[task.problem], rng)
    return Case(name, estimate, partial(judge_rotation, truth))


def shuffled(study: Study, task: Task, rng: np.random.Generator) -> Case:
    """Real matches, paired at random."""
    folder, pattern, call = REAL_MATCHES[task.problem]
    files = sorted((study.data / folder).glob(pattern))
    path = files[task.seed % len(files)]
    settings = {"max_samples": study.samples, "sample_size": EXPERIMENTS[task.problem].sample_size}
    with np.load(path) as matches:
        estimate = partial(call, dict(matches), rng, workers=1, rng=task.seed, **settings)
    return Case(path.stem, estimate, no_answer_is_right)


def shuffled_images(matches: Mapping[str, Array], order: np.random.Generator, **settings: Any) -> Result:
    """Two views."""
    second = order.permutation(matches["x2"])
    return nonsac.relative_pose(matches["x1"], second, matches["K1"], matches["K2"], **settings)


def shuffled_points(matches: Mapping[str, Array], order: np.random.Generator, **settings: Any) -> Result:
    """One view of known points."""
    return nonsac.absolute_pose(matches["x"], order.permutation(matches["X"]), matches["K"], **settings)


def shuffled_pairs(matches: Mapping[str, Array], order: np.random.Generator, **settings: Any) -> Result:
    """3D points; `tau` bounds the inliers, so it is the threshold."""
    noise = float(matches["tau"]) / 5.0
    return nonsac.register_pairs(matches["src"], order.permutation(matches["tgt"]), noise=noise, **settings)


REAL_MATCHES: dict[str, tuple[str, str, Callable[..., Result]]] = {
    "relative-pose": ("strecha", "rel_*.npz", shuffled_images),
    "absolute-pose": ("strecha", "pnp_*.npz", shuffled_points),
    "registration": ("corr3d_fpfh", "*.npz", shuffled_pairs),
}


# --- raw clouds --------------------------------------------------------

SCENES = {
    "bunny": "bunny_scans/*.ply",
    "kitchen": "redkitchen/cloud_bin_*.ply",
    "car": "car_lidar/*.ply",
    "street": "lidar_small_gicp/*.ply",
    "lucy": "shapes/lucy_5k.npy",
    "elephant": "",
}


def ball(rng: np.random.Generator) -> Array:
    """Uniform in a ball."""
    return shell(rng) * np.cbrt(rng.random((5000, 1)))


def blob(rng: np.random.Generator) -> Array:
    """Normally distributed."""
    return rng.standard_normal((5000, 3))


def shell(rng: np.random.Generator) -> Array:
    """A noisy sphere."""
    points = rng.standard_normal((5000, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) + 0.02 * rng.standard_normal((5000, 3))


def sheet(rng: np.random.Generator) -> Array:
    """A wavy, noisy surface."""
    places, shift = rng.uniform(-1.0, 1.0, (5000, 2)), rng.uniform(0.0, 2 * np.pi, 2)
    heights = 0.2 * np.sin(4.0 * places + shift).sum(axis=1) + 0.01 * rng.standard_normal(5000)
    return np.column_stack([places, heights])


SHAPES = (ball, blob, shell, sheet)


def unrelated(study: Study, task: Task, rng: np.random.Generator) -> Case:
    """Two clouds of different scenes, or in every fourth trial one cloud and a shape without any detail."""
    first, second = rng.permutation(list(SCENES))[:2]
    source_name, source = scene_cloud(study.data, first, rng)
    if task.seed % 4 == 3:
        shape = SHAPES[task.seed // 4 % len(SHAPES)]
        target_name, target = shape.__name__, shape(rng)
    else:
        target_name, target = scene_cloud(study.data, second, rng)
    condition = CONDITIONS[rng.integers(len(CONDITIONS))]
    source = condition.apply(source / diagonal(source), 1.0, rng) @ random_rotation(rng).T
    target = condition.apply(target / diagonal(target), 1.0, rng) * 2.0 ** rng.uniform(-1.0, 1.0)
    estimate = partial(nonsac.register_clouds, source, target, workers=1, rng=task.seed)
    return Case(f"{source_name}, {target_name}", estimate, no_answer_is_right)


def scene_cloud(data: Path, scene: str, rng: np.random.Generator) -> tuple[str, Array]:
    """One of a scene's clouds."""
    if not SCENES[scene]:
        return scene, demo_scans(rng, points=5000).source
    files = sorted(data.glob(SCENES[scene]))
    path = files[rng.integers(len(files))]
    return path.stem, whole_cloud(path)


def scans(study: Study, task: Task, rng: np.random.Generator) -> Case:
    """Clouds that overlap; the seeds are spread over the pairs and over noise, few points and clutter."""
    pairs = true_pairs(study.data)
    position, number = divmod(task.seed, len(pairs))
    folder, pair = pairs[number]
    condition = CONDITIONS[position % len(CONDITIONS)]
    length = pair["target_diameter"]
    source, target = (condition.apply(whole_cloud(folder / pair[which]), length, rng) for which in ("source", "target"))
    turn = turn_about(source.mean(axis=0), random_rotation(rng))
    name = f"{folder.name} {Path(pair['source']).stem}-{Path(pair['target']).stem}, {described(condition)}"
    turned = source @ turn[:3, :3].T + turn[:3, 3]
    truth = np.array(pair["T_target_source"]) @ np.linalg.inv(turn)
    trial = Trial(name, turned, target, truth, length, WRONG, WRONG_SHIFT)
    return Case(name, partial(nonsac.register_clouds, turned, target, workers=1, rng=task.seed), trial.judge)


def described(condition: Condition) -> str:
    """In words."""
    parts = [f"{condition.points:,} points", *(f"{100 * condition.noise:g} % noise",) * (condition.noise > 0)]
    return ", ".join([*parts, *(f"{100 * condition.clutter:g} % clutter",) * (condition.clutter > 0)])


@cache
def true_pairs(data: Path) -> list[tuple[Path, dict[str, Any]]]:
    """All pairs with a truth, by folder; mixed, so that any number of seeds sees every kind."""
    specs = [(path.parent, json.loads(path.read_text())) for path in sorted(data.glob("*/pairs.json"))]
    pairs = [(folder, pair) for folder, spec in specs for pair in spec["pairs"]]
    return [pairs[place] for place in np.random.default_rng(0).permutation(len(pairs))]


@cache
def whole_cloud(path: Path) -> Array:
    """A cloud from a file, without rows that are not finite."""
    points = read_cloud(path)
    return points[np.isfinite(points).all(axis=1)]


def diagonal(points: Array) -> float:
    """Of the bounding box."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


KINDS: dict[str, Callable[[Study, Task, np.random.Generator], Case]] = {
    "outliers": outliers,
    "shuffled": shuffled,
    "grid": grid,
    "limit": limit,
    "unrelated": unrelated,
    "scans": scans,
}


# --- running -----------------------------------------------------------


def all_tasks(seeds: int, cloud_seeds: int) -> tuple[Task, ...]:
    """What is run, in the order of the report."""
    rows = [(problem, kind) for problem in EXPERIMENTS for kind in ("outliers", "shuffled", "grid", "limit")]
    clouds = [(CLOUDS, "unrelated"), (CLOUDS, "scans")]
    return (
        *(Task(*group, seed) for group in rows for seed in range(seeds)),
        *(Task(*group, seed) for group in clouds for seed in range(cloud_seeds)),
    )


# --- summaries ---------------------------------------------------------


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Right and wrong answers, trusted and not, of one problem and kind."""
    statuses = [outcome.status for outcome in outcomes]
    return {
        "problem": outcomes[0].problem,
        "kind": outcomes[0].kind,
        "trials": len(outcomes),
        "cases": len({outcome.case for outcome in outcomes}),
        "statuses": {status: statuses.count(status) for status in sorted(set(statuses))},
        "table": {name: spread(o.confidence for o in outcomes if cell(o) == name) for name in verdict_page.CELLS},
        "bins": binned(outcomes),
    }


def cell(outcome: Outcome) -> str:
    """Of the table."""
    return f"{'trusted' if outcome.trusted else 'untrusted'}_{'right' if outcome.right else 'wrong'}"


def spread(confidences: Iterable[float]) -> dict[str, Any]:
    """How many there are, and the least, the median and the largest."""
    values = list(confidences)
    named = zip(("least", "median", "largest"), np.percentile(values, (0, 50, 100)) if values else (), strict=False)
    return {"count": len(values)} | {name: float(value) for name, value in named}


def binned(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """For each bin the trials in it, the right ones, and the sum of the confidences."""
    places = np.searchsorted(verdict_page.EDGES[1:-1], [o.confidence for o in outcomes])  # 0.5 is not trusted: below
    return [
        {
            "count": int((places == place).sum()),
            "right": sum(o.right for o, where in zip(outcomes, places, strict=True) if where == place),
            "confidence": sum(o.confidence for o, where in zip(outcomes, places, strict=True) if where == place),
        }
        for place in range(len(verdict_page.EDGES) - 1)
    ]


def summaries(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """One for each problem and kind."""
    groups: dict[tuple[str, str], list[Outcome]] = {}
    for outcome in outcomes:
        groups.setdefault((outcome.problem, outcome.kind), []).append(outcome)
    return [summary(group) for group in groups.values()]


def main() -> None:
    """Measure and write all, or write the page only, or compare it."""
    options = parse()
    if options.check:
        sys.exit(verdict_page.difference(JSON) or structured_page.difference(structured.JSON))
    if options.miscalibrated:
        miscalibration.measure(min(options.seeds or 200, 200))
    elif options.structured and not options.page:
        structured.measure(options.data, options.seeds or 300, options.workers, options.journal)
        structured_page.write(structured.JSON)
    elif options.page:
        verdict_page.write(JSON)
        structured_page.write(structured.JSON)
    else:
        measure(options)
        verdict_page.write(JSON)


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA, help="the folder of the real data")
    parser.add_argument("--seeds", type=int, help="trials of each kind for given matches: 1000, 200 or 300")
    parser.add_argument("--cloud-seeds", type=int, default=200, help="trials of each kind for raw clouds")
    parser.add_argument("--samples", type=int, default=10, help="at most so many samples of given matches")
    parser.add_argument("--workers", type=int, default=2, help="processes; they do not change the results")
    parser.add_argument("--journal", type=Path, help="keeps each outcome; a run that was stopped goes on there")
    parser.add_argument("--miscalibrated", action="store_true", help="measure wrong calibrations only")
    parser.add_argument("--structured", action="store_true", help="measure wrong matches with structure only")
    parser.add_argument("--page", action="store_true", help="write the page and the picture only")
    parser.add_argument("--check", action="store_true", help="compare the page with the JSON, and write nothing")
    return parser.parse_args()


def measure(options: argparse.Namespace) -> None:
    """Run all tasks and write the JSON."""
    if not any(options.data.glob("*/pairs.json")):
        sys.exit(f"no real data in {options.data.name}; give their folder (--data), or set NONSAC_DATA")
    seeds = options.seeds or 1000
    settings = {"seeds": seeds} | {name: getattr(options, name) for name in ("cloud_seeds", "samples")}
    settings |= {"wrong_degrees": WRONG, "wrong_shift": WRONG_SHIFT, "limits": LIMITS}
    settings |= {"conditions": [described(condition) for condition in CONDITIONS]}
    settings |= {"grid": {name: [list(e.outlier_ratios), list(e.noises)] for name, e in EXPERIMENTS.items()}}
    study = Study(all_tasks(seeds, options.cloud_seeds), options.data, options.samples)
    outcomes = journal.run(study, Outcome, options.workers, options.journal, settings | {"commit": commit()})
    mistakes = [asdict(outcome) for outcome in outcomes if outcome.trusted and not outcome.right]
    results = summaries(outcomes)
    calibration = verdict_page.calibration(results)
    write(JSON, "verdict", settings=settings, results=results, calibration=calibration, false_successes=mistakes)


if __name__ == "__main__":
    main()
