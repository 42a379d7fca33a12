"""Simulated data with known ground truth: the paper's generators, and two scans to look at.

Every function takes `rng`, a whole number (a seed) or a NumPy ``Generator``. One seed, one result.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

__all__ = [
    "CloudPair",
    "ImageMatches",
    "Pairs",
    "PointMatches",
    "absolute_pose",
    "cloud_pair",
    "demo_scans",
    "random_rotation",
    "registration",
    "relative_pose",
]

Floats = NDArray[np.float64]
Seed = int | np.random.Generator

# What the two cameras of Section 4.1 see, in units of the distance between them.
_NEAR, _FAR = 0.1, 10.0
_LEAST_SHARED = 0.2


@dataclass(frozen=True, eq=False)
class Pairs:
    """Given correspondences: row i of `source` is matched with row i of `target`.

    Attributes
    ----------
    source, target : ndarray, shape (n, 3)
    T : ndarray, shape (4, 4)
        The true transform, from source to target.
    inliers : ndarray of bool, shape (n,)
        True where the match is a true one.
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
        True where the match is a true one.
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
        True where the match is a true one.
    """

    points2d: Floats
    points3d: Floats
    T: Floats
    inliers: NDArray[np.bool_]


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


def random_rotation(rng: Seed) -> Floats:
    """Rotation drawn uniformly from all rotations.

    Parameters
    ----------
    rng : int or numpy.random.Generator

    Returns
    -------
    ndarray, shape (3, 3)
    """
    quaternion = _generator(rng).standard_normal(4)
    return np.asarray(Rotation.from_quat(quaternion).as_matrix(), dtype=np.float64)


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
    _check_matches(n, outlier_ratio, noise)
    if not 0 < scale < np.inf:
        raise ValueError(f"scale is {scale}; expected a finite number above 0")
    generator = _generator(rng)
    T = _random_motion(generator, scale)
    source = generator.random((n, 3))
    target = _move(T, source) + noise * generator.standard_normal((n, 3))
    inliers, outliers = _split(n, outlier_ratio, generator)
    centre, radius = _move(T, np.full(3, 0.5)), scale * np.sqrt(3.0) / 2.0
    target[outliers] = centre + radius * _in_unit_ball(len(outliers), generator)
    return Pairs(source, target, T, inliers)


def relative_pose(n: int, outlier_ratio: float, noise: float, rng: Seed) -> ImageMatches:
    """Matched points of two cameras that look at the same scene, many of them wrong (Section 4.1 of the paper).

    In the first camera, normalised points are uniform in [-1, 1] along each axis and depths in [0.1, 10]. The
    second camera is 1 away and sees every point at a depth above 0.1 and within [-1, 1], too. Then Gaussian noise
    disturbs the points of both images, which may push some beyond 1, and a random share of the matches is
    replaced with points uniform in [-1, 1], in both images.

    The paper leaves the pose open. Here its centre is uniform on the sphere and its rotation uniform among all;
    it is drawn anew until a fifth of what the first camera sees is in sight of the second one. The optical axes
    then part by up to about 90 degrees, and one camera may stand on its head with respect to the other. Points
    that the second camera does not see are drawn anew. One seed gives the same pose for every `n`.

    Parameters
    ----------
    n : int
        Number of matches.
    outlier_ratio : float
        Share of wrong matches, from 0 to 1; their number is rounded to the nearest whole one.
    noise : float
        Standard deviation along each axis of both images, in normalised coordinates.
    rng : int or numpy.random.Generator

    Returns
    -------
    ImageMatches

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    _check_matches(n, outlier_ratio, noise)
    generator = _generator(rng)
    T = _second_camera(generator)
    points1, points2, _ = _seen_by_both(T, n, generator)
    inliers, outliers = _split(n, outlier_ratio, generator)
    _spoil(points1, outliers, noise, generator)
    _spoil(points2, outliers, noise, generator)
    return ImageMatches(points1, points2, T, inliers)


def absolute_pose(n: int, outlier_ratio: float, noise: float, rng: Seed) -> PointMatches:
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

    Returns
    -------
    PointMatches

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    _check_matches(n, outlier_ratio, noise)
    generator = _generator(rng)
    T = _second_camera(generator)
    points1, points2d, depths = _seen_by_both(T, n, generator)
    inliers, outliers = _split(n, outlier_ratio, generator)
    _spoil(points2d, outliers, noise, generator)
    return PointMatches(points2d, _lift(points1, depths), T, inliers)


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
    _check_count("points", points)
    _check_share("overlap", overlap)
    _check_not_negative("noise", noise)
    unit = _fit_unit_cube(cloud)
    shared = round(overlap * points)
    needed = 2 * points - shared
    if needed > len(unit):
        raise ValueError(
            f"cloud has {len(unit)} points; expected at least {needed}, for two subsets of {points} that share {shared}"
        )
    generator = _generator(rng)
    chosen = generator.choice(len(unit), needed, replace=False)
    first, second = generator.permutation(chosen[:points]), generator.permutation(chosen[points - shared :])
    T = _random_motion(generator)
    target = _move(T, unit[second]) + noise * generator.standard_normal((points, 3))
    return CloudPair(unit[first], target, T, shared / points)


def demo_scans(rng: Seed, points: int = 20_000, noise: float = 0.002) -> CloudPair:
    """Two partial, noisy scans of an elephant, about 1.6 long, from two directions about 40 degrees apart.

    The elephant is a smooth union of ellipsoids and tapered rods without any symmetry: its head is turned,
    its trunk bent, its ears differ. A scan holds points uniform on the surface that a distant sensor sees:
    what faces away, lies at a grazing angle or is hidden is left out. The two scans share no point but by
    chance. The target stands upright (x forward, z up); the source is turned at random and moved.

    Parameters
    ----------
    rng : int or numpy.random.Generator
    points : int
        Number of points in each scan.
    noise : float
        Standard deviation along each axis.

    Returns
    -------
    CloudPair
        `overlap` is the share of the points of the two scans that both sensors see, 0.6 to 0.7.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    _check_count("points", points)
    _check_not_negative("noise", noise)
    generator = _generator(rng)
    T = _random_motion(generator)
    scans, shares = [], []
    for sensor, other in ((_SENSORS[0], _SENSORS[1]), (_SENSORS[1], _SENSORS[0])):
        surface, normals = _scan(sensor, points, generator)
        shares.append(_visible(surface, normals, other).mean())
        scans.append(surface + noise * generator.standard_normal(surface.shape))
    source = (scans[0] - T[:3, 3]) @ T[:3, :3]
    return CloudPair(source, scans[1], T, float(np.mean(shares)))


# --- two cameras --------------------------------------------------------------------------


def _second_camera(generator: np.random.Generator) -> Floats:
    """Pose from the first camera to a random second one, which sees enough of what the first one sees."""
    T = np.eye(4)
    while True:
        T[:3, :3] = random_rotation(generator)
        direction = generator.standard_normal(3)
        T[:3, 3] = direction / np.linalg.norm(direction)
        if len(_shared_view(T, 1000, generator)[0]) >= 1000 * _LEAST_SHARED:
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
    depths = generator.uniform(_NEAR, _FAR, (draws, 1))
    moved = _move(T, _lift(points1, depths))
    seen = (moved[:, 2] > _NEAR) & (np.abs(moved[:, 0]) <= moved[:, 2]) & (np.abs(moved[:, 1]) <= moved[:, 2])
    moved = moved[seen]
    return points1[seen], moved[:, :2] / moved[:, 2:], depths[seen]


def _lift(points: Floats, depths: Floats) -> Floats:
    return np.concatenate([points * depths, depths], axis=1)


def _spoil(points: Floats, outliers: NDArray[np.int64], noise: float, generator: np.random.Generator) -> None:
    points += noise * generator.standard_normal(points.shape)
    points[outliers] = generator.uniform(-1.0, 1.0, (len(outliers), 2))


# --- motions and small helpers ------------------------------------------------------------


def _split(n: int, outlier_ratio: float, generator: np.random.Generator) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which of n matches are true ones, and the rows of the others."""
    outliers = generator.permutation(n)[: round(outlier_ratio * n)]
    inliers = np.ones(n, dtype=np.bool_)
    inliers[outliers] = False
    return inliers, outliers


def _generator(rng: Seed) -> np.random.Generator:
    if isinstance(rng, np.random.Generator):
        return rng
    if isinstance(rng, bool) or not isinstance(rng, (int, np.integer)) or rng < 0:
        raise TypeError(f"rng is {rng!r}; expected a whole number of at least 0 or a numpy.random.Generator")
    return np.random.default_rng(rng)


def _random_motion(generator: np.random.Generator, scale: float = 1.0) -> Floats:
    T = np.eye(4)
    T[:3, :3] = scale * random_rotation(generator)
    T[:3, 3] = generator.uniform(-1.0, 1.0, 3)
    return T


def _move(T: Floats, points: Floats) -> Floats:
    return points @ T[:3, :3].T + T[:3, 3]


def _in_unit_ball(n: int, generator: np.random.Generator) -> Floats:
    directions = generator.standard_normal((n, 3))
    radii = np.cbrt(generator.random((n, 1)))
    return np.asarray(radii * directions / np.linalg.norm(directions, axis=1, keepdims=True))


def _fit_unit_cube(cloud: ArrayLike) -> Floats:
    points = np.asarray(cloud, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"cloud has shape {points.shape}; expected (k, 3)")
    if not np.isfinite(points).all():
        raise ValueError("cloud holds NaN or infinity; expected finite points")
    longest = np.ptp(points, axis=0).max() if len(points) else 0.0
    if longest == 0.0:
        raise ValueError(f"cloud has {len(points)} points and no extent; expected points that differ")
    return np.asarray((points - points.min(axis=0)) / longest)


def _check_matches(n: int, outlier_ratio: float, noise: float) -> None:
    _check_count("n", n)
    _check_share("outlier_ratio", outlier_ratio)
    _check_not_negative("noise", noise)


def _check_count(name: str, value: int) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise ValueError(f"{name} is {value!r}; expected a whole number of at least 1")


def _check_share(name: str, value: float) -> None:
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"{name} is {value}; expected a number from 0 to 1")


def _check_not_negative(name: str, value: float) -> None:
    if not 0.0 <= value < np.inf:
        raise ValueError(f"{name} is {value}; expected a finite number of at least 0")


# --- the elephant -------------------------------------------------------------------------

# Ellipsoids: centre, radii, turn about z in degrees.
_ELLIPSOIDS = np.array(
    [
        [-0.05, 0.00, 0.62, 0.40, 0.25, 0.28, 0],  # body
        [0.43, -0.03, 0.80, 0.19, 0.17, 0.20, -15],  # head
        [0.30, -0.27, 0.77, 0.17, 0.035, 0.22, 35],  # right ear
        [0.40, 0.25, 0.80, 0.16, 0.035, 0.21, -50],  # left ear
    ]
)
# Tapered rods: one end and its radius, the other end and its radius.
_RODS = np.array(
    [
        [0.20, -0.13, 0.50, 0.100, 0.27, -0.14, 0.09, 0.090],  # right fore leg
        [0.20, 0.13, 0.50, 0.100, 0.15, 0.14, 0.09, 0.090],  # left fore leg
        [-0.28, -0.12, 0.50, 0.115, -0.38, -0.13, 0.09, 0.090],  # right hind leg
        [-0.28, 0.12, 0.50, 0.115, -0.22, 0.13, 0.09, 0.090],  # left hind leg
        [0.55, -0.06, 0.74, 0.100, 0.68, -0.11, 0.57, 0.080],  # trunk
        [0.68, -0.11, 0.57, 0.080, 0.73, -0.15, 0.40, 0.066],
        [0.73, -0.15, 0.40, 0.066, 0.81, -0.19, 0.28, 0.057],
        [0.81, -0.19, 0.28, 0.057, 0.92, -0.22, 0.28, 0.050],
        [0.92, -0.22, 0.28, 0.050, 0.98, -0.23, 0.38, 0.044],
        [0.55, -0.15, 0.68, 0.034, 0.75, -0.24, 0.63, 0.018],  # right tusk
        [0.58, 0.03, 0.68, 0.034, 0.74, 0.03, 0.60, 0.018],  # left tusk
        [-0.42, 0.00, 0.72, 0.035, -0.54, -0.05, 0.48, 0.020],  # tail
        [-0.54, -0.05, 0.48, 0.020, -0.55, -0.06, 0.40, 0.034],
    ]
)
_BLEND = 0.05
_BOX = np.array([[-0.65, -0.50, -0.05], [1.10, 0.50, 1.10]])
_CELL = 0.04
_SHELL = 0.01


def _direction(azimuth: float, elevation: float) -> Floats:
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


_SENSORS = (_direction(-70.0, 15.0), _direction(-27.0, 15.0))


def _distance(points: Floats) -> Floats:
    """Signed distance to the elephant, to first order near its surface and never much too long elsewhere."""
    x = np.ascontiguousarray(points.T)
    total = np.full(len(points), np.inf)
    for part in _ELLIPSOIDS:
        total = _smooth_minimum(total, _ellipsoid_distance(x, part))
    for part in _RODS:
        total = _smooth_minimum(total, _rod_distance(x, part))
    return total


def _smooth_minimum(a: Floats, b: Floats) -> Floats:
    closeness = np.maximum(_BLEND - np.abs(a - b), 0.0)
    return np.minimum(a, b) - closeness * closeness / (4.0 * _BLEND)


def _ellipsoid_distance(x: Floats, part: Floats) -> Floats:
    cosine, sine = np.cos(np.radians(part[6])), np.sin(np.radians(part[6]))
    u, v, w = x - part[:3, None]
    local = np.stack([cosine * u + sine * v, cosine * v - sine * u, w]) / part[3:6, None]
    gradient = local / part[3:6, None]
    length = np.sqrt(np.einsum("ij,ij->j", local, local))
    steepness = np.sqrt(np.einsum("ij,ij->j", gradient, gradient))
    return np.asarray(length * (length - 1.0) / (steepness + 1e-12))


def _rod_distance(x: Floats, part: Floats) -> Floats:
    start, axis = part[:3, None], (part[4:7] - part[:3])[:, None]
    offset = x - start
    along = np.clip((axis * offset).sum(axis=0) / (axis * axis).sum(), 0.0, 1.0)
    offset -= along * axis
    radius = part[3] + along * (part[7] - part[3])
    return np.asarray(np.sqrt(np.einsum("ij,ij->j", offset, offset)) - radius)


def _gradient(points: Floats) -> Floats:
    """Gradient of the distance from its values at the corners of a small tetrahedron."""
    step = 1e-5
    corners = np.array([[1.0, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]])
    slopes = [corner * _distance(points + step * corner)[:, None] for corner in corners]
    return np.asarray(np.sum(slopes, axis=0) / (4 * step))


@cache
def _cells_at_surface() -> Floats:
    """Lower corners of the cubes that the surface may pass: sampling these alone saves most of the work."""
    grid = np.meshgrid(*(np.arange(low, high, _CELL) for low, high in _BOX.T), indexing="ij")
    corners = np.stack(grid, axis=-1).reshape(-1, 3)
    reach = np.sqrt(3.0) * _CELL / 2 + 2 * _SHELL
    return np.asarray(corners[np.abs(_distance(corners + _CELL / 2)) < reach])


def _surface(cells: Floats, draws: int, generator: np.random.Generator) -> tuple[Floats, Floats]:
    """Points uniform on the surface, and normals: uniform in a thin shell about it, then pulled onto it."""
    points = cells[generator.integers(len(cells), size=draws)] + _CELL * generator.random((draws, 3))
    distance = _distance(points)
    near = np.abs(distance) < 2 * _SHELL
    points, distance = points[near], distance[near]
    gradient = _gradient(points)
    steepness = np.linalg.norm(gradient, axis=1)
    shell = np.abs(distance) < _SHELL * steepness
    points, distance, gradient = points[shell], distance[shell], gradient[shell] / steepness[shell, None] ** 2
    for _ in range(4):
        points = points - distance[:, None] * gradient
        distance = _distance(points)
    return points, gradient / np.linalg.norm(gradient, axis=1, keepdims=True)


def _visible(points: Floats, normals: Floats, sensor: Floats) -> NDArray[np.bool_]:
    """Which points a distant sensor in this direction sees: march towards it until something is hit."""
    seen = normals @ sensor > 0.15
    rays = np.flatnonzero(seen)
    travelled = np.full(len(rays), 0.02)
    for _ in range(60):
        clearance = _distance(points[rays] + travelled[:, None] * sensor)
        seen[rays[clearance < 1e-3]] = False
        going = (clearance >= 1e-3) & (travelled < 2.0)
        rays, travelled = rays[going], (travelled + clearance)[going]
    return seen


def _scan(sensor: Floats, points: int, generator: np.random.Generator) -> tuple[Floats, Floats]:
    cells = _cells_at_surface()
    kept, found = [], 0
    while found < points:
        surface, normals = _surface(cells, 6 * points + 1000, generator)
        seen = _visible(surface, normals, sensor)
        kept.append((surface[seen], normals[seen]))
        found += int(seen.sum())
    scan, facing = (np.concatenate(part)[:points] for part in zip(*kept, strict=True))
    return scan, facing
