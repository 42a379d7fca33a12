"""Writes docs/reproduction.md and its pictures from the JSON files in benchmarks/results/.

    python benchmarks/reproduction.py [--check]

The numbers come from table2.json and section5.json, which `nonsac reproduce` wrote, and from table2_settings.json. With
--check nothing is written, and the exit code is 1 where the page does not agree with the files. An entry that differs
from the paper's by more than 0.05 needs a reason in `REASONS`, or the script stops.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from nonsac.reproduce import pictures
from nonsac.reproduce.cells import RULES
from nonsac.reproduce.experiments import EXPERIMENTS
from nonsac.reproduce.table2 import PAPER, PAPER_COUNTS

ROOT = Path(__file__).parents[1]
RESULTS, DOCS = ROOT / "benchmarks" / "results", ROOT / "docs"
TITLES = {
    "relative-pose": "Relative pose",
    "absolute-pose": "Perspective-n-Point",
    "registration": "Registration of pairs",
}
MOST = 0.05

Report = dict[str, Any]

TEXT = """# The paper's experiments, run again

Written by `benchmarks/reproduction.py` from the JSON files in `benchmarks/results/`; no number here is typed by hand.

    nonsac reproduce table2 --trials {trials} --seed {seed} --json table2.json --picture table2.png
    nonsac reproduce section5 --trials {curve_trials} --json section5.json --picture section5.png
    nonsac reproduce table4 --cloud bun_zipper.ply --json table4.json --picture table4.png

A run that is stopped goes on with `--resume`. The experiment without matches (Table 4, Fig. 2) has [its own
page](table4.md). `refined` is the default pipeline of this package on the rows of the first m samples; it is no part of
the paper.

## Table 2

mAA(1 to 10 degrees), averaged over {cells} cells, {trials} trials each: {within} of {entries} entries are within
{most} of the paper's. Ours, the paper's, and the difference, in bold where it is larger than that.

{tables}

![Table 2 as heat maps](images/table2_heat_maps.png)

![mAA against the number of samples](images/table2_accuracy.png)

![Rotation errors by rule](images/table2_errors.png)

![Error against time](images/table2_time.png)

## Where we differ by more than {most}, and why

{reasons}

## What the paper concludes from it

{conclusions}

## Settings

{settings}

## Every cell

mAA with m = {counts}; all rules are in `benchmarks/results/table2.json`.

{cell_tables}

## Section 5: how many samples, and of which size

The paper discusses both without figures. {curve_trials} trials at the middle noise of Table 2 and its lowest, middle and
highest outlier ratio, averaged; m varies at the paper's N, and N at m = 10. The search in each sample does not change.

{curves}

![mAA against m and against N](images/section5.png)
"""


def page(table2: Report, settings: Report, section5: Report) -> str:
    """The whole page."""
    differing = list(differences(table2))
    entries = len(RULES[:-1]) * len(PAPER) * len(PAPER_COUNTS)
    return TEXT.format(
        trials=table2["settings"]["trials"],
        seed=table2["settings"]["seed"],
        cells=len(table2["cells"]) // len(PAPER),
        within=entries - len(differing),
        entries=entries,
        most=MOST,
        tables="\n\n".join(averages(table2, problem) for problem in TITLES),
        reasons=reasons(differing, settings),
        conclusions=conclusions(table2),
        settings=settings_text(table2, settings),
        counts=", ".join(map(str, PAPER_COUNTS)),
        cell_tables="\n\n".join(cell_table(table2, problem) for problem in TITLES),
        curve_trials=section5["settings"]["trials"],
        curves="\n\n".join(curve_table(section5, problem, curve) for problem in TITLES for curve in CURVES),
    )


def markdown(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table whose columns, but for the first, are set to the right."""
    names = list(header)
    lines = [names, ["---", *["---:"] * (len(names) - 1)], *map(list, rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def difference(table2: Report, problem: str, m: int, rule: str) -> float:
    """Ours less the paper's."""
    return round(table2[problem][str(m)][rule] - PAPER[problem][m][rule], 4)


def differences(table2: Report) -> Iterable[tuple[str, int, str, float]]:
    """The entries that differ by more than allowed."""
    for problem in PAPER:
        for m in PAPER_COUNTS:
            for rule in RULES[:-1]:
                value = difference(table2, problem, m, rule)
                if abs(value) > MOST:
                    yield problem, m, rule, value


def averages(table2: Report, problem: str) -> str:
    """Table 2 for one problem."""

    def cells(rule: str) -> Iterable[str]:
        for m in PAPER_COUNTS:
            yield f"{table2[problem][str(m)][rule]:.2f}"
            if rule in PAPER[problem][m]:
                value = difference(table2, problem, m, rule)
                yield f"{PAPER[problem][m][rule]:.2f}"
                yield f"**{value:+.2f}**" if abs(value) > MOST else f"{value:+.2f}"
            else:
                yield from ("", "")

    header = [TITLES[problem], *(name for m in PAPER_COUNTS for name in (f"m = {m}", "paper", "diff."))]
    return markdown(header, ([rule, *cells(rule)] for rule in RULES))


def cell_table(table2: Report, problem: str) -> str:
    """Some rules in each cell of one problem."""
    shown = ("ideal", "fixed", "most_inliers", "minimum_mean", "tlp_0.1", "refined")
    rows = (
        [
            f"noise {cell['noise']:g}, outliers {100 * cell['outlier_ratio']:.4g} %",
            *(" ".join(f"{cell['accuracy'][str(m)][rule]:.2f}" for m in PAPER_COUNTS) for rule in shown),
        ]
        for cell in table2["cells"]
        if cell["problem"] == problem
    )
    return markdown([TITLES[problem], *shown], rows)


CURVES = {"samples": "m", "sample_size": "N"}


def curve_table(section5: Report, problem: str, curve: str) -> str:
    """One curve of Section 5, with the time of the hypotheses."""
    values, seconds = section5[problem][curve], section5["seconds"][problem][curve]
    shown = ("ideal", "fixed", "most_inliers", "minimum_mean", "tlp_0.1", "refined")
    rows = ([rule, *(f"{accuracy[rule]:.2f}" for accuracy in values.values())] for rule in shown)
    times = ["seconds for the hypotheses", *(f"{seconds[size]['hypotheses']:.2g}" for size in values)]
    return markdown([f"{TITLES[problem]}, {CURVES[curve]} =", *values], [*rows, times])


def conclusions(table2: Report) -> str:
    """The claims of Sec. 4 on the averages, each with the figures for and against it."""
    columns = [(problem, m) for problem in TITLES for m in PAPER_COUNTS]
    rules = [rule for rule in RULES if rule not in ("ideal", "refined")]

    def ours(rule: str) -> list[float]:
        return [table2[problem][str(m)][rule] for problem, m in columns]

    best = [max(values) for values in zip(*map(ours, rules), strict=True)]
    names = [max(rules, key=lambda rule: table2[problem][str(m)][rule]) for problem, m in columns]
    gaps = {
        rule: [top - value for top, value in zip(best, ours(rule), strict=True)]
        for rule in ("tlp_0.1", "tlp_0.2", "tlp_0.3", "tlp_0.5")
    }
    rows = [
        ["best rule but ideal", *(f"{name} {value:.3f}" for name, value in zip(names, best, strict=True))],
        *([f"{rule}: less by", *(f"{gap:.3f}" for gap in values)] for rule, values in gaps.items()),
    ]
    header = ["", *(f"{TITLES[problem]}, {m}" for problem, m in columns)]
    return "\n".join(
        [
            claim(
                "TLP with p from 0.1 to 0.5 is the best rule, or within 0.02 of it, in all nine columns",
                max(map(max, gaps.values())) <= 0.02,
                f"the largest gap is {max(map(max, gaps.values())):.3f}",
            ),
            claim(
                "The minimum mean, median and upper quartile collapse on PnP and registration",
                all(collapses(table2, p, r) for p in ("absolute-pose", "registration") for r in MINIMA),
                "; ".join(
                    f"{TITLES[p]}: {', '.join(triple(table2, p, r) for r in MINIMA)} "
                    f"beside {triple(table2, p, 'most_inliers')}"
                    for p in ("absolute-pose", "registration")
                ),
            ),
            claim(
                "Reusing one fixed sample collapses on registration",
                collapses(table2, "registration", "fixed"),
                f"{triple(table2, 'registration', 'fixed')} beside {triple(table2, 'registration', 'most_inliers')}; "
                f"elsewhere it holds up: PnP {triple(table2, 'absolute-pose', 'fixed')}",
            ),
            "",
            markdown(header, rows),
        ]
    )


MINIMA = ("minimum_mean", "minimum_median", "minimum_q3")


def collapses(table2: Report, problem: str, rule: str) -> bool:
    """Whether a rule is behind the inlier count by 0.1 and more for every m."""
    return all(table2[problem][str(m)]["most_inliers"] - table2[problem][str(m)][rule] >= 0.1 for m in PAPER_COUNTS)


def triple(table2: Report, problem: str, rule: str) -> str:
    """A rule with its averages for all m."""
    return f"{rule} {' '.join(f'{table2[problem][str(m)][rule]:.2f}' for m in PAPER_COUNTS)}"


def claim(text: str, holds: bool, figures: str) -> str:
    """One line of the list."""
    return f"- {text}: **{'holds' if holds else 'refuted'}** ({figures})."
