"""Raw clouds, no matches and no initial guess: how often right, how often a false claim, how fast.

    python benchmarks/clouds.py [FOLDER ...] [--stride 2] [--methods nonsac open3d] [--conditions clean] [--json FILE]

A folder holds PLY clouds and a pairs.json with the true transforms and what counts as right. It is looked for as given,
then in the folder that NONSAC_DATA names (default ../shared/data). Each source is turned at random about its centroid.
All methods see the same inputs, one after the other, each in a process of its own that has been warmed up. A method
that exceeds the time limit on one pair is given up in that folder and condition: the pair counts as not right, the rest
as not tried. One that has used up its budget of seconds there is stopped, too; its number of trials says so.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
from cloud_methods import METHODS, Array
from common import RESULTS, Call, Worker, installed, median, say, write

from nonsac.evaluation import rotation_error
from nonsac.io import read_cloud
from nonsac.simulate import demo_scans, random_rotation

DATA = Path(os.environ.get("NONSAC_DATA", Path(__file__).parents[1] / "../shared/data"))


@dataclass(frozen=True)
class Condition:
    """What is done to both clouds of a pair before they are registered."""

    noise: float = 0.0  # standard deviation, as a share of the target's diagonal
    points: int = 0  # how many random points are kept; 0 keeps all
    clutter: float = 0.0  # uniform points in the bounding box, as a share of the cloud's

    def apply(self, cloud: Array, diagonal: float, rng: np.random.Generator) -> Array:
        kept = rng.permutation(len(cloud))[: self.points or None]
        cloud = cloud[kept] + self.noise * diagonal * rng.standard_normal((len(kept), 3))
        clutter = rng.uniform(cloud.min(axis=0), cloud.max(axis=0), (int(self.clutter * len(cloud)), 3))
        return np.vstack([cloud, clutter])


CONDITIONS = {
    "clean": Condition(),
    "noise": Condition(noise=0.01),
    "points": Condition(points=1000),
    "clutter": Condition(clutter=1.0),
}


@dataclass(frozen=True)
class Trial:
    name: str
    source: Array
    target: Array
    truth: Array
    diagonal: float
    largest_angle: float
    largest_shift: float  # of the source's centroid, as a share of the diagonal

    def judge(self, T: Array) -> tuple[float, bool]:
        """Rotation error in degrees, and whether the answer is right."""
        if not np.isfinite(T).all():
            return float("nan"), False
        angle = float(rotation_error(T[:3, :3], self.truth[:3, :3]))
        difference = T - self.truth
        shift = np.linalg.norm(difference[:3, :3] @ self.source.mean(axis=0) + difference[:3, 3]) / self.diagonal
        return angle, bool(angle <= self.largest_angle and shift <= self.largest_shift)


@dataclass(frozen=True)
class Outcome:
    pair: str
    right: bool
    claimed: bool
    degrees: float | None
    seconds: float | None  # None: given up at the limit
    error: str = ""


def main() -> None:
    arguments = parse()
    workers = {name: Worker(partial(warm_up, name), arguments.limit) for name in arguments.methods}
    results = []
    for folder in map(find_folder, arguments.folders):
        for condition in arguments.conditions:
            trials = list(read_trials(folder, arguments.stride, CONDITIONS[condition]))
            outcomes = run(trials, workers, arguments.budget)
            for name in arguments.methods:
                found = {"folder": folder.name, "condition": condition, "method": name} | summary(outcomes[name])
                say(json.dumps(found | {"outcomes": len(outcomes[name])}))
                results.append(found)
    for worker in workers.values():
        worker.close()
    kept = ("stride", "limit", "budget")
    settings = {name: getattr(arguments, name) for name in kept} | {"conditions": conditions_used(arguments)}
    write(arguments.json, "clouds", settings=settings, results=results)


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    available = [name for name, (_, modules, _) in METHODS.items() if all(map(installed, modules))]
    parser.add_argument("folders", nargs="*", default=["bunny_scans", "redkitchen", "car_lidar"])
    parser.add_argument("--stride", type=int, default=1, help="take every so-manieth pair")
    parser.add_argument("--methods", nargs="+", choices=available, default=available)
    parser.add_argument("--conditions", nargs="+", choices=list(CONDITIONS), default=list(CONDITIONS))
    parser.add_argument("--limit", type=float, default=60.0, help="seconds after which a method is given up")
    parser.add_argument("--budget", type=float, default=150.0, help="seconds for a method in one folder and condition")
    parser.add_argument("--json", type=Path, default=RESULTS / "clouds.json")
    return parser.parse_args()


def find_folder(name: str) -> Path:
    folder = next((f for f in (Path(name), DATA / name) if (f / "pairs.json").exists()), None)
    if folder is None:
        raise SystemExit(f"no pairs.json in {name} or in {DATA / name}; set NONSAC_DATA")
    return folder


def conditions_used(arguments: argparse.Namespace) -> dict[str, dict[str, float]]:
    return {name: asdict(CONDITIONS[name]) for name in arguments.conditions}


def warm_up(name: str) -> None:
    """Two registrations of simulated scans, one noisy: imports, compilation and first allocations are not timed."""
    for noise in (0.002, 0.02):
        pair = demo_scans(0, points=3000, noise=noise)
        METHODS[name][2](pair.source, pair.target, 0)


def read_trials(folder: Path, stride: int, condition: Condition) -> Iterator[Trial]:
    spec = json.loads((folder / "pairs.json").read_text())
    for number in range(0, len(spec["pairs"]), stride):
        pair = spec["pairs"][number]
        rng = np.random.default_rng(number)
        diagonal = pair["target_diameter"]
        clouds = [read_cloud(folder / pair[which]) for which in ("source", "target")]
        source, target = (condition.apply(cloud, diagonal, rng) for cloud in clouds)
        turn = turn_about(clouds[0].mean(axis=0), random_rotation(rng))
        yield Trial(
            f"{Path(pair['source']).stem}-{Path(pair['target']).stem}",
            source @ turn[:3, :3].T + turn[:3, 3],
            target,
            np.array(pair["T_target_source"]) @ np.linalg.inv(turn),
            diagonal,
            spec["max_rotation_deg"],
            spec["max_translation_fraction_of_diameter"],
        )


def turn_about(centre: Array, R: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, centre - R @ centre
    return T


def run(trials: list[Trial], workers: dict[str, Worker], budget: float) -> dict[str, list[Outcome]]:
    """The outcomes of each method; the methods take turns on each pair, so that all share the machine's moods."""
    outcomes: dict[str, list[Outcome]] = {name: [] for name in workers}
    for trial in trials:
        for name, worker in workers.items():
            if stopped(outcomes[name], budget):
                continue
            call = worker.call(METHODS[name][2], trial.source, trial.target, 0)
            outcomes[name].append(outcome_of(trial, call))
            say(f"  {trial.name} {name}: {outcomes[name][-1]}")
    return outcomes


def stopped(outcomes: list[Outcome], budget: float) -> bool:
    seconds = [outcome.seconds for outcome in outcomes]
    return None in seconds or sum(filter(None, seconds)) > budget


def outcome_of(trial: Trial, call: Call | None) -> Outcome:
    if call is None:
        return Outcome(trial.name, False, False, None, None)
    if call.value is None:
        return Outcome(trial.name, False, False, None, call.seconds, call.error)
    T, claimed = call.value
    angle, right = trial.judge(T)
    return Outcome(trial.name, right, bool(claimed), None if np.isnan(angle) else angle, call.seconds)


def summary(outcomes: list[Outcome]) -> dict[str, object]:
    return {
        "trials": len(outcomes),
        "right": sum(o.right for o in outcomes),
        "false_claims": sum(o.claimed and not o.right for o in outcomes),
        "silent": sum(o.right and not o.claimed for o in outcomes),
        "given_up": any(o.seconds is None for o in outcomes),
        "median_seconds": median([o.seconds for o in outcomes if o.seconds is not None]),
        "median_degrees_of_right": median([o.degrees for o in outcomes if o.right and o.degrees is not None]),
        "outcomes": [asdict(o) for o in outcomes],
    }


if __name__ == "__main__":
    main()
