"""Pictures of results. They need matplotlib, but no display: all is drawn into memory, then written."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.io.atomic import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["boxplot", "clouds", "picture_suffix", "render"]

Floats = NDArray[np.float64]

# The blue and the orange of the Okabe-Ito palette: told apart with every kind of colour blindness.
_SOURCE = np.array([0xE6, 0x9F, 0x00]) / 255
_TARGET = np.array([0x00, 0x72, 0xB2]) / 255
_INK = "#333333"
_MOST_POINTS = 8_000
_DPI = 150
# Name, azimuth and elevation of the eye in degrees: x forward, y to the left, z up.
_VIEWS = (("side", -90.0, 0.0), ("front", 0.0, 0.0), ("oblique", -50.0, 25.0))
_PANEL = np.array([0.315, 0.425])
_LEFT = (0.035, 0.357, 0.679)
_BOTH_WAYS = np.array([-1.0, 1.0])
_BEST, _WORST = 0.01, 180.0


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
    transform = np.asarray(T, dtype=np.float64)
    if transform.shape != (4, 4):
        raise ValueError(f"T has shape {transform.shape}; expected (4, 4)")
    figure = _figure(12.0, 8.0)
    if title:
        _write_text(figure, 0.5, 0.965, title, 17)
    _row_of_views(figure, 0, "before", before, fixed)
    if np.isfinite(transform).all():
        _row_of_views(figure, 1, "after", before @ transform[:3, :3].T + transform[:3, 3], fixed)
    else:
        _write_text(figure, 0.5, 0.25, "no trusted alignment", 24, color="#999999")
    for left, (name, _, _) in zip(_LEFT, _VIEWS, strict=True):
        _write_text(figure, left + _PANEL[0] / 2, 0.022, name, 13, color="#777777")
    _legend(figure)
    _write(path, figure, suffix)


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
    published = dict(paper or {})
    unknown = sorted(set(published) - set(errors) - set(times))
    if unknown:
        raise ValueError(f"paper has the key {unknown[0]!r}; expected only keys of errors or times")
    angles = {rule: _drawable_angles(values) for rule, values in _samples("errors", errors)}
    seconds = {stage: np.maximum(values, 1e-4) for stage, values in _samples("times", times)}
    figure = _figure(14.0, 8.0)
    left, right = figure.add_axes((0.06, 0.19, 0.64, 0.70)), figure.add_axes((0.77, 0.19, 0.21, 0.70))
    _boxes(left, angles, published, _numbered(list(angles)))
    _boxes(right, seconds, published, [name.replace("_", " ") for name in seconds])
    left.set_title("Rotation error", loc="left", color=_INK, fontsize=15)
    right.set_title("Processing time", loc="left", color=_INK, fontsize=15)
    _log_axis(left, "degrees", (0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 90, 180))
    _log_axis(right, "seconds", [digit * 10.0**power for power in range(-4, 5) for digit in (1, 3)])
    if published:
        _write_text(figure, 0.98, 0.95, f"\N{BLACK DIAMOND} {label}", 12, ha="right")
    _write(path, figure, suffix)


def render(figure: Figure, suffix: str) -> bytes:
    """Bytes of a picture file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    suffix : str
        ``.png``, ``.pdf`` or ``.svg``.

    Returns
    -------
    bytes

    Raises
    ------
    ValueError
        For any other suffix.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    undated: dict[str, dict[str, Any]] = {".png": {}, ".pdf": {"CreationDate": None}, ".svg": {"Date": None}}
    if suffix not in undated:
        raise ValueError(f"suffix is {suffix!r}; expected .png, .pdf or .svg")
    FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "nonsac"}):
        figure.savefig(buffer, format=suffix[1:], dpi=_DPI, metadata=undated[suffix])
    return buffer.getvalue()


def picture_suffix(path: str | os.PathLike[str]) -> str:
    """Suffix of the path of a picture, in lower case.

    Raises
    ------
    ValueError
        If it is not .png, .pdf or .svg.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".pdf", ".svg"):
        raise ValueError(f"path is {os.fspath(path)!r}; expected a picture that ends in .png, .pdf or .svg")
    return suffix


def _write(path: str | os.PathLike[str], figure: Figure, suffix: str) -> None:
    content = render(figure, suffix)
    write_atomically(path, lambda temporary: temporary.write_bytes(content))


def _write_text(figure: Figure, x: float, y: float, text: str, size: float, **look: Any) -> None:
    figure.text(x, y, text, fontsize=size, **{"ha": "center", "va": "center", "color": _INK, **look})


def _figure(width: float, height: float) -> Figure:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("pictures need matplotlib: pip install matplotlib") from error
    return Figure(figsize=(width, height), facecolor="white")


# --- clouds ------------------------------------------------------------


def _thin(name: str, cloud: ArrayLike) -> Floats:
    points = np.asanyarray(cloud)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{name} has shape {points.shape}; expected (n, 3)")
    if len(points) > _MOST_POINTS:
        # Random rather than every k-th row: scans are stored line by line, a stride would show as stripes.
        # More rows than needed, because range scans hold NaN where nothing was hit.
        some = min(len(points), 8 * _MOST_POINTS)
        points = points[np.random.default_rng(0).choice(len(points), some, replace=False)]
    points = np.asarray(points, dtype=np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise ValueError(f"{name} has no finite point; expected at least one")
    return np.asarray(points[:_MOST_POINTS])


def _row_of_views(figure: Figure, row: int, label: str, source: Floats, target: Floats) -> None:
    origin = target.mean(axis=0)
    points = np.concatenate([source, target]) - origin
    normals = np.concatenate([_normals(source), _normals(target)])
    colours = np.repeat([_SOURCE, _TARGET], [len(source), len(target)], axis=0)
    cameras = [_camera(azimuth, elevation) for _, azimuth, elevation in _VIEWS]
    # One scale for the whole row, the largest at which every view fits its panel.
    inches = _PANEL * figure.get_size_inches()
    scale = max(float((np.ptp(points @ camera[:2].T, axis=0) / inches).max()) for camera in cameras) or 1.0
    bottom = 0.50 - 0.455 * row
    _write_text(figure, 0.02, bottom + _PANEL[1] / 2, label, 15, rotation=90)
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
    for x, name, colour in ((0.04, "source", _SOURCE), (0.12, "target", _TARGET)):
        _write_text(figure, x, 0.965, "\N{BLACK CIRCLE}", 15, color=tuple(colour))
        _write_text(figure, x + 0.012, 0.965, name, 13, ha="left")


# --- box plots ---------------------------------------------------------


def _samples(name: str, values: Mapping[str, ArrayLike]) -> list[tuple[str, Floats]]:
    samples = [(key, np.asarray(value, dtype=np.float64).ravel()) for key, value in values.items()]
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
        _box(axes, place, values, _SOURCE if name == "refined" else _TARGET)
        if name in published:
            axes.plot(place, published[name], "D", markersize=7, color=_INK, zorder=5)
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
    axes.hlines(median, place - 0.3, place + 0.3, color=_INK, linewidth=1.8, zorder=4)


def _log_axis(axes: Axes, label: str, ticks: Sequence[float]) -> None:
    from matplotlib.ticker import NullLocator

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks], fontsize=11)
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylim(low, high)
    axes.set_ylabel(label, fontsize=13, color=_INK)
    axes.grid(axis="y", color="#e5e5e5")
    axes.set_axisbelow(True)
    axes.tick_params(colors=_INK, length=0)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#bbbbbb")
