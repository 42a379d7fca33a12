"""Pictures of the reports of Table 2 and Section 5."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from nonsac.plot import picture_suffix
from nonsac.plot.figures import BLUE, INK, ORANGE, new_figure, write
from nonsac.plot.studies import Colour, against_time, curves, heat_map, percentile_boxes
from nonsac.reproduce.cells import RULES, SHOWN_RULES
from nonsac.reproduce.experiments import EXPERIMENTS
from nonsac.reproduce.table2 import PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

__all__ = ["accuracy_curves", "error_against_time", "error_boxes", "heat_maps", "section5", "table2"]

Report = Mapping[str, Any]
Path = str | os.PathLike[str]

# Okabe and Ito, without the yellow, which is too pale for a line; a rule has one colour in all pictures.
_COLOURS: dict[str, Colour] = dict(zip(SHOWN_RULES, (INK, "#56b4e9", BLUE, "#cc79a7", "#009e73", ORANGE), strict=True))


def heat_maps(path: Path, report: Report) -> None:
    """Table 2 as a heat map for each problem: our mAA, and beside it the paper's."""
    _write(path, report, _heat_maps, 7.5)


def accuracy_curves(path: Path, report: Report) -> None:
    """mAA against the number of samples, for each problem; a few rules in colour, all others pale."""
    _write(path, report, _accuracy_curves, 4.5)


def error_boxes(path: Path, report: Report) -> None:
    """Box plots of all rotation errors by rule, for each problem, with the most samples."""
    _write(path, report, _error_boxes, 7.0)


def error_against_time(path: Path, report: Report) -> None:
    """The error that three quarters of the trials stay below against the time of a trial, for each m."""
    _write(path, report, _error_against_time, 4.5)


def table2(path: Path, report: Report) -> None:
    """The four pictures above in one.

    Parameters
    ----------
    path : path-like
        The picture to write: .png, .pdf or .svg.
    report : dict
        Of `nonsac.reproduce.table2.run`, with any of the problems.

    Raises
    ------
    ValueError
        If the suffix is not one of the above.
    """
    suffix = picture_suffix(path)
    heights = (7.5, 4.5, 7.0, 4.5)
    figure = new_figure(_width(report), sum(heights))
    drawers = (_heat_maps, _accuracy_curves, _error_boxes, _error_against_time)
    parts = np.asarray(figure.subfigures(len(heights), 1, height_ratios=heights))
    for part, draw in zip(parts, drawers, strict=True):
        draw(part, report)
    write(path, figure, suffix)


def section5(path: Path, report: Report) -> None:
    """mAA against the number of samples and against their size, one row for each problem.

    Parameters
    ----------
    path : path-like
        The picture to write: .png, .pdf or .svg.
    report : dict
        Of `nonsac.reproduce.section5.run`, with any of the problems.

    Raises
    ------
    ValueError
        If the suffix is not one of the above.
    """
    suffix = picture_suffix(path)
    names = _problems(report)
    figure = new_figure(12.0, 3.6 * len(names) + 0.6)
    panels = figure.subplots(len(names), 2, squeeze=False)
    for name, row in zip(names, panels, strict=True):
        labels = ("number of samples, m", "size of a sample, N")
        for axes, curve, label in zip(row, ("samples", "sample_size"), labels, strict=True):
            _rule_curves(axes, report[name][curve])
            _title(axes, EXPERIMENTS[name].title)
            axes.set_xlabel(label, fontsize=10, color=INK)
    _legend(figure, panels[0, 0])
    figure.subplots_adjust(0.06, 0.6 / figure.get_figheight(), 0.98, 1 - 0.8 / figure.get_figheight(), 0.14, 0.45)
    write(path, figure, suffix)


def _write(path: Path, report: Report, draw: Callable[[Any, Report], None], height: float) -> None:
    suffix = picture_suffix(path)
    figure = new_figure(_width(report), height)
    draw(figure, report)
    write(path, figure, suffix)


def _heat_maps(figure: Figure | SubFigure, report: Report) -> None:
    panels = _panels(figure, report, left=0.115, bottom=0.02, top=0.9)
    for first, (name, axes) in zip((True, False, False), panels.items(), strict=False):
        counts = list(report[name])
        published = [m for m in counts if int(m) in PAPER[name]]
        columns = [f"m = {m}" for m in counts] + [f"paper {m}" for m in published]
        rows = [
            [report[name][m][rule] for m in counts] + [PAPER[name][int(m)].get(rule, float("nan")) for m in published]
            for rule in RULES
        ]
        heat_map(axes, rows, RULES if first else [""] * len(RULES), columns)
        axes.axvline(len(counts) - 0.5, color="white", linewidth=4)
        axes.set_title(EXPERIMENTS[name].title, fontsize=13, color=INK, pad=22)


def _accuracy_curves(figure: Figure | SubFigure, report: Report) -> None:
    panels = _panels(figure, report, left=0.05, bottom=0.12, top=0.8)
    for name, axes in panels.items():
        _rule_curves(axes, report[name])
        _title(axes, EXPERIMENTS[name].title)
        axes.set_xlabel("number of samples, m", fontsize=10, color=INK)
    next(iter(panels.values())).set_ylabel("mAA", fontsize=10, color=INK)
    _legend(figure, next(iter(panels.values())))


def _error_boxes(figure: Figure | SubFigure, report: Report) -> None:
    panels = _panels(figure, report, left=0.115, bottom=0.09, top=0.92)
    for first, (name, axes) in zip((True, False, False), panels.items(), strict=False):
        most = max(report[name], key=int)
        percentile_boxes(axes, report["percentiles"][name][most], ("refined",))
        _title(axes, f"{EXPERIMENTS[name].title}, m = {most}")
        axes.set_xlabel("rotation error in degrees", fontsize=10, color=INK)
        if not first:
            axes.set_yticklabels([])


def _error_against_time(figure: Figure | SubFigure, report: Report) -> None:
    panels = _panels(figure, report, left=0.05, bottom=0.12, top=0.8, gap=0.15)
    for name, axes in panels.items():
        against_time(axes, _points(report, name), _COLOURS)
        _title(axes, EXPERIMENTS[name].title)
        axes.set_xlabel("seconds for a trial, one process; m at the points", fontsize=10, color=INK)
    next(iter(panels.values())).set_ylabel("75th percentile of the error, degrees", fontsize=10, color=INK)
    _legend(figure, next(iter(panels.values())))


def _points(report: Report, name: str) -> dict[str, list[tuple[float, float, str]]]:
    """Seconds, error and m, for each method that takes a time of its own."""
    stages = {"tlp_0.1": "hypotheses", "ideal": "hypotheses", "fixed": "fixed", "refined": "refined"}
    return {
        rule: [(report["seconds"][name][m][stage], report["percentiles"][name][m][rule][3], m) for m in report[name]]
        for rule, stage in stages.items()
    }


def _rule_curves(axes: Axes, accuracies: Mapping[str, Mapping[str, float]]) -> None:
    places = [float(place) for place in accuracies]
    curves(axes, places, {rule: [a[rule] for a in accuracies.values()] for rule in RULES}, _COLOURS)


def _problems(report: Report) -> list[str]:
    return [name for name in EXPERIMENTS if name in report]


def _width(report: Report) -> float:
    return 1.5 + 4.5 * len(_problems(report))


def _panels(
    figure: Figure | SubFigure, report: Report, left: float, bottom: float, top: float, gap: float = 0.08
) -> dict[str, Axes]:
    """One for each problem, side by side; `left` is the margin if there are three."""
    names = _problems(report)
    row: Sequence[Axes] = figure.subplots(1, len(names), squeeze=False)[0]
    figure.subplots_adjust(left * 15.0 / _width(report), bottom, 0.985, top, gap)
    return dict(zip(names, row, strict=True))


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, loc="left", fontsize=12, color=INK)


def _legend(figure: Figure | SubFigure, axes: Axes) -> None:
    columns = 6 if figure.figure.get_figwidth() > 8 else 3
    figure.legend(*axes.get_legend_handles_labels(), loc="upper center", ncols=columns, frameon=False, fontsize=10)
