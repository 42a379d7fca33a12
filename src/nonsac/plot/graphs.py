"""Which images are matched with which."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from nonsac.plot.figures import BLUE, INK, ORANGE, new_figure, picture_suffix, write, write_text
from nonsac.values.checks import listed, real_array

_MOST_NAMES, _LONGEST_NAME = 40, 24


def match_graph(
    path: str | os.PathLike[str], images1: Sequence[str], images2: Sequence[str], inliers: ArrayLike
) -> None:
    """Draw images on a circle, in the order of their names, with a line for each pair.

    Pairs with inliers are blue, and the darker the more they have; those without are pale orange, and beneath. The
    title says in how many parts the images fall that no kept pair connects.

    Parameters
    ----------
    path : path-like
        The picture to write: .png, .pdf or .svg.
    images1, images2 : sequence of str, length n
        The images of each pair.
    inliers : array_like, shape (n,)
        How many matches each pair keeps; 0 leaves it out.

    Raises
    ------
    ValueError, TypeError
        If the lengths differ, or the suffix is another.
    """
    suffix = picture_suffix(path)
    first, second = listed("images1", images1, "names of images"), listed("images2", images2, "names of images")
    for given, values in (("images1", first), ("images2", second)):
        if not all(isinstance(value, str) for value in values):
            raise TypeError(f"{given} must hold names of images, strings all of them")
    counts = real_array("inliers", inliers)
    if not len(first) == len(second) == counts.size or counts.ndim != 1:
        raise ValueError(f"images1, images2 and inliers have {len(first)}, {len(second)} and {counts.size} entries")
    names = sorted({*first, *second})
    place = {name: k for k, name in enumerate(names)}
    ends = np.array([[place[a], place[b]] for a, b in zip(first, second, strict=True)], np.int64).reshape(-1, 2)
    angles = 2.0 * np.pi * np.arange(len(names)) / max(len(names), 1)
    dots = np.column_stack([np.sin(angles), np.cos(angles)])
    figure = new_figure(8.0, 8.4)
    axes = figure.add_axes((0.12, 0.1, 0.76, 0.76 * 8.0 / 8.4), aspect="equal")
    axes.set_axis_off()
    _draw_lines(axes, dots, ends, counts)
    axes.plot(*dots.T, "o", color=INK, markersize=4, zorder=3)
    if len(names) <= _MOST_NAMES:
        _draw_names(axes, names, dots)
    kept = counts > 0
    parts = _parts(len(names), ends[kept])
    title = f"{len(names):,} images in {parts:,} {'part' if parts == 1 else 'parts'}"
    write_text(figure, 0.5, 0.965, title, 14)
    write_text(figure, 0.5, 0.93, f"{kept.sum():,} pairs kept", 11, color=BLUE)
    write_text(figure, 0.5, 0.905, f"{(~kept).sum():,} left out", 11, color=0.8 * ORANGE)
    write(path, figure, suffix)


def _draw_lines(axes: Any, dots: Any, ends: Any, counts: Any) -> None:
    from matplotlib.collections import LineCollection

    kept = counts > 0
    axes.add_collection(LineCollection(dots[ends[~kept]], colors=[(*ORANGE, 0.25)], linewidths=0.6, zorder=1))
    order = np.argsort(counts[kept], kind="stable")
    opacity = 0.15 + 0.75 * counts[kept][order] / max(counts.max(initial=1.0), 1.0)
    colours = np.column_stack([np.tile(BLUE, (len(opacity), 1)), opacity])
    axes.add_collection(LineCollection(dots[ends[kept]][order], colors=colours, linewidths=1.0, zorder=2))


def _draw_names(axes: Any, names: list[str], dots: Any) -> None:
    for name, (x, y) in zip(names, dots, strict=True):
        short = name if len(name) <= _LONGEST_NAME else "..." + name[-_LONGEST_NAME:]
        turn, side = np.degrees(np.arctan2(y, x)), "left"
        if abs(turn) > 90.0:
            turn, side = turn - 180.0, "right"
        look = {"ha": side, "va": "center", "rotation": turn, "rotation_mode": "anchor", "fontsize": 7, "color": INK}
        axes.text(1.04 * x, 1.04 * y, short, clip_on=False, parse_math=False, **look)


def _parts(images: int, ends: Any) -> int:
    """How many connected parts a graph has."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not images:
        return 0
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(images, images))
    return int(connected_components(graph, directed=False)[0])
