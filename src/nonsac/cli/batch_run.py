"""The pairs of a manifest that are not done yet: what is run, and what is written for each."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from nonsac.cli.messages import to_stderr
from nonsac.cli.session import Progress
from nonsac.files.errors import in_one_line

if TYPE_CHECKING:
    from nonsac.calls.jobs import Job
    from nonsac.cli.manifest import Manifest
    from nonsac.running.journal import Journal

FACTS = (
    "success",
    "status",
    "confidence",
    "T",
    "scale",
    "model",
    "num_inliers",
    "num_rows",
    "inlier_ratio",
    "noise",
    "threshold",
)


@dataclass(frozen=True)
class BatchRun:
    """What is needed to run the pairs of a manifest."""

    pairs: Manifest
    kept: Journal
    pool: Executor | None
    time_limit: float | None
    progress: Progress

    def complete(self) -> None:
        """Run what is missing: first the pairs that measure the noise of their scenes, then those that share it."""
        from nonsac.calls.pooling import first_of_scenes, pooled_noise

        first = first_of_scenes(self.pairs.scenes)
        self._run([number for numbers in first.values() for number in numbers], {})
        noises = {
            scene: pooled_noise(record["noise"] for record in self.kept.records(numbers) if record["success"])
            for scene, numbers in first.items()
        }
        self._run(range(self.pairs.count), noises)

    def _run(self, numbers: Collection[int], noises: Mapping[str, float | None]) -> None:
        from nonsac.calls.jobs import may_end
        from nonsac.running.many import run_many

        missing = [number for number in sorted(numbers) if number not in self.kept]
        if not missing:
            return
        wanted, scenes = frozenset(missing), self.pairs.scenes
        jobs = ((number, job) for number, job in enumerate(self.pairs.jobs()) if number in wanted)
        items = (Item.of(job, noises.get(scenes.get(number, ""))) for number, job in jobs)
        task = Summarise(self.time_limit)
        outcomes = run_many(task, items, self.pool, apart=lambda item: may_end(item.job), together=True)
        for number, (item, line) in zip(missing, outcomes, strict=True):
            self.kept.add(number, line if isinstance(line, dict) else _failure(item.job, line))
            self.progress(self.kept.count, self.pairs.count)


@dataclass(frozen=True)
class Item:
    """A job, and the noise of its scene."""

    job: Job
    noise: float | None = None

    @classmethod
    def of(cls, job: Job, noise: float | None) -> Item:
        """An item that can be sent to a worker."""
        job.compile()
        return cls(job, noise)


class Summarise:
    """Runs a job where it is sent to, and brings back what is to be written: no rows, no hypotheses, no times."""

    def __init__(self, time_limit: float | None) -> None:
        self.time_limit = time_limit

    def __call__(self, item: Item) -> dict[str, Any]:
        from nonsac.calls.pair_records import warnings_told
        from nonsac.calls.pooling import PooledRun

        with warnings_told() as told:
            result = PooledRun(item.noise, self.time_limit)(item.job)
            facts = result.to_dict()
        chosen = {fact: facts.get(fact) for fact in FACTS}
        return _named(item.job) | chosen | {"remarks": [*result.remarks, *told], "error": None}


def _failure(job: Job, error: Exception) -> dict[str, Any]:
    """What is written of a pair that could not be run; it is said at once, too."""
    message = in_one_line(error)
    to_stderr(f"{job.name}: failed: {message}")
    nothing = dict.fromkeys(FACTS) | {"success": False}
    return _named(job) | nothing | {"remarks": [], "error": message}


def _named(job: Job) -> dict[str, Any]:
    return {"name": job.name, "call": job.call.replace("_", "-")}
