"""Table 2 of the paper: every rule, on three simulated problems, over a grid of outlier ratios and noise levels.

A trial costs one set of hypotheses, for all rules and all m. The row `refined` is the default pipeline of this package.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from nonsac.reproduce import summaries
from nonsac.reproduce.cells import RULES, Cell, Trial
from nonsac.reproduce.experiments import EXPERIMENTS, chosen
from nonsac.reproduce.running import Plan, Progress, check_trials, run_trials

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["PAPER", "PAPER_COUNTS", "run", "table"]

PAPER_COUNTS = (10, 20, 30)

# Lee, Vandewalle and Civera, "NONSAC", Table 2: mAA averaged over outlier ratios and noise levels; relative pose,
# Perspective-n-Point and registration, each with 10, 20 and 30 samples.
_PUBLISHED = {
    "ideal": ((0.91, 0.94, 0.96), (0.88, 0.94, 0.96), (0.82, 0.91, 0.95)),
    "fixed": ((0.79, 0.81, 0.83), (0.84, 0.88, 0.92), (0.47, 0.54, 0.60)),
    "most_inliers": ((0.80, 0.83, 0.85), (0.83, 0.89, 0.91), (0.80, 0.88, 0.91)),
    "closest_pair": ((0.75, 0.75, 0.78), (0.78, 0.86, 0.87), (0.72, 0.83, 0.89)),
    "closest_triplet": ((0.77, 0.77, 0.80), (0.80, 0.88, 0.90), (0.71, 0.81, 0.88)),
    "minimum_mean": ((0.83, 0.87, 0.89), (0.42, 0.46, 0.47), (0.09, 0.05, 0.03)),
    "minimum_median": ((0.81, 0.86, 0.88), (0.40, 0.42, 0.41), (0.09, 0.04, 0.03)),
    "minimum_q3": ((0.82, 0.87, 0.89), (0.56, 0.61, 0.61), (0.12, 0.06, 0.05)),
    "pair_0.02": ((0.81, 0.84, 0.86), (0.83, 0.90, 0.91), (0.80, 0.88, 0.91)),
    "pair_0.05": ((0.82, 0.86, 0.87), (0.83, 0.90, 0.91), (0.80, 0.88, 0.91)),
    "pair_0.1": ((0.82, 0.86, 0.87), (0.83, 0.90, 0.92), (0.80, 0.88, 0.91)),
    "pair_0.2": ((0.80, 0.82, 0.84), (0.83, 0.90, 0.92), (0.80, 0.88, 0.92)),
    "pair_0.5": ((0.82, 0.85, 0.86), (0.83, 0.89, 0.91), (0.80, 0.88, 0.92)),
    "pair_1": ((0.78, 0.80, 0.81), (0.82, 0.88, 0.90), (0.78, 0.86, 0.91)),
    "tlp_0.01": ((0.78, 0.80, 0.83), (0.56, 0.64, 0.65), (0.81, 0.89, 0.92)),
    "tlp_0.1": ((0.83, 0.87, 0.90), (0.83, 0.90, 0.93), (0.81, 0.89, 0.92)),
    "tlp_0.2": ((0.83, 0.87, 0.90), (0.83, 0.90, 0.93), (0.81, 0.89, 0.92)),
    "tlp_0.3": ((0.83, 0.87, 0.89), (0.83, 0.90, 0.93), (0.81, 0.89, 0.92)),
    "tlp_0.5": ((0.83, 0.87, 0.89), (0.83, 0.91, 0.93), (0.81, 0.89, 0.92)),
    "tlp_1": ((0.83, 0.87, 0.89), (0.83, 0.91, 0.93), (0.81, 0.88, 0.92)),
    "tlp_2": ((0.82, 0.86, 0.88), (0.83, 0.91, 0.93), (0.80, 0.88, 0.91)),
}
PAPER = {
    problem: {m: {rule: row[column][k] for rule, row in _PUBLISHED.items()} for k, m in enumerate(PAPER_COUNTS)}
    for column, problem in enumerate(EXPERIMENTS)
}


def run(
    problems: Iterable[str] = tuple(EXPERIMENTS),
    samples: Iterable[int] = PAPER_COUNTS,
    trials: int = 100,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
    journal: str | os.PathLike[str] | None = None,
    resume: bool = False,
    literal: bool = False,
) -> dict[str, Any]:
    """Run the experiments of Table 2.

    Parameters
    ----------
    problems : iterable of str
        Of "relative-pose", "absolute-pose" and "registration".
    samples : iterable of int
        The m to compare; the samples of a smaller one are the first of a larger one.
    trials : int
        For each cell; the paper has 100.
    seed : int
        Trial t of a cell depends on (seed, t), the cell and the largest m.
    workers : int or None
        Number of processes; None is one for each core. It changes the times only.
    progress : callable, optional
        Called as `progress(done, trials of all cells)`.
    journal : path-like, optional
        Keeps the finished trials; remove it when the report is safe.
    resume : bool
        Go on where the journal of a run that was stopped ends.
    literal : bool
        As the paper's text has it: the second camera sees all points, Sampson's distance does not ask on which side of
        a camera rays meet, and rows are ranked by the sums of PCR-99's authors.

    Returns
    -------
    dict
        Ready for JSON. For each problem and m the mAA of each rule, averaged over the cells; `cells` with those of each
        cell; `percentiles` of all rotation errors (degrees; 180 if an estimate failed); `claims`, how `refined`
        judged its own answers; `settings`; `seconds`, medians for one trial.

    Raises
    ------
    ValueError
        If an argument is out of its range, or the journal belongs to another run.
    """
    plan = _plan(problems, samples, trials, seed, literal)
    outcomes = run_trials(plan, workers, progress, journal, resume)
    return _report(plan, outcomes)


def table(report: Mapping[str, Any], problem: str) -> Table:
    """The averages of one problem beside the paper's, for `rich.print`."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    settings, columns = report["settings"], report[problem]
    title = f"Table 2, {problem}: mAA, {_cells_of(report, problem)} cells of {settings['trials']} trials"
    result = Table(box=SIMPLE_HEAD, collapse_padding=True, title=title, caption=_caption(report, problem))
    result.add_column("rule", no_wrap=True)
    for m in columns:
        result.add_column(f"m = {m}", justify="right")
        result.add_column("paper", justify="right", style="dim")
    for rule in RULES:
        cells = []
        for m, accuracy in columns.items():
            published = PAPER[problem].get(int(m), {}).get(rule)
            cells += [f"{accuracy[rule]:.2f}", "" if published is None else f"{published:.2f}"]
        result.add_row(rule, *cells)
    return result


def _plan(problems: Iterable[str], samples: Iterable[int], trials: int, seed: int, literal: bool) -> Plan:
    counts, experiments = tuple(sorted(set(samples))), chosen(problems, literal)
    if not counts or counts[0] < 1:
        raise ValueError(f"samples must be numbers of at least 1, got {counts!r}")
    check_trials(trials)
    cells = tuple(
        Cell(experiment, outlier_ratio, noise, counts, experiment.sample_size)
        for experiment in experiments
        for noise in experiment.noises
        for outlier_ratio in experiment.outlier_ratios
    )
    settings = {
        "trials": trials,
        "seed": seed,
        "samples": list(counts),
        **({"literal": True} if literal else {}),
        "problems": {experiment.name: experiment.settings() for experiment in experiments},
        "refined": "the default pipeline of this package, on the rows of the first m samples",
        "wrong_above_deg": summaries.WRONG_ABOVE,
        "percentiles": list(summaries.PERCENTILES),
        **summaries.environment(),
    }
    return Plan(cells, trials, seed, settings)


def _report(plan: Plan, outcomes: Sequence[Sequence[Trial]]) -> dict[str, Any]:
    names = list(plan.settings["problems"])
    counts = plan.settings["samples"]
    by_problem = {
        name: [trials for cell, trials in zip(plan.cells, outcomes, strict=True) if cell.experiment.name == name]
        for name in names
    }
    return {
        **{name: {str(m): summaries.mean_accuracies(cells, m) for m in counts} for name, cells in by_problem.items()},
        "cells": [
            {
                "problem": cell.experiment.name,
                "outlier_ratio": cell.outlier_ratio,
                "noise": cell.noise,
                "accuracy": {str(m): summaries.accuracies(trials, m) for m in counts},
            }
            for cell, trials in zip(plan.cells, outcomes, strict=True)
        ],
        "percentiles": {
            name: {str(m): summaries.percentiles(cells, m) for m in counts} for name, cells in by_problem.items()
        },
        "claims": {name: {str(m): summaries.claims(cells, m) for m in counts} for name, cells in by_problem.items()},
        "settings": dict(plan.settings),
        "seconds": {name: {str(m): summaries.times(cells, m) for m in counts} for name, cells in by_problem.items()},
    }


def _cells_of(report: Mapping[str, Any], problem: str) -> int:
    return sum(cell["problem"] == problem for cell in report["cells"])


def _caption(report: Mapping[str, Any], problem: str) -> str:
    most = max(report[problem], key=int)
    seconds, judged = report["seconds"][problem][most], report["claims"][problem][most]
    return (
        f"m = {most}: hypotheses {seconds['hypotheses']:.2g} s, refined {seconds['refined']:.2g} s (medians)\n"
        f"refined trusted {judged['trusted_right']} right and {judged['trusted_wrong']} wrong answers\n"
        f"and doubted {judged['untrusted_right']} right ones"
    )
