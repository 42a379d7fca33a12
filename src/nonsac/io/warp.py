"""Matches of dense matchers, such as RoMa and DKM, from their warps."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.io.correspondences import Matches, Points
from nonsac.io.dense import checked_count, drawn, numbers_of
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
    flow, trust = numbers_of("warp", warp), numbers_of("certainty", certainty)
    if flow.ndim != 3 or flow.shape[2] not in (2, 4):
        raise ValueError(f"warp has shape {flow.shape}; expected (H, W, 4) or (H, W, 2), of one pair of images")
    if trust.shape != flow.shape[:2]:
        raise ValueError(f"certainty has shape {trust.shape}; expected {flow.shape[:2]}, as warp has")
    count = checked_count(count)
    height, width = trust.shape
    certain = np.flatnonzero(trust > 0)
    chosen, weights = drawn(certain, trust.ravel()[certain], count, rng)
    rows = flow.reshape(-1, flow.shape[2])[chosen].astype(np.float64)
    first = _pixels(chosen, height, width) if flow.shape[2] == 2 else rows[:, :2]
    return Matches(_to_pixels("size1", size1, first), _to_pixels("size2", size2, rows[:, -2:]), weights)


def _pixels(numbers: NDArray[np.int64], height: int, width: int) -> Points:
    """Where the centres of pixels lie between -1 and 1, of some pixels counted row by row."""
    rows, columns = np.divmod(numbers, width)
    return np.column_stack([(2.0 * columns + 1) / width - 1, (2.0 * rows + 1) / height - 1])


def _to_pixels(name: str, size: tuple[int, int], points: Points) -> Points:
    extent = real_array(name, size, "a width and a height")
    if extent.shape != (2,) or not ((extent > 0) & (extent < np.inf)).all():
        raise ValueError(f"{name} is {shown(size)}; expected the width and height of the image in pixels")
    with np.errstate(all="ignore"):
        return (points + 1) * (extent / 2) - 0.5
