"""Section 5 of the paper, in numbers: what the number of samples (m) and their size (N) do to each rule.

The paper discusses both without figures. The noise is the middle one of Table 2, the outlier ratios are its lowest,
middle and highest; m varies at the paper's N, and N at m = 10.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from nonsac.reproduce import summaries
from nonsac.reproduce.cells import SHOWN_RULES, Cell, Trial
from nonsac.reproduce.experiments import EXPERIMENTS, Experiment, chosen
from nonsac.reproduce.running import Plan, Progress, check_trials, run_trials

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["COUNTS", "run", "table"]

COUNTS = (1, 2, 3, 5, 10, 20, 30, 50, 100)
# Times the paper's N.
SIZES = (1 / 8, 1 / 4, 1 / 2, 1, 2, 4, 8)
COUNT_OF_SIZES = 10


def run(
    problems: Iterable[str] = tuple(EXPERIMENTS),
    trials: int = 100,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
    journal: str | os.PathLike[str] | None = None,
    resume: bool = False,
) -> dict[str, Any]:
    """Vary the number of samples, and their size.

    Parameters
    ----------
    problems, trials, seed, workers, progress, journal, resume
        As in `nonsac.reproduce.table2.run`.

    Returns
    -------
    dict
        Ready for JSON. For each problem `samples`, the mAA by m and rule, and `sample_size`, by N and rule, averaged
        over the outlier ratios; `settings`; `seconds`, medians for one trial.

    Raises
    ------
    ValueError
        If an argument is out of its range, or the journal belongs to another run.
    """
    plan = _plan(problems, trials, seed)
    outcomes = run_trials(plan, workers, progress, journal, resume)
    return _report(plan, outcomes)


def table(report: Mapping[str, Any], problem: str, curve: str) -> Table:
    """One curve of a report, for `rich.print`: `curve` is "samples" or "sample_size"."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    values = report[problem][curve]
    result = Table(box=SIMPLE_HEAD, collapse_padding=True, title=f"{problem}: mAA by {curve.replace('_', ' ')}")
    result.add_column("rule", no_wrap=True)
    for size in values:
        result.add_column(size, justify="right")
    for rule in SHOWN_RULES:
        result.add_row(rule, *(f"{accuracy[rule]:.2f}" for accuracy in values.values()))
    return result


def _plan(problems: Iterable[str], trials: int, seed: int) -> Plan:
    check_trials(trials)
    experiments = chosen(problems)
    settings = {
        "trials": trials,
        "seed": seed,
        "samples": list(COUNTS),
        "problems": {
            experiment.name: experiment.settings()
            | {"noises": [_noise(experiment)], "outlier_ratios": _ratios(experiment), "sample_size": _sizes(experiment)}
            for experiment in experiments
        },
        **summaries.environment(),
    }
    cells = tuple(cell for experiment in experiments for cell in _cells(experiment))
    return Plan(cells, trials, seed, settings)


def _cells(experiment: Experiment) -> list[Cell]:
    """All numbers of samples at the paper's N, then all sizes, at each outlier ratio."""
    noise = _noise(experiment)
    return [
        Cell(experiment, ratio, noise, counts, size)
        for counts, sizes in ((COUNTS, (experiment.sample_size,)), ((COUNT_OF_SIZES,), _sizes(experiment)))
        for size in sizes
        for ratio in _ratios(experiment)
    ]


def _noise(experiment: Experiment) -> float:
    return experiment.noises[len(experiment.noises) // 2]


def _ratios(experiment: Experiment) -> list[float]:
    ratios = experiment.outlier_ratios
    return [ratios[0], ratios[len(ratios) // 2], ratios[-1]]


def _sizes(experiment: Experiment) -> list[int]:
    return [round(factor * experiment.sample_size) for factor in SIZES]


def _report(plan: Plan, outcomes: Sequence[Sequence[Trial]]) -> dict[str, Any]:
    report: dict[str, Any] = {}
    seconds: dict[str, Any] = {}
    for name in plan.settings["problems"]:
        found = [pair for pair in zip(plan.cells, outcomes, strict=True) if pair[0].experiment.name == name]
        by_count = {m: [trials for cell, trials in found if cell.counts == COUNTS] for m in COUNTS}
        by_size: dict[int, list[Sequence[Trial]]] = {}
        for cell, trials in found:
            if cell.counts == (COUNT_OF_SIZES,):
                by_size.setdefault(cell.sample_size, []).append(trials)
        report[name] = {
            "samples": {str(m): summaries.mean_accuracies(cells, m) for m, cells in by_count.items()},
            "sample_size": {
                str(size): summaries.mean_accuracies(cells, COUNT_OF_SIZES) for size, cells in by_size.items()
            },
        }
        seconds[name] = {
            "samples": {str(m): summaries.times(cells, m) for m, cells in by_count.items()},
            "sample_size": {str(size): summaries.times(cells, COUNT_OF_SIZES) for size, cells in by_size.items()},
        }
    return report | {"settings": dict(plan.settings), "seconds": seconds}
