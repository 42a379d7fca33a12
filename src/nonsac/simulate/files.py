"""Matches of any number, written straight to a file in constant memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from os import PathLike
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nonsac.io.rows import check_rows_target, write_rows
from nonsac.seeds import permutation
from nonsac.simulate.matches import FAR, NEAR, check_matches, second_camera
from nonsac.simulate.motions import Floats, Seed, check_count, generator_of, random_motion

Indices = NDArray[np.int64]
Progress = Callable[[int, int], object]
# Here an array is (d, k): a column of the file is a row of it, which is fast to work on.
Columns = Callable[[Floats, Indices, Indices, float, np.random.Generator], Floats]

_BLOCK = 65_536  # part of what a seed means: another size gives other numbers


def to_file(
    path: str | PathLike[str],
    problem: str,
    n: int,
    outlier_ratio: float,
    noise: float,
    rng: Seed,
    *,
    dtype: Literal["float32", "float64"] = "float64",
    row_group: int = 1_000_000,
    progress: Progress | None = None,
) -> Floats:
    """Write simulated matches to a file, whose size is limited by the disk alone.

    The matches are distributed as those of `relative_pose`, `absolute_pose` and `registration`, and one seed gives
    their true pose, but other matches. Which rows are outliers is random over the whole file, and their number exact.
    The numbers depend on the arguments up to `rng` alone; on another kind of processor the last bits may differ.

    Parameters
    ----------
    path : path-like
        A file that ends in .npy (n rows) or .parquet (columns by name). It appears when it is whole.
    problem : str
        "relative-pose" (columns x1 y1 x2 y2), "absolute-pose" (u v X Y Z) or "registration" (x1 y1 z1 x2 y2 z2).
    n : int
        Number of rows.
    outlier_ratio : float
        Share of wrong matches, from 0 to 1; their number is rounded to the nearest whole one.
    noise : float
        Standard deviation along each axis: in normalised coordinates, or in the unit of the target.
    rng : int or numpy.random.Generator
    dtype : str
        "float64" or "float32".
    row_group : int
        Rows in each row group of a Parquet file.
    progress : callable, optional
        Called as `progress(done, n)`.

    Returns
    -------
    ndarray, shape (4, 4)
        The true transform.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    InputError
        If the suffix is unknown, or the file cannot be written, for want of space say.
    """
    if problem not in PROBLEMS:
        raise ValueError(f"problem is {problem!r}; expected one of {', '.join(PROBLEMS)}")
    if dtype not in ("float32", "float64"):
        raise ValueError(f"dtype is {dtype!r}; expected float32 or float64")
    check_matches(n, outlier_ratio, noise)
    check_count("row_group", row_group)
    n, row_group = int(n), int(row_group)
    kind = PROBLEMS[problem]
    check_rows_target(path, len(kind.columns), n, dtype)
    generator = generator_of(rng)
    T = kind.motion(generator)
    blocks = _blocks(kind, T, n, outlier_ratio, noise, int(generator.integers(2**63)), progress)
    write_rows(path, kind.columns, n, dtype, blocks, row_group)
    return T


@dataclass(frozen=True)
class Kind:
    """What the columns of a file are called, how its true motion is drawn, and how a block of it."""

    columns: tuple[str, ...]
    motion: Callable[[np.random.Generator], Floats]
    block: Columns


def _blocks(
    kind: Kind, T: Floats, n: int, outlier_ratio: float, noise: float, seed: int, progress: Progress | None
) -> Iterator[Floats]:
    outliers = round(outlier_ratio * n)
    for number, first in enumerate(range(0, n, _BLOCK)):
        rows = min(_BLOCK, n - first)
        wrong = permutation(n, first, rows, seed) < outliers
        rng = np.random.default_rng([seed, number])
        yield kind.block(T, np.flatnonzero(~wrong), np.flatnonzero(wrong), noise, rng).T
        if progress is not None:
            progress(first + rows, n)


def _registration(T: Floats, right: Indices, wrong: Indices, noise: float, rng: np.random.Generator) -> Floats:
    source = rng.random((3, len(right) + len(wrong)))
    target = _moved(T, source)
    target[:, right] += noise * rng.standard_normal((3, len(right)))
    centre = _moved(T, np.full((3, 1), 0.5))
    target[:, wrong] = centre + np.sqrt(3.0) / 2.0 * _in_unit_ball(len(wrong), rng)
    return np.concatenate([source, target])


def _relative_pose(T: Floats, right: Indices, wrong: Indices, noise: float, rng: np.random.Generator) -> Floats:
    points = np.empty((4, len(right) + len(wrong)))
    points[:, right] = _seen_by_both(T, len(right), rng)[:4] + noise * rng.standard_normal((4, len(right)))
    points[:, wrong] = rng.uniform(-1.0, 1.0, (4, len(wrong)))
    return points


def _absolute_pose(T: Floats, right: Indices, wrong: Indices, noise: float, rng: np.random.Generator) -> Floats:
    x, y, u, v, depth = _seen_by_both(T, len(right) + len(wrong), rng)
    image = np.stack([u, v])
    image[:, right] += noise * rng.standard_normal((2, len(right)))
    image[:, wrong] = rng.uniform(-1.0, 1.0, (2, len(wrong)))
    return np.stack([*image, x * depth, y * depth, depth])


PROBLEMS = {
    "relative-pose": Kind(("x1", "y1", "x2", "y2"), second_camera, _relative_pose),
    "absolute-pose": Kind(("u", "v", "X", "Y", "Z"), second_camera, _absolute_pose),
    "registration": Kind(("x1", "y1", "z1", "x2", "y2", "z2"), random_motion, _registration),
}


def _moved(T: Floats, points: Floats) -> Floats:
    """Written out, because BLAS is slow at so thin a product."""
    x, y, z = points
    return np.stack([row[0] * x + row[1] * y + row[2] * z + row[3] for row in T[:3]])


def _in_unit_ball(n: int, rng: np.random.Generator) -> Floats:
    directions = rng.standard_normal((3, n))
    return np.asarray(directions * (np.cbrt(rng.random(n)) / np.sqrt((directions * directions).sum(axis=0))))


def _seen_by_both(T: Floats, n: int, rng: np.random.Generator) -> Floats:
    """Points in both images, x1 y1 x2 y2, and their depths in the first one: (5, n)."""
    found = np.empty((5, n))
    count = 0
    while count < n:
        part = _shared_view(T, min(2 * (n - count) + 100, _BLOCK // 4), rng)[:, : n - count]
        found[:, count : count + part.shape[1]] = part
        count += part.shape[1]
    return found


def _shared_view(T: Floats, draws: int, rng: np.random.Generator) -> Floats:
    """Points drawn in the first image, as far as the second camera sees them, too."""
    x, y = rng.uniform(-1.0, 1.0, (2, draws))
    depth = rng.uniform(NEAR, FAR, draws)
    u, v, w = _moved(T, np.stack([x * depth, y * depth, depth]))
    seen = np.flatnonzero((w > NEAR) & (np.abs(u) <= w) & (np.abs(v) <= w))
    w = w[seen]
    return np.stack([x[seen], y[seen], u[seen] / w, v[seen] / w, depth[seen]])
