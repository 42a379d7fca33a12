"""Errors and times of many trials."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.plot.figures import BLUE, INK, ORANGE, new_figure, picture_suffix, write, write_text
from nonsac.values.checks import number, real_array
from nonsac.values.numeric import shown
from nonsac.values.quiet import quiet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]

_BEST, _WORST = 0.01, 180.0


@quiet
def boxplot(
    path: str | os.PathLike[str],
    errors: Mapping[str, ArrayLike],
    times: Mapping[str, ArrayLike],
    paper: Mapping[str, float] | None = None,
    label: str = "published in the paper",
) -> None:
    """Draw rotation errors for each rule, and processing times, as box plots (Fig. 2 of the paper).

    Boxes reach from the first to the third quartile, whiskers to the 5th and 95th percentile; both axes are
    logarithmic. A failed trial (NaN) counts as 180 degrees; errors below 0.01 degrees are drawn as 0.01.

    Parameters
    ----------
    path : path-like
        The picture to write: .png (2100 x 1200 pixels), .pdf or .svg.
    errors : dict of array_like
        Rotation errors in degrees of all trials, for each rule, in the order of the figure; numbered from 1.
        `refined` comes without a number, in a colour of its own.
    times : dict of array_like
        Seconds of all trials, for each stage.
    paper : dict of float, optional
        Published values to compare with, marked with a diamond; keys as in `errors` (degrees) or `times`
        (seconds).
    label : str
        What the diamonds are, for the legend.

    Raises
    ------
    ValueError
        If there is nothing to draw, `paper` has a key that the others lack, or the suffix is not one of the
        above.
    ImportError
        If matplotlib is missing.
    """
    suffix = picture_suffix(path)
    given = _mapping("paper", {} if paper is None else paper).items()
    published = {key: number(f"paper[{key!r}]", value, 0.0, 1e30, "a number of at least 0") for key, value in given}
    unknown = sorted(set(published) - set(_mapping("errors", errors)) - set(_mapping("times", times)))
    if unknown:
        raise ValueError(f"paper has the key {unknown[0]!r}; expected only keys of errors or times")
    angles = {rule: _drawable_angles(values) for rule, values in _samples("errors", errors)}
    seconds = {stage: np.maximum(values, 1e-4) for stage, values in _samples("times", times)}
    figure = new_figure(14.0, 8.0)
    left, right = figure.add_axes((0.06, 0.19, 0.64, 0.70)), figure.add_axes((0.77, 0.19, 0.21, 0.70))
    _boxes(left, angles, published, _numbered(list(angles)))
    _boxes(right, seconds, published, [name.replace("_", " ") for name in seconds])
    left.set_title("Rotation error", loc="left", color=INK, fontsize=15)
    right.set_title("Processing time", loc="left", color=INK, fontsize=15)
    _log_axis(left, "degrees", (0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 90, 180))
    _log_axis(right, "seconds", [digit * 10.0**power for power in range(-4, 5) for digit in (1, 3)])
    if published:
        write_text(figure, 0.98, 0.95, f"\N{BLACK DIAMOND} {label}", 12, ha="right")
    write(path, figure, suffix)


def _mapping(name: str, values: Mapping[str, Any]) -> Mapping[str, Any]:
    if not isinstance(values, Mapping) or not all(isinstance(key, str) for key in values):
        raise TypeError(f"{name} is {shown(values)}; expected a dict from names to numbers")
    return values


def _samples(name: str, values: Mapping[str, ArrayLike]) -> list[tuple[str, Floats]]:
    samples = [(key, real_array(f"{name}[{key!r}]", value).ravel()) for key, value in _mapping(name, values).items()]
    if not samples:
        raise ValueError(f"{name} is empty; expected at least one entry")
    for key, sample in samples:
        if not sample.size:
            raise ValueError(f"{name} has no numbers for {key!r}; expected one for each trial")
    return samples


def _drawable_angles(degrees: Floats) -> Floats:
    return np.clip(np.where(np.isnan(degrees), _WORST, degrees), _BEST, _WORST)


def _numbered(names: Sequence[str]) -> list[str]:
    numbers = iter(range(1, len(names) + 1))
    return [name if name == "refined" else f"{next(numbers)}  {name.replace('_', ' ')}" for name in names]


def _boxes(axes: Axes, samples: Mapping[str, Floats], published: Mapping[str, float], labels: list[str]) -> None:
    for place, (name, values) in enumerate(samples.items(), start=1):
        _box(axes, place, values, ORANGE if name == "refined" else BLUE)
        if name in published:
            axes.plot(place, published[name], "D", markersize=7, color=INK, zorder=5)
    axes.set_xlim(0.4, len(samples) + 0.6)
    slanted: dict[str, Any] = {"rotation": 40, "ha": "right", "rotation_mode": "anchor", "fontsize": 11}
    axes.set_xticks(range(1, len(labels) + 1), labels, **slanted)


def _box(axes: Axes, place: int, values: Floats, colour: Floats) -> None:
    """One box by hand: matplotlib's own imports pyplot and looks for a display."""
    low, first, median, third, high = np.percentile(values, [5, 25, 50, 75, 95])
    outside = values[(values < low) | (values > high)]
    axes.plot(np.full(len(outside), place), outside, ".", markersize=5, color="#aaaaaa", markeredgewidth=0)
    axes.vlines(place, low, high, color="#888888", linewidth=1.2)
    axes.hlines([low, high], place - 0.15, place + 0.15, color="#888888", linewidth=1.2)
    pale = tuple(0.55 * colour + 0.45)
    axes.bar(place, third - first, 0.6, bottom=first, color=pale, edgecolor="#666666", zorder=3)
    axes.hlines(median, place - 0.3, place + 0.3, color=INK, linewidth=1.8, zorder=4)


def _log_axis(axes: Axes, label: str, ticks: Sequence[float]) -> None:
    from matplotlib.ticker import NullLocator

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks], fontsize=11)
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylim(low, high)
    axes.set_ylabel(label, fontsize=13, color=INK)
    axes.grid(axis="y", color="#e5e5e5")
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, length=0)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#bbbbbb")
