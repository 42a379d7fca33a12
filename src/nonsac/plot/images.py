"""Matched points of images, and how well a pose explains them.

Points are in pixels (x to the right, y down, pixel centres at whole numbers), or normalised; of the latter, the
outline of the image is unknown, and the bounding box of the points stands in for it.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.plot.epipolar import clip, distances_from_lines, far_apart, homogeneous, places_and_lines
from nonsac.plot.figures import BLUE, INK, ORANGE, picture_suffix, write
from nonsac.plot.views import Image, Pair, View, new_page, read_mask, read_pair, read_points, read_view, side_by_side
from nonsac.values.checks import real_array
from nonsac.values.quiet import quiet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
Entries = Sequence[tuple[str, dict[str, Any]]]

_MOST_LINES, _MOST_RINGS = 500, 200
_CANDIDATES = 100
_RING: dict[str, Any] = {"marker": "o", "markersize": 7, "markerfacecolor": "none", "markeredgecolor": INK}
# Twelve that are told apart on white and on pale grey; numbers at the points help if that is not enough.
_COLOURS = (
    *("#0072B2", "#D55E00", "#009E73", "#AA4499", "#E69F00", "#56B4E9"),
    *("#882255", "#332288", "#999933", "#CC6677", "#117733", "#555555"),
)


@quiet
def matches(
    path: str | os.PathLike[str],
    points1: ArrayLike,
    points2: ArrayLike,
    inliers: ArrayLike,
    size1: ArrayLike | None = None,
    size2: ArrayLike | None = None,
    image1: Image | None = None,
    image2: Image | None = None,
    title: str | None = None,
) -> None:
    """Draw two images side by side, with a line from each point to the one it is matched with.

    Inliers are blue, outliers pale orange and beneath. All points are drawn, but lines for at most 500 matches,
    chosen at random from all of them. What is outside its image is left out, but counted; the legend says so.

    Parameters
    ----------
    path : path-like
        The picture to write: .png, .pdf or .svg; 14 inches wide at most.
    points1, points2 : array_like, shape (n, 2)
        Matched points, in pixels or normalised. Matches that are not finite are left out.
    inliers : array_like of bool, shape (n,)
    size1, size2 : array_like, shape (2,), optional
        Width and height of each image in pixels; those of the image by default. Without either, the bounding
        box of the points is drawn.
    image1, image2 : path-like or array_like, shape (h, w), (h, w, 3) or (h, w, 4), optional
        The images, drawn in pale grey, stretched to their size if that differs: files that matplotlib reads, or
        arrays of whole numbers or of floats from 0 to 1.
    title : str, optional

    Raises
    ------
    ValueError
        If a shape or the suffix of `path` is not one of the above, or no match is finite.
    ImportError
        If matplotlib is missing.
    """
    suffix = picture_suffix(path)
    pair = read_pair(points1, points2, inliers, (size1, size2), (image1, image2))
    figure, (axes,) = new_page(pair.views, 1, title)
    _draw_matches(axes, pair)
    write(path, figure, suffix)


@quiet
def epipolar_lines(
    path: str | os.PathLike[str],
    points1: ArrayLike,
    points2: ArrayLike,
    inliers: ArrayLike,
    F: ArrayLike,
    size1: ArrayLike | None = None,
    size2: ArrayLike | None = None,
    image1: Image | None = None,
    image2: Image | None = None,
    title: str | None = None,
) -> None:
    """Draw some inliers in both images, each with the epipolar line of its partner, which should pass through it.

    Of a hundred inliers, chosen at random, the twelve are shown whose places and lines are far from each other.
    The legend tells the median distance of all inliers from their lines. Lens distortion bends the lines, which
    is not drawn: undistort the points (and the images) first.

    Parameters
    ----------
    path : path-like
        The picture to write: .png, .pdf or .svg; 14 inches wide at most.
    points1, points2 : array_like, shape (n, 2)
        Matched points, in pixels or normalised. Matches that are not finite are left out.
    inliers : array_like of bool, shape (n,)
    F : array_like, shape (3, 3)
        Fundamental matrix in the unit of the points, ``x2.T @ F @ x1 = 0``; of normalised points, the essential
        matrix. If it is 0 or not finite (a failed estimation), the picture says so.
    size1, size2 : array_like, shape (2,), optional
        Width and height of each image in pixels, as for `matches`.
    image1, image2 : path-like or array_like, optional
        The images, as for `matches`.
    title : str, optional

    Raises
    ------
    ValueError
        If a shape or the suffix of `path` is not one of the above, or no match is finite.
    ImportError
        If matplotlib is missing.
    """
    suffix = picture_suffix(path)
    pair = read_pair(points1, points2, inliers, (size1, size2), (image1, image2))
    fundamental = _fundamental(F)
    figure, (axes,) = new_page(pair.views, 1, title)
    _draw_epipolar_lines(axes, pair, fundamental)
    write(path, figure, suffix)


@quiet
def two_views(
    path: str | os.PathLike[str],
    points1: ArrayLike,
    points2: ArrayLike,
    inliers: ArrayLike,
    F: ArrayLike,
    size1: ArrayLike | None = None,
    size2: ArrayLike | None = None,
    image1: Image | None = None,
    image2: Image | None = None,
    title: str | None = None,
) -> None:
    """Draw `matches` above `epipolar_lines`, in one picture.

    Parameters
    ----------
    path : path-like
        The picture to write: .png, .pdf or .svg; 14 inches wide at most.
    points1, points2 : array_like, shape (n, 2)
        Matched points, in pixels or normalised. Matches that are not finite are left out.
    inliers : array_like of bool, shape (n,)
    F : array_like, shape (3, 3)
        Fundamental matrix, as for `epipolar_lines`.
    size1, size2 : array_like, shape (2,), optional
        Width and height of each image in pixels, as for `matches`.
    image1, image2 : path-like or array_like, optional
        The images, as for `matches`.
    title : str, optional

    Raises
    ------
    ValueError
        If a shape or the suffix of `path` is not one of the above, or no match is finite.
    ImportError
        If matplotlib is missing.
    """
    suffix = picture_suffix(path)
    pair = read_pair(points1, points2, inliers, (size1, size2), (image1, image2))
    fundamental = _fundamental(F)
    figure, (upper, lower) = new_page(pair.views, 2, title)
    _draw_matches(upper, pair)
    _draw_epipolar_lines(lower, pair, fundamental)
    write(path, figure, suffix)


@quiet
def reprojections(
    path: str | os.PathLike[str],
    points2d: ArrayLike,
    projected: ArrayLike,
    inliers: ArrayLike,
    size: ArrayLike | None = None,
    image: Image | None = None,
    title: str | None = None,
) -> None:
    """Draw the points of an image (dots), and where a pose projects their 3D points (rings).

    A line joins the two for inliers; outliers are pale, and only the observed points. All observed points are
    drawn, but rings for at most 200 inliers, chosen at random. What is outside the image is left
    out, but counted. The legend says so, and tells the median distance of all inliers.

    Parameters
    ----------
    path : path-like
        The picture to write: .png, .pdf or .svg; 14 inches wide at most.
    points2d : array_like, shape (n, 2)
        Observed points, in pixels or normalised. Those that are not finite are left out.
    projected : array_like, shape (n, 2)
        Projections of the 3D points. Inliers whose projection is not finite are left out.
    inliers : array_like of bool, shape (n,)
    size : array_like, shape (2,), optional
        Width and height of the image in pixels, as for `matches`.
    image : path-like or array_like, optional
        The image, as for `matches`.
    title : str, optional

    Raises
    ------
    ValueError
        If a shape or the suffix of `path` is not one of the above, or no point is finite.
    ImportError
        If matplotlib is missing.
    """
    suffix = picture_suffix(path)
    observed = read_points("points2d", points2d)
    predicted, mask = read_points("projected", projected, len(observed)), read_mask(inliers, len(observed))
    kept = np.isfinite(observed).all(axis=1) & (np.isfinite(predicted).all(axis=1) | ~mask)
    if not kept.any():
        raise ValueError("points2d and projected have no finite row in common; expected at least one")
    views = side_by_side([read_view("size", size, "image", image, observed[kept])])
    figure, (axes,) = new_page(views, 1, title)
    _draw_reprojections(axes, views[0], observed[kept], predicted[kept], mask[kept])
    write(path, figure, suffix)


def _fundamental(F: ArrayLike) -> Floats:
    matrix = real_array("F", F)
    if matrix.shape != (3, 3):
        raise ValueError(f"F has shape {matrix.shape}; expected (3, 3)")
    size = np.abs(matrix).max()  # NaN for a pose that failed
    return matrix / size if 0.0 < size < np.inf else matrix


# --- what is drawn -------------------------------------------------------


def _draw_matches(axes: Axes, pair: Pair) -> None:
    total, inside = len(pair.inliers), pair.inside
    lined = np.zeros(total, dtype=np.bool_)
    lined[_few(np.flatnonzero(inside), _MOST_LINES)] = True
    places = [view.on_page(points) for view, points in zip(pair.views, pair.points, strict=True)]
    crowd = max(int(np.count_nonzero(lined & ~pair.inliers)), 1)
    for chosen, colour, zorder, width, alpha in (
        (~pair.inliers, ORANGE, 2, 0.6, float(np.clip(100 / crowd, 0.35, 0.7))),
        (pair.inliers, BLUE, 4, 0.9, 0.6),
    ):
        for place in places:
            _dots(axes, place[chosen & inside], colour, total, zorder, 0.9)
        first, second = (place[chosen & lined] for place in places)
        _segments(axes, first, second, zorder + 1, color=colour, linewidth=width, alpha=alpha)
    _name_images(axes, pair.views)
    few = f"lines for {_MOST_LINES} matches, chosen at random" if inside.sum() > _MOST_LINES else ""
    _write_legend(axes, pair.views[0], _match_legend(pair.inliers), few, _outside(inside, "match", "matches"))


def _match_legend(inliers: NDArray[np.bool_]) -> Entries:
    found = int(inliers.sum())
    dot: dict[str, Any] = {"marker": "o", "markersize": 5}
    return [
        (_number(found, "inlier"), {**dot, "color": BLUE}),
        (_number(len(inliers) - found, "outlier"), {**dot, "color": ORANGE, "linewidth": 0.8}),
    ]


def _draw_epipolar_lines(axes: Axes, pair: Pair, F: Floats) -> None:
    _name_images(axes, pair.views)
    if not np.isfinite(F).all() or not F.any():
        return _excuse(axes, pair.views, "no trusted pose")
    first, second = (points[pair.inliers] for points in pair.points)
    drawable = np.flatnonzero(pair.inside[pair.inliers])
    if not len(drawable):
        return _excuse(axes, pair.views, "no inliers in the images" if len(first) else "no inliers")
    lines1, lines2 = homogeneous(second) @ F, homogeneous(first) @ F.T
    some = _few(drawable, _CANDIDATES)
    rows = some[far_apart(places_and_lines(first[some], lines1[some], pair.views[0]), len(_COLOURS))]
    _draw_pencil(axes, pair.views[0], first[rows], lines1[rows])
    _draw_pencil(axes, pair.views[1], second[rows], lines2[rows])
    shown = f"{len(rows)} of {_number(len(first), 'inlier')}, each with the epipolar line of its partner"
    middle = np.median([distances_from_lines(first, lines1), distances_from_lines(second, lines2)])
    note = f"median distance of all inliers from their lines: {middle:.2g}{pair.views[0].unit}"
    _write_legend(axes, pair.views[0], [(shown, {"color": INK, "marker": "o", "markersize": 5})], note)


def _draw_pencil(axes: Axes, view: View, points: Floats, lines: Floats) -> None:
    for number, end in enumerate(view.on_page(clip(lines, view))):
        _segments(axes, end[:1], end[1:], 3, color=_COLOURS[number], linewidth=1.4)
        _numbered_dot(axes, view, points[number], lines[number, :2], number)


def _excuse(axes: Axes, views: Sequence[View], text: str) -> None:
    x, y = (views[0].left + views[-1].left + views[-1].width) / 2, views[0].height / 2
    look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 24, "color": "#777777"}
    axes.text(x, y, text, bbox={"facecolor": "white", "edgecolor": "none"}, **look)


def _numbered_dot(axes: Axes, view: View, point: Floats, normal: Floats, number: int) -> None:
    from matplotlib.patheffects import withStroke

    place, colour = view.on_page(point), _COLOURS[number]
    axes.plot(*place, "o", markersize=6.5, color=colour, markeredgecolor="white", zorder=4)
    # The number stands beside the line, on the side of the middle, where there is room for it.
    aside = 0.14 * normal / max(float(np.linalg.norm(normal)), 1e-300)
    inwards = view.corner + view.size / 2 - point
    x, y = place + (aside if aside @ inwards >= 0 else -aside)
    look: dict[str, Any] = {"fontsize": 10, "color": colour, "ha": "center", "va": "center", "zorder": 5}
    axes.text(x, y, str(number + 1), path_effects=[withStroke(linewidth=3, foreground="white")], **look)


def _draw_reprojections(
    axes: Axes, view: View, observed: Floats, projected: Floats, inliers: NDArray[np.bool_]
) -> None:
    seen, expected, inside = view.on_page(observed), view.on_page(projected), view.holds(observed)
    ringed = _few(np.flatnonzero(inliers & inside), _MOST_RINGS)
    _dots(axes, seen[~inliers & inside], ORANGE, len(seen), 2, 0.55)
    _dots(axes, seen[inliers & inside], BLUE, len(seen), 3, 0.9)
    _segments(axes, seen[ringed], expected[ringed], 4, color=INK, linewidth=0.9)
    _dots(axes, seen[ringed], BLUE, len(ringed), 5, 1.0)
    axes.plot(expected[ringed, 0], expected[ringed, 1], linestyle="none", zorder=6, **_RING)
    few = f"rings for {_MOST_RINGS} inliers, chosen at random" if (inliers & inside).sum() > _MOST_RINGS else ""
    distances = np.linalg.norm((observed - projected)[inliers], axis=1)
    middle = f"median distance of all inliers: {np.median(distances):.2g}{view.unit}" if len(distances) else ""
    _write_legend(axes, view, _reprojection_legend(inliers), few, middle, _outside(inside, "point", "points"))


def _reprojection_legend(inliers: NDArray[np.bool_]) -> Entries:
    found = int(inliers.sum())
    dot: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 5}
    return [
        (_number(found, "inlier"), {**dot, "color": BLUE}),
        ("projected", {**dot, **_RING}),
        (_number(len(inliers) - found, "outlier"), {**dot, "color": ORANGE}),
    ]


# --- marks ---------------------------------------------------------------


def _name_images(axes: Axes, views: Sequence[View]) -> None:
    for number, view in enumerate(views, start=1):
        axes.text(view.left, -0.1, f"image {number}", fontsize=11, color="#777777")


def _write_legend(axes: Axes, view: View, entries: Entries, *notes: str) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], label=label, **look) for label, look in entries]
    where = (view.left, view.height + 0.08)
    look: dict[str, Any] = {"frameon": False, "borderaxespad": 0.0, "borderpad": 0.2, "columnspacing": 1.6}
    look |= {"bbox_to_anchor": where, "bbox_transform": axes.transData, "labelcolor": INK, "fontsize": 11}
    axes.legend(handles=handles, loc="upper left", ncols=len(handles), **look)
    axes.text(view.left + 0.03, view.height + 0.52, ";  ".join(filter(None, notes)), fontsize=11, color="#777777")


def _dots(axes: Axes, places: Floats, colour: Any, total: int, zorder: int, alpha: float) -> None:
    crowding = np.sqrt(max(total, 1))
    size = float(np.clip(80.0 / crowding, 1.5, 5.0))
    alpha *= float(np.clip(100.0 / crowding, 0.12, 1.0))  # a million shows as a density
    look: dict[str, Any] = {"markersize": size, "markeredgewidth": 0, "rasterized": True}
    axes.plot(places[:, 0], places[:, 1], "o", color=colour, zorder=zorder, alpha=alpha, **look)


def _segments(axes: Axes, starts: Floats, ends: Floats, zorder: int, **look: Any) -> None:
    from matplotlib.collections import LineCollection

    segments = list(np.stack([starts, ends], axis=1))
    axes.add_collection(LineCollection(segments, zorder=zorder, **look), autolim=False)


def _few(rows: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    if len(rows) <= most:
        return rows
    return np.sort(np.random.default_rng(0).choice(rows, most, replace=False))


def _outside(inside: NDArray[np.bool_], one: str, many: str) -> str:
    count = int(np.count_nonzero(~inside))
    return f"{count:,} {one if count == 1 else many} outside, not drawn" if count else ""


def _number(count: int, what: str) -> str:
    return f"{count:,} {what}" if count == 1 else f"{count:,} {what}s"
