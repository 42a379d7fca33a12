"""Means of motions that wrong ones among them do not drag along: L1 means, by Weiszfeld's algorithm."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nonsac.layouts import Array

_MOST_STEPS, _SETTLED, _SAME = 500, 1e-10, 1e-12


def mean_motion(models: Array, place: Array, is_direction: bool = False) -> Array:
    """The L1 mean of motions x -> s R x + t.

    Rotations by `mean_rotation`; scales by the median of their logarithms; translations by where the motions take one
    place, since far from the origin t says more about R than about the motion.

    Parameters
    ----------
    models : (M, 3, 4) float64
        `[s R | t]` with positive s.
    place : (3,) float64
    is_direction : bool
        Whether only the direction of t counts: it is averaged on the sphere, and has length 1.
    """
    scales = np.cbrt(np.linalg.det(models[:, :, :3]))
    linear = np.exp(np.median(np.log(scales))) * mean_rotation(models[:, :, :3] / scales[:, None, None])
    if is_direction:
        return np.column_stack([linear, mean_direction(models[:, :, 3])])
    return np.column_stack([linear, mean_point(models[:, :, :3] @ place + models[:, :, 3]) - linear @ place])


def mean_rotation(rotations: Array) -> Array:
    """The rotation (3, 3) with the least sum of angles to rotations (M, 3, 3).

    Hartley, Aftab and Trumpf, "L1 rotation averaging using the Weiszfeld algorithm", CVPR 2011: from the chordal L2
    mean, the one eigenvector, to the geodesic L1 mean.
    """
    quaternions = _quaternions(rotations)
    start = np.linalg.eigh(quaternions.T @ quaternions)[1][:, -1]
    return _matrix(_weiszfeld(start, lambda place: _turns(quaternions, place), _turned))


def mean_direction(directions: Array) -> Array:
    """The unit vector (3,) with the least sum of angles to unit vectors (M, 3)."""
    mean = directions.sum(axis=0)
    start = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > _SAME else directions[0]
    return _weiszfeld(start, lambda place: _arcs(directions, place), _moved_on_sphere)


def mean_point(points: Array) -> Array:
    """The geometric median (d,): the point with the least sum of distances to points (M, d)."""
    size = float(np.abs(points - points[0]).max()) or 1.0  # steps are compared with it
    scaled = (points - points[0]) / size
    found = _weiszfeld(scaled.mean(axis=0), lambda place: scaled - place, lambda place, step: place + step)
    return points[0] + size * found


def _weiszfeld(start: Array, logarithms: Callable[[Array], Array], moved: Callable[[Array, Array], Array]) -> Array:
    """The point of a manifold with the least sum of distances, from `start`.

    `logarithms` are the ways (M, p) from a place to all points, in the tangent space, and `moved` goes such a way. A
    place that is one of the points is held by it, unless the others pull more (Vardi and Zhang, "The multivariate
    L1-median and associated data depth", PNAS 2000).
    """
    place = start
    for _ in range(_MOST_STEPS):
        ways = logarithms(place)
        lengths = np.linalg.norm(ways, axis=1)
        away = lengths > _SAME
        if not away.any():
            break
        weights = 1.0 / lengths[away]
        pull = weights @ ways[away]
        hold = len(ways) - int(np.count_nonzero(away))
        step = max(0.0, 1.0 - hold / max(float(np.linalg.norm(pull)), _SAME)) * pull / weights.sum()
        place = moved(place, step)
        if np.linalg.norm(step) < _SETTLED:
            break
    return place


def _turns(quaternions: Array, place: Array) -> Array:
    """Rotation vectors (M, 3) from one unit quaternion w x y z to others (M, 4), no longer than pi."""
    w, x, y, z = place
    back = np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])  # q -> q * conjugate of place
    relative = quaternions @ back
    relative *= np.where(relative[:, :1] < 0.0, -1.0, 1.0)
    sines = np.linalg.norm(relative[:, 1:], axis=1)
    angles = 2.0 * np.arctan2(sines, relative[:, 0])
    return relative[:, 1:] * (angles / np.maximum(sines, np.finfo(np.float64).tiny))[:, None]


def _turned(place: Array, turn: Array) -> Array:
    """The unit quaternion after a turn by a rotation vector."""
    angle = np.linalg.norm(turn)
    half = 0.5 * np.sinc(angle / (2.0 * np.pi)) * turn  # sin(angle / 2) along the axis
    w, (x, y, z) = np.cos(0.5 * angle), half
    left = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    turned = left @ place
    return turned / np.linalg.norm(turned)


def _arcs(directions: Array, place: Array) -> Array:
    """The ways (M, 3) on the sphere from one unit vector to others, as tangents of the length of the angle."""
    along = directions @ place
    across = directions - along[:, None] * place
    sines = np.linalg.norm(across, axis=1)
    return across * (np.arctan2(sines, along) / np.maximum(sines, np.finfo(np.float64).tiny))[:, None]


def _moved_on_sphere(place: Array, step: Array) -> Array:
    angle = np.linalg.norm(step)
    moved = np.cos(angle) * place + np.sinc(angle / np.pi) * step
    return moved / np.linalg.norm(moved)


def _quaternions(rotations: Array) -> Array:
    """Unit quaternions w x y z (M, 4) of rotations (M, 3, 3), from the largest of the four numbers (Shepperd 1978)."""
    a, b, c = (rotations[:, i] for i in range(3))
    products = np.stack(  # four times w, x, y or z times all four
        [
            [1.0 + a[:, 0] + b[:, 1] + c[:, 2], c[:, 1] - b[:, 2], a[:, 2] - c[:, 0], b[:, 0] - a[:, 1]],
            [c[:, 1] - b[:, 2], 1.0 + a[:, 0] - b[:, 1] - c[:, 2], a[:, 1] + b[:, 0], a[:, 2] + c[:, 0]],
            [a[:, 2] - c[:, 0], a[:, 1] + b[:, 0], 1.0 - a[:, 0] + b[:, 1] - c[:, 2], b[:, 2] + c[:, 1]],
            [b[:, 0] - a[:, 1], a[:, 2] + c[:, 0], b[:, 2] + c[:, 1], 1.0 - a[:, 0] - b[:, 1] + c[:, 2]],
        ]
    )
    largest = np.argmax(np.einsum("iim->im", products), axis=0)
    chosen = products[largest, :, np.arange(len(rotations))]
    return chosen / np.linalg.norm(chosen, axis=1, keepdims=True)


def _matrix(quaternion: Array) -> Array:
    w, x, y, z = quaternion
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
