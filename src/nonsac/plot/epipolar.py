"""Epipolar lines in a picture. A line is a row (a, b, c) of ``a x + b y + c = 0``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nonsac.plot.views import View

Floats = NDArray[np.float64]


def homogeneous(points: Floats) -> Floats:
    return np.concatenate([points, np.ones((len(points), 1))], axis=1)


def distances_from_lines(points: Floats, lines: Floats) -> Floats:
    """Distance of each point from its line; infinite if that is no line."""
    steepness = np.linalg.norm(lines[:, :2], axis=1)
    offsets = np.abs((homogeneous(points) * lines).sum(axis=1))
    return np.divide(offsets, steepness, out=np.full(len(points), np.inf), where=steepness > 0)


def places_and_lines(points: Floats, lines: Floats, view: View) -> Floats:
    """What is far apart for points that are far apart or on different lines of the pencil, shape (n, 4)."""
    half, middle = view.size / 2, view.corner + view.size / 2
    unit = np.column_stack([lines[:, :2] * half, lines[:, :2] @ middle + lines[:, 2]])
    # All lines pass through the epipole: they fill a plane of the space of lines, and differ by an angle in it.
    first, second = (unit @ np.linalg.eigh(unit.T @ unit)[1][:, 1:]).T
    angles = 2 * np.arctan2(second, first)
    # Places count little: they part points on one line, and twelve lines should not coincide.
    return np.column_stack([(points - middle) / half / 12, np.cos(angles), np.sin(angles)])


def far_apart(places: Floats, count: int) -> NDArray[np.int64]:
    """Rows far from each other: first the one in the middle, then always the farthest from those chosen."""
    distances = np.full(len(places), np.inf)
    chosen = [int(np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1)))]
    while True:
        distances = np.minimum(distances, np.linalg.norm(places - places[chosen[-1]], axis=1))
        if len(chosen) == count or distances.max() == 0:
            return np.array(chosen)
        chosen.append(int(np.argmax(distances)))


def clip(lines: Floats, view: View) -> Floats:
    """Both ends of each line within the image, shape (k, 2, 2); NaN if it misses the image."""
    normals, offsets = lines[:, :2], lines[:, 2]
    corners = np.stack([view.corner, view.corner + view.size])
    middle = corners.mean(axis=0)
    with np.errstate(all="ignore"):
        feet = middle - normals * ((normals @ middle + offsets) / (normals**2).sum(axis=1))[:, None]
        along = normals[:, ::-1] * [-1.0, 1.0]
        steps = (corners - feet[:, None]) / along[:, None]
    enter, leave = steps.min(axis=1).max(axis=1), steps.max(axis=1).min(axis=1)
    inside = np.where((enter < leave)[:, None], np.stack([enter, leave], axis=1), np.nan)
    return np.asarray(feet[:, None] + inside[:, :, None] * along[:, None])
