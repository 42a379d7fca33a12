"""How good methods are, and how long they take."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from nonsac.plot.figures import BLUE, INK, ORANGE, new_figure, picture_suffix, write
from nonsac.values.checks import listed, real_array

_ROOM = ((0, 9), (0, -16), (0, 22), (0, -29), (0, 35), (0, -42), (0, 48), (0, -55))  # where a name may stand, in points
_LETTER, _LINE, _SHORTEST = 5.2, 11.0, 1e-4
_LONGEST_NAME = 28
_DECADES = 1e3


def comparison(
    path: str | os.PathLike[str],
    names: Sequence[str],
    kinds: Sequence[str],
    seconds: ArrayLike,
    values: ArrayLike,
    best: int | None = None,
    label: str = "accuracy",
    title: str = "",
) -> None:
    """Draw how good methods are against the time they take, which has a logarithmic axis.

    Parameters
    ----------
    path : path-like
        The picture to write: .png, .pdf or .svg.
    names : sequence of str, length n
        Points of one name are joined.
    kinds : sequence of str, length n
        Each kind has a marker, and its place in the legend.
    seconds, values : array_like, shape (n,)
        Points that are not finite are left out.
    best : int, optional
        Which of them is emphasised.
    label, title : str
        What the values are, and what was compared.

    Raises
    ------
    ValueError, TypeError
        If the lengths differ, a number is none, or the suffix is another.
    """
    suffix = picture_suffix(path)
    called, sorts = _strings("names", names), _strings("kinds", kinds)
    times, heights = real_array("seconds", seconds), real_array("values", values)
    if not len(called) == len(sorts) == times.size == heights.size or times.ndim != 1 or heights.ndim != 1:
        counts = f"{len(called)}, {len(sorts)}, {times.size} and {heights.size}"
        raise ValueError(f"names, kinds, seconds and values have {counts} entries")
    if best is not None and not (isinstance(best, int) and 0 <= best < len(called)):
        raise ValueError(f"best must be a number from 0 to {len(called) - 1}, or None, got {best!r}")
    drawn = np.flatnonzero(np.isfinite(times) & np.isfinite(heights) & (times >= 0.0))
    times = np.clip(times, _SHORTEST, 1e9)
    figure = new_figure(9.0, 5.6)
    axes = figure.add_axes((0.09, 0.12, 0.87, 0.75))
    for name in dict.fromkeys(called[k] for k in drawn):
        same = [k for k in drawn if called[k] == name]
        axes.plot(times[same], heights[same], color="#cccccc", linewidth=1.0, zorder=1)
    markers = dict(zip(dict.fromkeys(sorts), "osD^vPX*<>hd", strict=False))
    for kind, marker in markers.items():
        some = [k for k in drawn if sorts[k] == kind]
        axes.plot(times[some], heights[some], marker, color=BLUE, markersize=6, label=kind, linestyle="", zorder=3)
    if best is not None and best in drawn:
        look: dict[str, Any] = {"markersize": 15, "markerfacecolor": "none", "markeredgewidth": 2.2}
        axes.plot(times[best], heights[best], "o", color=ORANGE, label="recommended", linestyle="", zorder=4, **look)
    _frame(axes, times[drawn], heights[drawn], label, title)
    _write_names(axes, [(called[k], times[k], heights[k], k == best) for k in drawn])
    write(path, figure, suffix)


def _strings(name: str, values: Any) -> list[str]:
    given = listed(name, values, "words")
    if not all(isinstance(value, str) for value in given):
        raise TypeError(f"{name} must hold words, strings all of them")
    return given


def _frame(axes: Any, times: Any, heights: Any, label: str, title: str) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes.set_xscale("log")
    if len(times):
        axes.set_xlim(times.min() / 2.0, times.max() * 2.0)
        many = times.max() > _DECADES * times.min()
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if many else (1.0, 2.0, 5.0), numticks=99))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda tick, _: f"{1e3 * tick:g} ms" if tick < 1.0 else f"{tick:g} s"))
    highest, lowest = float(heights.max(initial=0.0)) or 1.0, float(heights.min(initial=0.0))
    axes.set_ylim(min(-0.25 * highest, lowest), 1.25 * highest)  # names stand above and beneath
    axes.set_yticks([tick for tick in axes.get_yticks() if lowest <= tick <= 1.01 * highest])
    axes.set_xlabel("CPU time", color=INK)
    axes.set_ylabel(label, color=INK, parse_math=False)
    axes.figure.text(0.09, 0.95, title, color=INK, fontsize=11, parse_math=False)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=INK)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, fontsize=9, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=6)


def _write_names(axes: Any, points: Sequence[tuple[str, float, float, bool]]) -> None:
    """The name of each point once, the emphasised one first, where it covers no other name if there is such a place."""
    scale = 72.0 / axes.figure.dpi
    taken: list[tuple[float, float, float]] = []
    for name, seconds, value, is_best in sorted(points, key=lambda point: not point[3]):
        short = name if len(name) <= _LONGEST_NAME else name[: _LONGEST_NAME - 3] + "..."
        x, y = scale * axes.transData.transform((seconds, value))
        half = 0.5 * _LETTER * len(short)
        free = [(dx, dy) for dx, dy in _ROOM if not _covers(taken, x + dx, y + dy, half)]
        dx, dy = free[0] if free else _ROOM[0]
        taken.append((x + dx, y + dy, half))
        look: dict[str, Any] = {"ha": "center", "fontsize": 8, "weight": "bold" if is_best else "normal"}
        axes.annotate(
            short, (seconds, value), (dx, dy), textcoords="offset points", color=INK, parse_math=False, **look
        )


def _covers(taken: Sequence[tuple[float, float, float]], x: float, y: float, half: float) -> bool:
    return any(abs(x - u) < half + other and abs(y - v) < _LINE for u, v, other in taken)
