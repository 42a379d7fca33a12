"""Planes seen in two views: which plane fits a pose, and which second pose the same plane allows."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from nonsac.kernels.homography import homography_errors
from nonsac.kernels.pose_math import rotate
from nonsac.layouts import Array

_TRIPLETS = 40
_CLEARLY = 0.5
_STEPS, _SMALL, _INVERSIONS = 8, 1e-6, 4
_LARGEST_MISTAKE = np.array([0.4, 0.5])  # a focal length wrong by half; beyond, a long lens sees shifts as turns


def seen_through_plane(model: Array, plane: Array, points: Array) -> Array:
    """Where the second camera sees points (n, 2) of the first one that lie on planes n . X = 1 (..., 3): (..., n, 2).

    The homography R + t n^T (Hartley and Zisserman, Sec. 13.1); a zero plane is the plane at infinity. NaN if the
    point is not in front of the second camera.
    """
    homographies = _homographies(model, plane)
    moved = points @ np.swapaxes(homographies[..., :2], -1, -2) + homographies[..., None, :, 2]
    return np.asarray(moved[..., :2] / np.where(moved[..., 2:] > 0.0, moved[..., 2:], np.nan))


def _homographies(model: Array, plane: Array) -> Array:
    return np.asarray(model[:, :3] + model[:, 3, None] * plane[..., None, :])


def rotation_of(model: Array, rows: Array, error: Callable[[Array], Array]) -> Array:
    """The rotation without a baseline that most rows fit best, as a pose [R | t] with the t of a model.

    Kabsch's fit of the rays, three times to the better half of them: a pose with a baseline that explains a pure
    rotation has turned a little away from it. `error(model)` is the transfer error of all rows.
    """
    first, second = (_unit_rays(half) for half in (rows[:, :2], rows[:, 2:]))
    turned = model.copy()
    for _ in range(3):
        errors = np.nan_to_num(error(turned), nan=np.inf)
        near = errors <= np.median(errors)
        left, _, right = np.linalg.svd(second[near].T @ first[near])
        turned[:, :3] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return turned


class Miscalibration(NamedTuple):
    """What may be wrong with the calibration that both images share.

    Attributes
    ----------
    scale : float
        True normalised coordinates over the given ones, at the centre: the given focal length over the true one.
    bend : float
        The first coefficient of a radial distortion that was ignored.
    """

    scale: float
    bend: float

    @classmethod
    def at(cls, place: Array) -> Miscalibration:
        """From the logarithm of the scale, and the bend."""
        return cls(float(np.exp(place[0])), float(place[1]))

    def corrected(self, rows: Array) -> Array:
        """Rows (n, 4) as they would be with the right calibration."""
        given = self.scale * rows.reshape(-1, 2)
        square = (given**2).sum(axis=1)
        factor = np.ones(len(given))
        for _ in range(_INVERSIONS):
            factor = 1.0 / np.maximum(1.0 + self.bend * square * factor**2, 0.3)
        return (given * factor[:, None]).reshape(-1, 4)


def miscalibrated_rotation(turned: Array, rows: Array, least: float) -> tuple[Array, Miscalibration]:
    """The rotation, focal length and radial distortion that together leave the least of matches without a baseline.

    Gauss and Newton's method from a rotation [R | t] that fits about, with Cauchy's weights; `least` is the noise, in
    normalised coordinates. Misfit that grows towards the edge looks like parallax: a rotation seen with a wrong
    calibration may have a translation that explains all matches. Real parallax leaves as much as before, and ends it.
    """
    turned, place, first = np.array(turned, np.float64), np.zeros(2), np.inf
    for number in range(_STEPS):
        misfit, seen = _misfit(turned, place, rows)
        lengths = np.linalg.norm(misfit, axis=1)
        middle = float(np.median(lengths))
        first = middle if number == 0 else first
        if number == 2 and middle > max(0.5 * first, 2.0 * least):
            break
        weights = 1.0 / (1.0 + (lengths / max(least, middle)) ** 2)
        steps = [_misfit(turned, place + unit, rows)[0] - misfit for unit in _SMALL * np.eye(2)]
        slopes = np.concatenate([_slopes_of_turn(seen) * np.exp(-place[0]), np.stack(steps, axis=-1) / _SMALL], axis=-1)
        weighted = (weights[:, None, None] * slopes).reshape(-1, 5).T
        gradient = weighted @ misfit.ravel()
        step = np.linalg.lstsq(weighted @ slopes.reshape(-1, 5), gradient, rcond=1e-12)[0]
        rotate(turned, *-step[:3])
        place = np.clip(place - step[3:], -_LARGEST_MISTAKE, _LARGEST_MISTAKE)
    return turned, Miscalibration.at(place)


def _misfit(turned: Array, place: Array, rows: Array) -> tuple[Array, Array]:
    """How far the second points are from where they are seen, in given coordinates; and where, in right ones."""
    mistake = Miscalibration.at(place)
    corrected = mistake.corrected(rows)
    ray = corrected[:, :2] @ turned[:, :2].T + turned[:, 2]
    seen = ray[:, :2] / np.where(ray[:, 2:] > 0.0, ray[:, 2:], np.nan)
    return np.nan_to_num((seen - corrected[:, 2:]) / mistake.scale, nan=1.0), np.nan_to_num(seen)


def _slopes_of_turn(seen: Array) -> Array:
    """Derivatives (n, 2, 3) of normalised coordinates with respect to a rotation vector of the camera."""
    x, y = seen.T
    return np.stack([np.stack([-x * y, 1.0 + x**2, -y], axis=-1), np.stack([-1.0 - y**2, x * y, x], axis=-1)], axis=1)


def _unit_rays(points: Array) -> Array:
    rays = np.column_stack([points, np.ones(len(points))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def transfer_errors(model: Array, plane: Array, rows: Array, focals: tuple[float, float]) -> Array:
    """How far x2 is from where it is seen if the point lies on a plane (..., 3): (..., n).

    In units in which both images have noise 1.

    The noise of x1 is magnified on its way to the second image (by the square root of the homography's change of
    area); the distance in pixels is divided by the standard deviation that it has in each direction. NaN counts as far.
    """
    homographies = _homographies(model, plane)
    errors = np.empty((*homographies.shape[:-2], len(rows)))
    homography_errors(
        homographies.reshape(-1, 3, 3), np.ascontiguousarray(rows.T), *focals, errors.reshape(-1, len(rows))
    )
    return errors


def plane_of(model: Array, rows: Array, error: Callable[[Array], Array], threshold: float) -> Array:
    """The plane n (3,), with n . X = 1 in the first camera's frame, that most rows of a pose lie on; 0 if none does.

    `error` is the transfer error of all rows for planes (..., 3). Planes through three rows each are compared, the best
    one is fitted to its rows.
    """
    slope, inverse_depth = _inverse_depths(model, rows)
    rays = np.column_stack([rows[:, :2], np.ones(len(rows))])
    some = np.random.default_rng(len(rows)).integers(len(rows), size=(_TRIPLETS, 3))
    triplets = rays[some]
    solvable = np.abs(np.linalg.det(triplets)) > 1e-9
    planes = np.linalg.solve(triplets[solvable], inverse_depth[some[solvable]][..., None])[..., 0]
    if not len(planes):
        return np.zeros(3)
    best = planes[int(np.argmax(np.count_nonzero(error(planes) < threshold, axis=1)))]
    for _ in range(3):
        weights = slope * (error(best) < threshold)
        equations, values = rays * weights[:, None], inverse_depth * weights
        finite = np.isfinite(equations).all(axis=1) & np.isfinite(values)  # rows so far out that squares overflow
        if not finite.all():
            equations, values = equations[finite], values[finite]
        best = np.linalg.lstsq(equations, values, rcond=None)[0]
    return np.asarray(best)


def _inverse_depths(model: Array, rows: Array) -> tuple[Array, Array]:
    """How fast the second image moves with the inverse depth in the first, and the inverse depth that fits best."""
    turned = rows[:, :2] @ model[:, :2].T + model[:, 2]
    # x2 x (R x1 + inverse_depth t) = 0
    second = np.column_stack([rows[:, 2:], np.ones(len(rows))])
    constant, factor = np.cross(second, turned), np.cross(second, model[:, 3])
    square = np.maximum((factor**2).sum(axis=1), 1e-30)
    inverse_depth = -(constant * factor).sum(axis=1) / square
    depth = np.maximum(turned[:, 2] + inverse_depth * model[2, 3], 1e-3)
    return np.sqrt(square) / depth, inverse_depth


def pose_of_same_plane(model: Array, plane: Array, rows: Array) -> Array:
    """The other poses (K, 3, 4) that give the same homography with all points in front of both cameras.

    At most one, or two if the pose itself has points behind a camera.

    The analytical decomposition of a homography (Ma, Soatto, Kosecka and Sastry, "An Invitation to 3-D Vision",
    Sec. 5.3.3).
    """
    homography = model[:, :3] + np.outer(model[:, 3], plane)
    _, sizes, axes = np.linalg.svd(homography)
    homography, sizes = homography / sizes[1], sizes / sizes[1]
    if np.linalg.det(homography) <= 0.0 or sizes[0] - sizes[2] < 1e-6:
        return np.empty((0, 3, 4))
    v1, v2, v3 = axes
    along, across = np.sqrt(max(0.0, 1.0 - sizes[2] ** 2)), np.sqrt(max(0.0, sizes[0] ** 2 - 1.0))
    rays = np.column_stack([rows[:, :2], np.ones(len(rows))])
    found = []
    for side in (across, -across):
        u = (along * v1 + side * v3) / np.sqrt(sizes[0] ** 2 - sizes[2] ** 2)
        normal = np.cross(v2, u)
        before = np.column_stack([v2, u, normal])
        after = np.column_stack([homography @ v2, homography @ u, np.cross(homography @ v2, homography @ u)])
        rotation = after @ before.T
        shift = (homography - rotation) @ normal
        sign = np.sign(np.median(rays @ normal)) or 1.0
        size = np.linalg.norm(shift)
        in_front = (sign * rays @ normal > 0.0).mean() > 0.9
        if size > 1e-9 and in_front:
            found.append(np.column_stack([rotation, sign * shift / size]))
    others = [pose for pose in found if np.abs(pose - model).max() > 0.05]
    return np.stack(others) if others else np.empty((0, 3, 4))


def reversed_in_depth(model: Array, rows: Array) -> Array:
    """The pose (3, 4) for which what was near is far: with little perspective it gives nearly the same images.

    The turn about an axis across the line of sight changes its sign (Necker reversal; Koenderink and van Doorn, "Affine
    structure from motion", 1991); the middle of the scene stays where it is.
    """
    depth = 1.0 / max(float(np.median(_inverse_depths(model, rows)[1])), 1e-12)
    middle = depth * np.array([*np.median(rows[:, :2], axis=0), 1.0])
    second = model[:, :3] @ middle + model[:, 3]
    frame1, frame2 = _turn_to(middle), _turn_to(second)
    seen = frame2.T @ model[:, :3] @ frame1
    spin = _turn_to(seen[:, 2]).T @ seen
    rotation = frame2 @ _turn_to(seen[:, 2] * [-1.0, -1.0, 1.0]) @ spin @ frame1.T
    shift = second - rotation @ middle
    return np.column_stack([rotation, shift / max(float(np.linalg.norm(shift)), 1e-300)])


def _turn_to(direction: Array) -> Array:
    """The smallest rotation (3, 3) of the line of sight (0, 0, 1) to a direction."""
    x, y, z = direction / np.linalg.norm(direction)
    if z < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + z)


def are_mirrored(first: Array, second: Array) -> bool:
    """Whether points (n, 2) of one image lie in the other as in a mirror: the affine map between them turns over.

    Two cameras on the same side of a surface see it with the same orientation. The map must explain half of the
    spread in its weaker direction, too.
    """
    halves = [half - half.mean(axis=0) for half in (first, second)]
    even = [np.linalg.svd(half, full_matrices=False)[0] for half in halves]  # spread alike in all directions
    correlations = np.linalg.svd(even[0].T @ even[1], compute_uv=False)
    return bool(np.linalg.det(halves[0].T @ halves[1]) < 0.0 and correlations[1] > _CLEARLY)
