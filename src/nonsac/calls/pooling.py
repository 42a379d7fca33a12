"""The noise of one scene is about the same in all its pairs: the first ones measure it, the others start from it.

Edstedt, "Less biased noise scale estimation for threshold-robust RANSAC" (2025). Which pairs are the first ones, and
what they measure, depends on the pairs alone, and not on who is done first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from nonsac.calls.jobs import Job
from nonsac.result import Remark, Result

FIRST_PAIRS = 16
_FEWEST = 5
_DOUBTS_ABOUT_NOISE = {Remark.PARTLY_RIGHT, Remark.SLIPPING}


@dataclass(frozen=True)
class PooledRun:
    """Runs jobs of one scene with its noise, or without one.

    Attributes
    ----------
    noise : float or None
        None measures it in each.
    time_limit : float or None
    """

    noise: float | None = None
    time_limit: float | None = None

    def __call__(self, job: Job) -> Result:
        """What has more than chance support with this noise, but another doubt, is tried without it."""
        if self.noise is None:
            return job.run(self.time_limit)
        result = Job(job.call, *job.data, name=job.name, **{**job.settings, "noise": self.noise}).run(self.time_limit)
        if result.success or _DOUBTS_ABOUT_NOISE.isdisjoint(result.remarks):
            return result
        alone = job.run(self.time_limit)
        return alone if alone.success else result


def first_of_scenes(scenes: Mapping[int, str]) -> dict[str, list[int]]:
    """For each scene the numbers of its first pairs, which measure its noise; `scenes` are those of pairs, in order."""
    first: dict[str, list[int]] = {}
    for number, scene in scenes.items():
        numbers = first.setdefault(scene, [])
        if len(numbers) < FIRST_PAIRS:
            numbers.append(number)
    return first


def pooled_noise(measured: Iterable[float]) -> float | None:
    """The median of what trusted pairs have measured; None if they are too few."""
    values = list(measured)
    return float(np.median(values)) if len(values) >= _FEWEST else None
