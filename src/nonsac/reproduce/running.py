"""Runs the trials of cells, one process for each worker; what is finished survives a stop."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from nonsac.reproduce.cells import RULES, Cell, Trial, TrialTask, run_trial
from nonsac.reproduce.journal import Journal
from nonsac.running.executors import Workers, cores, ordered_map
from nonsac.running.processes import end_with_parent

__all__ = ["Plan", "check_trials", "run_trials"]

Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class Plan:
    """Cells, how many trials each has, and the seed; `settings` is what has to agree if a run goes on."""

    cells: tuple[Cell, ...]
    trials: int
    seed: int
    settings: Mapping[str, Any]

    def __len__(self) -> int:
        return len(self.cells) * self.trials


def check_trials(trials: int) -> None:
    if trials < 1:
        raise ValueError(f"trials must be at least 1, got {trials!r}")


def run_trials(
    plan: Plan,
    workers: int | None = None,
    progress: Progress | None = None,
    journal: str | os.PathLike[str] | None = None,
    resume: bool = False,
) -> list[list[Trial]]:
    """All trials of all cells.

    Parameters
    ----------
    plan : Plan
    workers : int or None
        Number of processes; None is one for each core. It changes the times only.
    progress : callable, optional
        Called as `progress(done, total)`.
    journal : path-like, optional
        Keeps the finished trials; remove it when the report is safe.
    resume : bool
        Go on where the journal ends.

    Returns
    -------
    list of list of Trial
        For each cell its trials.

    Raises
    ------
    ValueError
        If the journal belongs to another run.
    """
    with Journal(journal, plan.settings, resume) as kept:
        _check_trials(plan, kept.trials)
        waiting = tuple(position for position in range(len(plan)) if position not in kept.trials)
        task = TrialTask(plan.cells, plan.trials, plan.seed, waiting)
        if waiting:
            _warm_up(plan)
        with _pool(workers, len(waiting)) as pool:
            for position, trial in zip(waiting, ordered_map(task, len(waiting), pool), strict=True):
                kept.add(position, trial)
                if progress is not None:
                    progress(len(kept.trials), len(plan))
        ordered = [kept.trials[position] for position in range(len(plan))]
    return [ordered[start : start + plan.trials] for start in range(0, len(ordered), plan.trials)]


def _check_trials(plan: Plan, trials: Mapping[int, Trial]) -> None:
    """Damaged ones are found before the others are run, not after."""
    for position, trial in trials.items():
        fits = 0 <= position < len(plan) and all(
            tuple(part) == plan.cells[position // plan.trials].counts
            for part in (trial.errors, trial.seconds, trial.claimed)
        )
        if not fits or any(tuple(by_rule) != RULES for by_rule in trial.errors.values()):
            raise ValueError(f"the journal's trial {position} is damaged; remove the journal to start anew")


def _warm_up(plan: Plan) -> None:
    """Compiles the kernels before there are several processes, each of which would do it."""
    for cell in {cell.experiment.name: cell for cell in plan.cells}.values():
        run_trial(replace(cell, counts=(3,)), plan.seed, 0)


@contextmanager
def _pool(workers: int | None, tasks: int) -> Iterator[Workers]:
    """One for `ordered_map`. Processes, since the rules are pure Python and would wait for each other in threads."""
    processes = min(cores() if workers is None else workers, max(tasks, 1))
    if processes == 1:
        yield 1
        return
    spawn = multiprocessing.get_context("spawn")  # a fork would copy the locks of running threads
    with ProcessPoolExecutor(processes, mp_context=spawn, initializer=end_with_parent) as pool:
        yield pool
