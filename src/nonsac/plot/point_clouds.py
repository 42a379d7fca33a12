"""Two clouds before and after registration."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.plot.figures import BLUE, ORANGE, new_figure, picture_suffix, write, write_text
from nonsac.values.checks import real_array
from nonsac.values.numeric import MOST, shown
from nonsac.values.quiet import quiet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

_MOST_POINTS = 8_000
# Name, azimuth and elevation of the eye in degrees: x forward, y to the left, z up.
_VIEWS = (("side", -90.0, 0.0), ("front", 0.0, 0.0), ("oblique", -50.0, 25.0))
_PANEL = np.array([0.315, 0.425])
_LEFT = (0.035, 0.357, 0.679)
_BOTH_WAYS = np.array([-1.0, 1.0])


@quiet
def clouds(
    path: str | os.PathLike[str], source: ArrayLike, target: ArrayLike, T: ArrayLike, title: str | None = None
) -> None:
    """Draw two clouds before and after registration, from three sides (x forward, z up).

    Parameters
    ----------
    path : path-like
        The picture to write: .png (1800 x 1200 pixels), .pdf or .svg.
    source, target : array_like, shapes (n, 3) and (k, 3)
        The clouds, in one unit; of each, at most 8,000 points are drawn. Rows that are not finite are left
        out.
    T : array_like, shape (4, 4)
        Transform from source to target. If it holds NaN (a failed registration), the lower row says so.
    title : str, optional
        Caption, for instance with the overlap and the angle.

    Raises
    ------
    ValueError
        If a shape or the suffix of `path` is not one of the above, or a cloud has no finite point.
    ImportError
        If matplotlib is missing.
    """
    suffix = picture_suffix(path)
    before, fixed = _thin("source", source), _thin("target", target)
    transform = real_array("T", T)
    if transform.shape != (4, 4):
        raise ValueError(f"T has shape {transform.shape}; expected (4, 4)")
    figure = new_figure(12.0, 8.0)
    if title is not None:
        if not isinstance(title, str):
            raise TypeError(f"title must be a string, got {shown(title)}")
        write_text(figure, 0.5, 0.965, title, 17)
    _row_of_views(figure, 0, "before", before, fixed)
    if (np.abs(transform) <= MOST).all():
        _row_of_views(figure, 1, "after", before @ transform[:3, :3].T + transform[:3, 3], fixed)
    else:
        write_text(figure, 0.5, 0.25, "no trusted alignment", 24, color="#999999")
    for left, (name, _, _) in zip(_LEFT, _VIEWS, strict=True):
        write_text(figure, left + _PANEL[0] / 2, 0.022, name, 13, color="#777777")
    _legend(figure)
    write(path, figure, suffix)


def _thin(name: str, cloud: ArrayLike) -> Floats:
    points = np.asanyarray(cloud)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{name} has shape {points.shape}; expected (n, 3)")
    if points.dtype.kind not in "fiub":
        raise TypeError(f"{name} is of type {points.dtype}; expected real numbers")
    if len(points) > _MOST_POINTS:
        # Random rather than every k-th row: scans are stored line by line, a stride would show as stripes.
        # More rows than needed, because range scans hold NaN where nothing was hit.
        some = min(len(points), 8 * _MOST_POINTS)
        points = points[np.random.default_rng(0).choice(len(points), some, replace=False)]
    points = np.asarray(points, dtype=np.float64)
    points = points[(np.abs(points) <= MOST).all(axis=1)]
    if not len(points):
        raise ValueError(f"{name} has no finite point; expected at least one")
    return np.asarray(points[:_MOST_POINTS])


def _row_of_views(figure: Figure, row: int, label: str, source: Floats, target: Floats) -> None:
    origin = target.mean(axis=0)
    points = np.concatenate([source, target]) - origin
    normals = np.concatenate([_normals(source), _normals(target)])
    colours = np.repeat([ORANGE, BLUE], [len(source), len(target)], axis=0)
    cameras = [_camera(azimuth, elevation) for _, azimuth, elevation in _VIEWS]
    # One scale for the whole row, the largest at which every view fits its panel.
    inches = _PANEL * figure.get_size_inches()
    scale = max(float((np.ptp(points @ camera[:2].T, axis=0) / inches).max()) for camera in cameras) or 1.0
    bottom = 0.50 - 0.455 * row
    write_text(figure, 0.02, bottom + _PANEL[1] / 2, label, 15, rotation=90)
    for column, camera in enumerate(cameras):
        axes = figure.add_axes((_LEFT[column], bottom, *_PANEL))
        _draw(axes, points, normals, colours, camera)
        flat = points @ camera[:2].T
        middle, half = (flat.min(axis=0) + flat.max(axis=0)) / 2, 0.53 * scale * inches
        axes.set(xlim=middle[0] + half[0] * _BOTH_WAYS, ylim=middle[1] + half[1] * _BOTH_WAYS)


def _camera(azimuth: float, elevation: float) -> Floats:
    """Rows: right, up, and towards the eye."""
    a, e = np.radians([azimuth, elevation])
    eye = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack([right, np.cross(eye, right), eye])


def _normals(points: Floats) -> Floats:
    """Direction of least spread of each point's neighbourhood; its sign means nothing."""
    from scipy.spatial import cKDTree

    local = points - points.mean(axis=0)
    size = np.abs(local).max(initial=0.0)
    if not np.isfinite(size):
        return np.zeros_like(points)
    local /= size or 1.0
    neighbours = local[cKDTree(local).query(local, k=min(16, len(local)))[1].reshape(len(local), -1)]
    centred = neighbours - neighbours.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(centred.swapaxes(1, 2) @ centred)[1][:, :, 0])


def _draw(axes: Axes, points: Floats, normals: Floats, colours: Floats, camera: Floats) -> None:
    right, up, depth = camera @ points.T
    order = np.argsort(depth)
    nearness = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-300)
    # The light sits above the left shoulder of the eye; a surface looks the same from both of its sides.
    light = np.array([-0.35, 0.5, 0.8]) @ camera
    facing = normals * np.where(normals @ camera[2] < 0, -1.0, 1.0)[:, None]
    brightness = np.clip(facing @ light, 0.0, 1.0)[:, None]
    shaded = colours * (0.6 + 0.4 * brightness) + 0.2 * brightness**4 * (1 - colours)
    haze = 0.4 * (1 - nearness[:, None])
    shaded = np.clip(shaded * (1 - haze) + haze, 0.0, 1.0)
    size = float(np.clip(110_000 / len(points), 6.5, 30.0))
    axes.scatter(right[order], up[order], s=size, c=shaded[order], linewidths=0, rasterized=True)
    axes.set_axis_off()


def _legend(figure: Figure) -> None:
    for x, name, colour in ((0.04, "source", ORANGE), (0.12, "target", BLUE)):
        write_text(figure, x, 0.965, "\N{BLACK CIRCLE}", 15, color=tuple(colour))
        write_text(figure, x + 0.012, 0.965, name, 13, ha="left")
