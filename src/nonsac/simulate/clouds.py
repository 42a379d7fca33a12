"""Two samples of one cloud (Section 4.4 of the paper)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nonsac.simulate.motions import (
    Floats,
    Seed,
    check_count,
    check_not_negative,
    check_share,
    generator_of,
    move,
    random_motion,
)
from nonsac.values.checks import real_array


@dataclass(frozen=True, eq=False)
class CloudPair:
    """Two clouds without correspondences.

    Attributes
    ----------
    source : ndarray, shape (n, 3)
    target : ndarray, shape (k, 3)
    T : ndarray, shape (4, 4)
        The true transform, from source to target.
    overlap : float
        Share of one cloud that is found in the other, too.
    """

    source: Floats
    target: Floats
    T: Floats
    overlap: float


def cloud_pair(cloud: ArrayLike, rng: Seed, points: int = 500, overlap: float = 0.5, noise: float = 0.01) -> CloudPair:
    """Two partly shared, differently posed samples of one cloud (Section 4.4 of the paper).

    The cloud is scaled to fit inside the unit cube (longest side 1). Two random subsets of `points` points
    share `overlap` of them. The source is the first subset; the target is the second one after a random rigid
    motion (translation uniform in [-1, 1] along each axis) and Gaussian noise. The rows of both are in random
    order.

    Parameters
    ----------
    cloud : array_like, shape (k, 3)
        The points to choose from; finite, and not all the same.
    rng : int or numpy.random.Generator
    points : int
        Number of points in each subset.
    overlap : float
        Share of each subset that is in the other, from 0 to 1; their number is rounded to a whole one.
    noise : float
        Standard deviation along each axis, in units of the longest side of the cloud.

    Returns
    -------
    CloudPair

    Raises
    ------
    ValueError
        If an argument is out of its range, or the cloud has too few points for two such subsets.
    """
    check_count("points", points)
    points = int(points)
    check_share("overlap", overlap)
    check_not_negative("noise", noise)
    unit = _fit_unit_cube(cloud)
    shared = round(overlap * points)
    needed = 2 * points - shared
    if needed > len(unit):
        raise ValueError(
            f"cloud has {len(unit)} points; expected at least {needed}, for two subsets of {points} that share {shared}"
        )
    generator = generator_of(rng)
    chosen = generator.choice(len(unit), needed, replace=False)
    first, second = generator.permutation(chosen[:points]), generator.permutation(chosen[points - shared :])
    T = random_motion(generator)
    target = move(T, unit[second]) + noise * generator.standard_normal((points, 3))
    return CloudPair(unit[first], target, T, shared / points)


def _fit_unit_cube(cloud: ArrayLike) -> Floats:
    points = real_array("cloud", cloud)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"cloud has shape {points.shape}; expected (k, 3)")
    if not np.isfinite(points).all():
        raise ValueError("cloud holds NaN or infinity; expected finite points")
    longest = np.ptp(points, axis=0).max() if len(points) else 0.0
    if longest == 0.0:
        raise ValueError(f"cloud has {len(points)} points and no extent; expected points that differ")
    return np.asarray((points - points.min(axis=0)) / longest)
