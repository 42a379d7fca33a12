"""Matches with a known share of wrong ones (Sections 4.1 to 4.3 of the paper)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nonsac.simulate.motions import (
    Floats,
    Seed,
    check_count,
    check_not_negative,
    check_share,
    generator_of,
    move,
    random_motion,
    random_rotation,
    rotation_about,
)
from nonsac.values.numeric import as_real, shown

# What the two cameras of Section 4.1 see, in units of the distance between them.
NEAR, FAR = 0.1, 10.0
_LEAST_SHARED = 0.2
_TRIED, _LARGEST_TURN = 1000, 0.12


@dataclass(frozen=True, eq=False)
class Pairs:
    """Given correspondences: row i of `source` is matched with row i of `target`.

    Attributes
    ----------
    source, target : ndarray, shape (n, 3)
    T : ndarray, shape (4, 4)
        The true transform, from source to target.
    inliers : ndarray of bool, shape (n,)
        Whether each match is a true one.
    """

    source: Floats
    target: Floats
    T: Floats
    inliers: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ImageMatches:
    """Matched points of two calibrated images: row i of `points1` is matched with row i of `points2`.

    Attributes
    ----------
    points1, points2 : ndarray, shape (n, 2)
        Normalised image coordinates: x to the right and y down, both divided by the depth.
    T : ndarray, shape (4, 4)
        The true pose, from the first camera to the second; the length of its translation is 1.
    inliers : ndarray of bool, shape (n,)
        Whether each match is a true one.
    """

    points1: Floats
    points2: Floats
    T: Floats
    inliers: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class PointMatches:
    """Points of a calibrated image and of the world: row i of `points2d` is matched with row i of `points3d`.

    Attributes
    ----------
    points2d : ndarray, shape (n, 2)
        Normalised image coordinates: x to the right and y down, both divided by the depth.
    points3d : ndarray, shape (n, 3)
        Points in the frame of the world.
    T : ndarray, shape (4, 4)
        The true pose, from the world to the camera, whose centre is 1 from the origin.
    inliers : ndarray of bool, shape (n,)
        Whether each match is a true one.
    """

    points2d: Floats
    points3d: Floats
    T: Floats
    inliers: NDArray[np.bool_]


def registration(n: int, outlier_ratio: float, noise: float, rng: Seed, scale: float = 1.0) -> Pairs:
    """Pairs of 3D points related by a random rigid motion, most of them wrong (Section 4.3 of the paper).

    The source points are uniform in the unit cube. The target points are the source points, scaled, moved and
    disturbed by Gaussian noise; a random share of them is replaced with points uniform in the ball that
    circumscribes the moved cube. The translation is uniform in [-1, 1] along each axis.

    Parameters
    ----------
    n : int
        Number of pairs.
    outlier_ratio : float
        Share of wrong pairs, from 0 to 1; their number is rounded to the nearest whole one.
    noise : float
        Standard deviation along each axis, in the unit of the target.
    rng : int or numpy.random.Generator
    scale : float
        Scale of the motion; 1 makes it rigid.

    Returns
    -------
    Pairs

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    check_matches(n, outlier_ratio, noise)
    n, noise = int(n), float(noise)
    if not 0 < as_real(scale) < np.inf:
        raise ValueError(f"scale is {shown(scale)}; expected a finite number above 0")
    generator = generator_of(rng)
    T = random_motion(generator, scale)
    source = generator.random((n, 3))
    target = move(T, source) + noise * generator.standard_normal((n, 3))
    inliers, outliers = _split(n, outlier_ratio, generator)
    centre, radius = move(T, np.full(3, 0.5)), scale * np.sqrt(3.0) / 2.0
    target[outliers] = centre + radius * _in_unit_ball(len(outliers), generator)
    return Pairs(source, target, T, inliers)


def relative_pose(n: int, outlier_ratio: float, noise: float, rng: Seed, sees_all: bool = False) -> ImageMatches:
    """Matched points of two cameras that look at the same scene, many of them wrong (Section 4.1 of the paper).

    In the first camera, normalised points are uniform in [-1, 1] along each axis and depths in [0.1, 10]. The
    second camera is 1 away and sees every point at a depth above 0.1 and within [-1, 1], too. Then Gaussian noise
    disturbs the points of both images, which may push some beyond 1, and a random share of the matches is
    replaced with points uniform in [-1, 1], in both images.

    The paper's second camera sees all that the first one sees; then it stands behind it and looks the same way, but
    for some degrees and quarter turns about the optical axis (`sees_all`). By default the rotation is uniform among
    all and the centre uniform on the sphere, drawn anew until a fifth of what the first camera sees is in sight of the
    second one. The optical axes then part by up to about 90 degrees, and one camera may stand on its head with
    respect to the other. Points that the second camera does not see are drawn anew. One seed gives the same pose for
    every `n`.

    Parameters
    ----------
    n : int
        Number of matches.
    outlier_ratio : float
        Share of wrong matches, from 0 to 1; their number is rounded to the nearest whole one.
    noise : float
        Standard deviation along each axis of both images, in normalised coordinates.
    rng : int or numpy.random.Generator
    sees_all : bool
        Whether the second camera sees all that the first one sees, as in the paper.

    Returns
    -------
    ImageMatches

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    check_matches(n, outlier_ratio, noise)
    n, noise = int(n), float(noise)
    generator = generator_of(rng)
    T = camera_that_sees_all(generator) if sees_all else second_camera(generator)
    points1, points2, _ = _seen_by_both(T, n, generator)
    inliers, outliers = _split(n, outlier_ratio, generator)
    _spoil(points1, outliers, noise, generator)
    _spoil(points2, outliers, noise, generator)
    return ImageMatches(points1, points2, T, inliers)


def absolute_pose(n: int, outlier_ratio: float, noise: float, rng: Seed, sees_all: bool = False) -> PointMatches:
    """Points of a scene and their places in an image, many of them wrong (Section 4.2 of the paper).

    Scene and camera are those of `relative_pose`: the frame of its first camera is the world, its second camera
    is the one whose pose is sought. Gaussian noise disturbs the image points, a random share of which is replaced
    with points uniform in [-1, 1] along each axis. The points of the world are exact.

    Parameters
    ----------
    n : int
        Number of matches.
    outlier_ratio : float
        Share of wrong matches, from 0 to 1; their number is rounded to the nearest whole one.
    noise : float
        Standard deviation along each axis of the image, in normalised coordinates.
    rng : int or numpy.random.Generator
    sees_all : bool
        As for `relative_pose`.

    Returns
    -------
    PointMatches

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    check_matches(n, outlier_ratio, noise)
    n, noise = int(n), float(noise)
    generator = generator_of(rng)
    T = camera_that_sees_all(generator) if sees_all else second_camera(generator)
    points1, points2d, depths = _seen_by_both(T, n, generator)
    inliers, outliers = _split(n, outlier_ratio, generator)
    _spoil(points2d, outliers, noise, generator)
    return PointMatches(points2d, _lift(points1, depths), T, inliers)


# --- two cameras --------------------------------------------------------------------------


def second_camera(generator: np.random.Generator) -> Floats:
    """Pose from the first camera to a random second one, which sees enough of what the first one sees."""
    T = np.eye(4)
    while True:
        T[:3, :3] = random_rotation(generator)
        direction = generator.standard_normal(3)
        T[:3, 3] = direction / np.linalg.norm(direction)
        if len(_shared_view(T, 1000, generator)[0]) >= 1000 * _LEAST_SHARED:
            return T


def camera_that_sees_all(generator: np.random.Generator) -> Floats:
    """Pose from the first camera to a random second one, which sees all that the first one sees (Section 4.1).

    That is, the eight corners of the frustum. Such a pose is the same after quarter turns about the optical axis, and
    else turned by no more than a tenth of a radian, so only those are tried.
    """
    corners = np.array([(x * z, y * z, z) for x in (-1, 1) for y in (-1, 1) for z in (NEAR, FAR)])
    while True:
        direction = generator.standard_normal((_TRIED, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        turns = generator.uniform(-_LARGEST_TURN, _LARGEST_TURN, (_TRIED, 3))
        quarters = generator.integers(4, size=_TRIED)
        for number in np.flatnonzero(direction[:, 2] < -0.5):  # the centre is behind the first camera
            angle = np.linalg.norm(turns[number])
            quarter = rotation_about(np.array([0.0, 0.0, 1.0]), 0.5 * np.pi * quarters[number])
            T = np.eye(4)
            T[:3, :3] = quarter @ rotation_about(turns[number] / angle, float(angle))
            T[:3, 3] = -T[:3, :3] @ direction[number]
            moved = move(T, corners)
            if (moved[:, 2] > NEAR).all() and (np.abs(moved[:, :2]) <= moved[:, 2:]).all():
                return T


def _seen_by_both(T: Floats, n: int, generator: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Points of the two images, and their depths in the first one."""
    points1, points2, depths = np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 1))
    found = 0
    while found < n:
        draws = min(2 * (n - found) + 100, 100_000)
        shared = _shared_view(T, draws, generator)
        for whole, part in zip((points1, points2, depths), shared, strict=True):
            whole[found : found + len(part)] = part[: n - found]
        found += len(shared[0])
    return points1, points2, depths


def _shared_view(T: Floats, draws: int, generator: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Points drawn in the first image, as far as the second camera sees them, too."""
    points1 = generator.uniform(-1.0, 1.0, (draws, 2))
    depths = generator.uniform(NEAR, FAR, (draws, 1))
    moved = move(T, _lift(points1, depths))
    seen = (moved[:, 2] > NEAR) & (np.abs(moved[:, 0]) <= moved[:, 2]) & (np.abs(moved[:, 1]) <= moved[:, 2])
    moved = moved[seen]
    return points1[seen], moved[:, :2] / moved[:, 2:], depths[seen]


def _lift(points: Floats, depths: Floats) -> Floats:
    return np.concatenate([points * depths, depths], axis=1)


def _spoil(points: Floats, outliers: NDArray[np.int64], noise: float, generator: np.random.Generator) -> None:
    points += noise * generator.standard_normal(points.shape)
    points[outliers] = generator.uniform(-1.0, 1.0, (len(outliers), 2))


def _split(n: int, outlier_ratio: float, generator: np.random.Generator) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which of n matches are true ones, and the rows of the others."""
    outliers = generator.permutation(n)[: round(outlier_ratio * n)]
    inliers = np.ones(n, dtype=np.bool_)
    inliers[outliers] = False
    return inliers, outliers


def _in_unit_ball(n: int, generator: np.random.Generator) -> Floats:
    directions = generator.standard_normal((n, 3))
    radii = np.cbrt(generator.random((n, 1)))
    return np.asarray(radii * directions / np.linalg.norm(directions, axis=1, keepdims=True))


def check_matches(n: int, outlier_ratio: float, noise: float) -> None:
    check_count("n", n)
    check_share("outlier_ratio", outlier_ratio)
    check_not_negative("noise", noise)
