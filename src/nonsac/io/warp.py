"""Matches of dense matchers, such as RoMa and DKM, from their warps."""

from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from nonsac.io.correspondences import Matches, Points
from nonsac.seeds import canonical_seed
from nonsac.values.arraylike import as_array
from nonsac.values.checks import real_array
from nonsac.values.numeric import shown


def from_warp(
    warp: ArrayLike,
    certainty: ArrayLike,
    size1: tuple[int, int],
    size2: tuple[int, int],
    count: int | None = None,
    rng: int | np.random.Generator | None = 0,
) -> Matches:
    """Turn the warp between two images into matches.

    Parameters
    ----------
    warp
        Shape (H, W, 4), each pixel a match x1, y1, x2, y2; the two halves of a symmetric warp, (H, 2 W, 4), lie side
        by side. Or shape (H, W, 2), each pixel of the first image with its x2, y2. Coordinates go from -1 to 1, from
        edge to edge of the image, as PyTorch has it with ``align_corners=False``. Tensors are taken as well.
    certainty
        Shape (H, W), from 0 to 1.
    size1, size2
        Width and height of the two images in pixels, in which the matches are to be.
    count
        How many matches to draw, without replacement, the more certain the more often; None takes all.
    rng
        Where the draw comes from: a seed, a generator, or None for another draw in every call.

    Returns
    -------
    Matches
        The matches of a certainty above 0, row by row of the warp. (0, 0) is the centre of the top-left pixel, as in
        OpenCV; COLMAP has (0.5, 0.5) there. The weights are the certainties, or None if these were spent on the
        draw: all matches that were drawn count alike.

    Raises
    ------
    ValueError
        If shapes or values do not fit.
    """
    flow, trust = _array("warp", warp), _array("certainty", certainty)
    if flow.ndim != 3 or flow.shape[2] not in (2, 4):
        raise ValueError(f"warp has shape {flow.shape}; expected (H, W, 4) or (H, W, 2), of one pair of images")
    if trust.shape != flow.shape[:2]:
        raise ValueError(f"certainty has shape {trust.shape}; expected {flow.shape[:2]}, as warp has")
    if count is not None and (not isinstance(count, Integral) or isinstance(count, bool) or int(count) < 1):
        raise ValueError(f"count is {shown(count)}; expected at least 1, or None for all matches")
    if flow.shape[2] == 2:
        flow = np.concatenate([_pixel_grid(*trust.shape), flow], axis=2)
    certain = trust > 0
    rows, weights = flow[certain], trust[certain]
    points1, points2 = _to_pixels("size1", size1, rows[:, :2]), _to_pixels("size2", size2, rows[:, 2:])
    if count is None or count >= len(rows):
        return Matches(points1, points2, weights)
    # The smallest of exponential times, each with its certainty as the rate, are such a draw.
    with np.errstate(all="ignore"):  # what is next to impossible waits for ever
        times = _generator(rng).standard_exponential(len(rows)) / weights
    drawn = np.sort(np.argpartition(times, count - 1)[:count])
    return Matches(points1[drawn], points2[drawn])


def _generator(rng: int | np.random.Generator | None) -> np.random.Generator:
    return rng if isinstance(rng, np.random.Generator) else np.random.default_rng(canonical_seed(rng))


def _array(name: str, values: Any) -> Points:
    array = as_array(values, name)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name} has the type {array.dtype}; expected real numbers")
    with np.errstate(all="ignore"):
        return array.astype(np.float64)


def _pixel_grid(height: int, width: int) -> Points:
    """Return where the centres of pixels lie between -1 and 1, shape (height, width, 2)."""
    x, y = ((2.0 * np.arange(length) + 1) / length - 1 for length in (width, height))
    return np.stack(np.meshgrid(x, y), axis=2)


def _to_pixels(name: str, size: tuple[int, int], points: Points) -> Points:
    extent = real_array(name, size, "a width and a height")
    if extent.shape != (2,) or not ((extent > 0) & (extent < np.inf)).all():
        raise ValueError(f"{name} is {shown(size)}; expected the width and height of the image in pixels")
    with np.errstate(all="ignore"):
        return (points + 1) * (extent / 2) - 0.5
