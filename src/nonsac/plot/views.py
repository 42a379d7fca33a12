"""Images side by side on a page, and the points in them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.plot.figures import new_figure, write_text
from nonsac.values.arraylike import as_array
from nonsac.values.checks import file_name, real_array
from nonsac.values.numeric import shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
Image = str | os.PathLike[str] | ArrayLike

# Inches. A row of the page is a label, the images and a legend.
_WIDTH, _NARROWEST, _TALLEST = 14.0, 10.0, 8.0
_MARGIN, _GAP, _LABEL, _LEGEND, _TITLE = 0.3, 0.25, 0.32, 0.75, 0.6


@dataclass(frozen=True, eq=False)
class View:
    """An image: its upper left corner and its size in the unit of the points, its place on the page in inches."""

    corner: Floats
    size: Floats
    pixels: Floats | None
    unit: str
    left: float = 0.0
    scale: float = 1.0

    @property
    def width(self) -> float:
        return float(self.size[0]) * self.scale

    @property
    def height(self) -> float:
        return float(self.size[1]) * self.scale

    def holds(self, points: Floats) -> NDArray[np.bool_]:
        return np.asarray(((points >= self.corner) & (points <= self.corner + self.size)).all(axis=1))

    def on_page(self, points: Floats) -> Floats:
        return np.asarray((points - self.corner) * self.scale + [self.left, 0.0])


@dataclass(frozen=True, eq=False)
class Pair:
    """Matches that are finite, and their two images on the page."""

    points: tuple[Floats, Floats]
    inliers: NDArray[np.bool_]
    views: Sequence[View]

    @property
    def inside(self) -> NDArray[np.bool_]:
        return self.views[0].holds(self.points[0]) & self.views[1].holds(self.points[1])


def read_pair(
    points1: ArrayLike,
    points2: ArrayLike,
    inliers: ArrayLike,
    sizes: tuple[ArrayLike | None, ArrayLike | None],
    images: tuple[Image | None, Image | None],
) -> Pair:
    first = read_points("points1", points1)
    second, mask = read_points("points2", points2, len(first)), read_mask(inliers, len(first))
    kept = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    if not kept.any():
        raise ValueError("points1 and points2 have no finite row in common; expected at least one")
    points = first[kept], second[kept]
    views = [read_view(f"size{k + 1}", sizes[k], f"image{k + 1}", images[k], points[k]) for k in range(2)]
    return Pair(points, mask[kept], side_by_side(views))


def read_points(name: str, points: ArrayLike, count: int | None = None) -> Floats:
    array = real_array(name, points)
    if array.ndim != 2 or array.shape[1] != 2 or count not in (None, len(array)):
        raise ValueError(f"{name} has shape {array.shape}; expected ({'n' if count is None else count}, 2)")
    return array


def read_mask(inliers: ArrayLike, count: int) -> NDArray[np.bool_]:
    mask = as_array(inliers, "inliers", f"an array of {count} truth values")
    if mask.shape != (count,) or mask.dtype != np.bool_:
        raise ValueError(f"inliers has shape {mask.shape} of {mask.dtype}; expected ({count},) of bool")
    return mask


def read_view(size_name: str, size: ArrayLike | None, image_name: str, image: Image | None, points: Floats) -> View:
    pixels = None if image is None else _pale(image_name, image)
    if size is None and pixels is None:
        return _bounding_box(points)
    given = pixels.shape[1::-1] if size is None and pixels is not None else size
    extent = real_array(size_name, given, "a width and a height")
    if extent.shape != (2,) or not (np.isfinite(extent).all() and (extent > 0).all()):
        raise ValueError(f"{size_name} is {size!r}; expected a width and a height above 0")
    return View(np.full(2, -0.5), extent, pixels, " px")


def _bounding_box(points: Floats) -> View:
    low, high = points.min(axis=0), points.max(axis=0)
    extent = high - low
    # Neither a line nor a point makes an image.
    size = 1.05 * np.maximum(extent, 0.25 * extent.max() or 1.0)
    return View((low + high - size) / 2, size, None, "")


def _pale(name: str, image: Image) -> Floats:
    """Brightness from 0 to 1, lifted so that colours stand out."""
    from matplotlib.image import imread

    try:
        array = np.asarray(imread(file_name(name, image)) if isinstance(image, (str, os.PathLike)) else image)
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as error:
        raise ValueError(f"{name} is {shown(image)}, which cannot be read as an image ({error})") from error
    if array.size == 0 or not (array.ndim == 2 or (array.ndim == 3 and array.shape[2] in (3, 4))):
        raise ValueError(f"{name} has shape {array.shape}; expected (h, w), (h, w, 3) or (h, w, 4)")
    brightest = np.iinfo(array.dtype).max if np.issubdtype(array.dtype, np.integer) else 1
    grey = array if array.ndim == 2 else array[:, :, :3] @ np.array([0.299, 0.587, 0.114])
    return np.asarray(0.45 + 0.55 * np.clip(grey / brightest, 0.0, 1.0), dtype=np.float64)


def side_by_side(views: Sequence[View]) -> list[View]:
    """The views side by side, equally high."""
    aspects = [float(view.size[0] / view.size[1]) for view in views]
    gaps = _GAP * (len(views) - 1)
    height = min(_TALLEST, (_WIDTH - 2 * _MARGIN - gaps) / sum(aspects))
    page = _page_width(height * sum(aspects) + gaps)
    left, placed = (page - height * sum(aspects) - gaps) / 2, []
    for view, aspect in zip(views, aspects, strict=True):
        placed.append(replace(view, left=left, scale=height / float(view.size[1])))
        left += height * aspect + _GAP
    return placed


def _page_width(content: float) -> float:
    return max(content + 2 * _MARGIN, _NARROWEST)


def new_page(views: Sequence[View], rows: int, title: str | None) -> tuple[Figure, list[Axes]]:
    """A figure with rows of the same images; the unit of their axes is the inch, from the upper edge of an image."""
    width = _page_width(views[-1].left + views[-1].width - views[0].left)
    label = _LABEL if len(views) > 1 else 0.1
    top, row = _TITLE if isinstance(title, str) and title else 0.1, label + views[0].height + _LEGEND
    height = top + rows * row
    figure = new_figure(width, height)
    if title is not None and not isinstance(title, str):
        raise TypeError(f"title must be a string, got {shown(title)}")
    if title:
        write_text(figure, 0.5, 1 - 0.55 * top / height, title, 15)
    every = [figure.add_axes((0, (height - top - (k + 1) * row) / height, 1, row / height)) for k in range(rows)]
    for axes in every:
        for view in views:
            _draw_image(axes, view)
        axes.set(xlim=(0, width), ylim=(views[0].height + _LEGEND, -label))
        axes.set_axis_off()
    return figure, every


def _draw_image(axes: Axes, view: View) -> None:
    from matplotlib.patches import Rectangle

    right, bottom = view.left + view.width, view.height
    if view.pixels is not None:
        extent = (view.left, right, bottom, 0.0)
        axes.imshow(view.pixels, extent=extent, cmap="gray", vmin=0.0, vmax=1.0, aspect="auto", zorder=0)
    axes.add_patch(Rectangle((view.left, 0.0), view.width, bottom, fill=False, edgecolor="#bbbbbb", zorder=1))
