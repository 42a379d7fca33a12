"""Pieces of pictures for studies with many trials: heat maps, curves, boxes, reliability. Drawn into axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.plot.figures import BLUE, INK, ORANGE, only_ticks, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["PALE", "against_time", "curves", "heat_map", "percentile_boxes", "reliability"]

Colour = NDArray[np.float64] | str

PALE = "#cccccc"
_LEAST, _LARGEST = 0.01, 180.0
_TICKS = (0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 90)


def heat_map(axes: Axes, values: ArrayLike, rows: Sequence[str], columns: Sequence[str]) -> None:
    """Draw numbers from 0 to 1 as coloured cells, each with its number in it.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    values : (rows, columns) array_like
        NaN leaves a cell empty.
    rows, columns : sequence of str
        Their names.
    """
    numbers = np.asarray(values, dtype=np.float64)
    axes.imshow(numbers, cmap="viridis", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, j), number in np.ndenumerate(numbers):
        if np.isfinite(number):
            colour = "white" if number < 0.6 else "black"
            axes.text(j, i, f"{number:.2f}", ha="center", va="center", color=colour, fontsize=9)
    axes.set_xticks(range(len(columns)), columns, fontsize=9)
    axes.set_yticks(range(len(rows)), rows, fontsize=9)
    axes.tick_params(colors=INK, length=0)
    axes.xaxis.tick_top()
    axes.spines[:].set_visible(False)


def curves(axes: Axes, places: Sequence[float], series: Mapping[str, ArrayLike], colours: Mapping[str, Colour]) -> None:
    """Draw values from 0 to 1 over a logarithmic axis: a few series in colour and named, the others pale.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    places : sequence of float
    series : dict of array_like
        For each name one value for each place.
    colours : dict
        Of the series to emphasise, by name.
    """
    for name, values in series.items():
        if name not in colours:
            axes.plot(places, np.asarray(values), color=PALE, linewidth=0.9, zorder=1)
    for name, colour in colours.items():
        if name in series:
            axes.plot(places, np.asarray(series[name]), "o-", color=colour, linewidth=1.8, markersize=4, label=name)
    axes.set_xscale("log")
    only_ticks(axes, "x", places)
    axes.set_ylim(-0.02, 1.02)
    plain_axes(axes)


def percentile_boxes(axes: Axes, boxes: Mapping[str, Sequence[float]], emphasised: Sequence[str] = ()) -> None:
    """Draw horizontal boxes of rotation errors from their 5th, 25th, 50th, 75th and 95th percentile, in degrees.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    boxes : dict of sequence of float
        From top to bottom.
    emphasised : sequence of str
        Names of boxes in another colour.
    """
    for place, (name, percentiles) in enumerate(boxes.items()):
        low, first, median, third, high = np.clip(percentiles, _LEAST, _LARGEST)
        pale = tuple(0.55 * (ORANGE if name in emphasised else BLUE) + 0.45)
        axes.hlines(place, low, high, color="#888888", linewidth=1.2)
        axes.vlines([low, high], place - 0.15, place + 0.15, color="#888888", linewidth=1.2)
        axes.barh(place, third - first, 0.6, left=first, color=pale, edgecolor="#666666", zorder=3)
        axes.vlines(median, place - 0.3, place + 0.3, color=INK, linewidth=1.8, zorder=4)
    axes.set_xscale("log")
    only_ticks(axes, "x", _TICKS)
    axes.set_xlim(_LEAST / 1.2, _LARGEST * 1.2)
    axes.set_yticks(range(len(boxes)), list(boxes), fontsize=9)
    axes.set_ylim(len(boxes) - 0.4, -0.6)
    plain_axes(axes)


def against_time(
    axes: Axes, points: Mapping[str, Sequence[tuple[float, float, str]]], colours: Mapping[str, Colour]
) -> None:
    """Draw errors in degrees against seconds, both logarithmic; the points of one method are joined.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    points : dict of sequence of (seconds, error, label)
    colours : dict
        For each method.
    """
    for name, found in points.items():
        colour = colours[name]
        seconds, errors, labels = zip(*found, strict=True)
        axes.plot(seconds, errors, "o-", color=colour, linewidth=1.8, markersize=5, label=name)
        for place, label in zip(zip(seconds, errors, strict=True), labels, strict=True):
            axes.annotate(label, place, (0, 6), textcoords="offset points", ha="center", fontsize=8, color=colour)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(0.08, 0.12)
    only_ticks(axes, "x", _ticks_between(axes.get_xlim()))
    only_ticks(axes, "y", _ticks_between(axes.get_ylim()))
    plain_axes(axes)


def reliability(
    axes: Axes, edges: Sequence[float], bins: Sequence[tuple[int, float, float, float, float]], colour: Colour
) -> None:
    """Draw how often answers are right, by their confidence; the bins are equally wide, and counts stand above them.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    edges : sequence of float
        Confidences between the bins, and at both ends.
    bins : sequence of (count, confidence, share, low, high)
        Answers in the bin, their mean confidence, the share of right ones and an interval of it. Bins without any
        answer stay empty.
    colour : colour
        Of the shares.
    """
    for place, (count, confidence, share, low, high) in enumerate(bins):
        if count:
            axes.hlines(confidence, place - 0.5, place + 0.5, color="#999999", linewidth=1.6, zorder=2)
            axes.vlines(place, low, high, color=colour, linewidth=1.6, zorder=3)
            axes.plot([place], [share], "o", color=colour, markersize=6, zorder=4)
            axes.annotate(
                f"{count:,}", (place, 1.0), (0, 10), textcoords="offset points", ha="center", fontsize=8, color=INK
            )
    axes.set_xlim(-0.5, len(bins) - 0.5)
    axes.set_ylim(-0.04, 1.04)
    axes.set_xticks(np.arange(len(edges)) - 0.5, [f"{edge:g}" for edge in edges], fontsize=8)
    plain_axes(axes)


def _ticks_between(limits: tuple[float, float]) -> list[float]:
    """Round numbers between the limits: 1, 2 and 5 times powers of ten, and more of them if these are too few."""
    for digits in ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9), np.arange(10, 100) / 10, np.arange(100, 1000) / 100):
        ticks = [float(digit) * 10.0**power for power in range(-5, 4) for digit in digits]
        visible = [tick for tick in ticks if limits[0] <= tick <= limits[1]]
        if len(visible) >= 3:
            break
    return visible
