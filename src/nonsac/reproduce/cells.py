"""One cell of an experiment: many trials at one noise, one outlier ratio and one sample size, with all rules.

All rules choose among the same hypotheses, and fewer samples are the first of more, so one set of hypotheses serves
every rule and every m. `fixed` and `refined` do their own work, on the rows of the first m samples.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from nonsac.evaluation import rotation_error
from nonsac.layouts import Array
from nonsac.method.scoring import FixedSample, Ideal, paper_rules, select
from nonsac.method.search import SampleTask
from nonsac.problems.contract import Problem
from nonsac.problems.noise import Noise
from nonsac.reproduce.experiments import Experiment
from nonsac.result import Hypothesis
from nonsac.sources import ArraySource

__all__ = ["RULES", "SHOWN_RULES", "Cell", "Trial", "TrialTask", "run_trial", "selected_models"]

# In the order of Table 2; `refined` is the default pipeline of this package.
RULES = ("ideal", "fixed", *(rule.name for rule in paper_rules()), "refined")
# If all of them would be too many.
SHOWN_RULES = ("ideal", "fixed", "most_inliers", "minimum_mean", "tlp_0.1", "refined")


@dataclass(frozen=True)
class Cell:
    """What the trials of a cell share; `counts` are the numbers of samples (m) that are compared."""

    experiment: Experiment
    outlier_ratio: float
    noise: float
    counts: tuple[int, ...]
    sample_size: int

    def generator(self, seed: int, number: int) -> np.random.Generator:
        """Of trial `number`; data are drawn for the most samples, so they also depend on the largest of `counts`."""
        place = f"{self.experiment.name} {self.outlier_ratio:g} {self.noise:g} {self.sample_size}"
        return np.random.default_rng([seed, number, zlib.crc32(place.encode())])


@dataclass(frozen=True)
class Trial:
    """Rotation errors in degrees by m and rule, seconds by m and stage, and whether `refined` claimed success."""

    errors: dict[int, dict[str, float]]
    seconds: dict[int, dict[str, float]]
    claimed: dict[int, bool]


@dataclass(frozen=True)
class TrialTask:
    """Trials from their number, over all cells, to their outcome; travels to any process."""

    cells: tuple[Cell, ...]
    trials: int
    seed: int
    waiting: tuple[int, ...]

    def __call__(self, position: int) -> Trial:
        cell, number = divmod(self.waiting[position], self.trials)
        return run_trial(self.cells[cell], self.seed, number)


def run_trial(cell: Cell, seed: int, number: int) -> Trial:
    """One trial: data for the most samples, all hypotheses, and what each rule makes of the first m of them."""
    experiment = cell.experiment
    rng = cell.generator(seed, number)
    most = max(cell.counts)
    rows, truth = experiment.simulate(most * cell.sample_size, cell.outlier_ratio, cell.noise, rng)
    task = SampleTask(
        ArraySource(rows),
        experiment.problem,
        experiment.estimator,
        Noise.given(cell.noise),
        cell.sample_size,
        int(rng.integers(2**63)),
    )
    hypotheses, elapsed = _hypotheses(task, most)
    trial = Trial({}, {}, {})
    for m in cell.counts:
        start = perf_counter()
        fixed = _with_fixed_sample(task, m)
        middle = perf_counter()
        refined = experiment.refined(
            task.union(m).values, noise=cell.noise, max_samples=m, sample_size=cell.sample_size, rng=task.seed
        )
        end = perf_counter()
        seen = _as_the_rules_see(hypotheses[:m], experiment)
        models = selected_models(seen, experiment.problem, truth) | {"fixed": fixed.model, "refined": refined.T}
        trial.errors[m] = {rule: float(rotation_error(models[rule][:3, :3], truth[:3, :3])) for rule in RULES}
        trial.seconds[m] = {"hypotheses": elapsed[m - 1], "fixed": middle - start, "refined": end - middle}
        trial.claimed[m] = refined.success
    return trial


def _hypotheses(task: SampleTask, count: int) -> tuple[list[Hypothesis], list[float]]:
    """One for each sample, and the seconds that it took to have the first, the first two, ..."""
    start = perf_counter()
    hypotheses, elapsed = [], []
    for sample in range(count):
        hypotheses.append(task(sample))
        elapsed.append(perf_counter() - start)
    return hypotheses, elapsed


def _with_fixed_sample(task: SampleTask, m: int) -> Hypothesis:
    """The first sample alone, searched with the budget of m."""
    _, estimator = FixedSample().plan(m, task.estimator)
    return replace(task, estimator=estimator)(0)


def _as_the_rules_see(hypotheses: Sequence[Hypothesis], experiment: Experiment) -> list[Hypothesis]:
    """With residuals and threshold as the paper has them, squared if it squares them."""
    power = experiment.residual_power
    return [replace(h, residuals=h.residuals**power, threshold=h.threshold**power) for h in hypotheses]


def selected_models(hypotheses: Sequence[Hypothesis], problem: Problem, truth: Array) -> dict[str, Array]:
    """The model (3, 4) that each rule of the paper selects, by the rule's name; `truth` (4, 4) is for `ideal`."""
    rules = (Ideal(truth), *paper_rules())
    return {rule.name: hypotheses[select(rule, hypotheses, problem)[0]].model for rule in rules}
