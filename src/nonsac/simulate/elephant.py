"""Two scans of an elephant to look at."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from nonsac.simulate.clouds import CloudPair
from nonsac.simulate.motions import Floats, Seed, check_count, check_not_negative, generator_of, random_motion


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
    check_count("points", points)
    check_not_negative("noise", noise)
    points, noise = int(points), float(noise)
    generator = generator_of(rng)
    T = random_motion(generator)
    scans, shares = [], []
    for sensor, other in ((_SENSORS[0], _SENSORS[1]), (_SENSORS[1], _SENSORS[0])):
        surface, normals = _scan(sensor, points, generator)
        shares.append(_visible(surface, normals, other).mean())
        scans.append(surface + noise * generator.standard_normal(surface.shape))
    source = (scans[0] - T[:3, 3]) @ T[:3, :3]
    return CloudPair(source, scans[1], T, float(np.mean(shares)))


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
