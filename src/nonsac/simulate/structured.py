"""Matches whose wrong ones have structure, or that determine little: what real data have and uniform junk lacks."""

import numpy as np
from numpy.typing import NDArray

from nonsac.simulate.matches import ImageMatches, Pairs, PointMatches
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

_NO_TRUTH = np.full((4, 4), np.nan)
_WIDE = 0.6  # half the width of a wide image, in normalised coordinates


def blobs_in_images(n: int, blobs: int, spread: float, rng: Seed) -> ImageMatches:
    """Matches of two images that are few facts repeated: blobs of points, each matched with a blob anywhere.

    As a detector gives them that fires many times on one thing. `T` is NaN, as nothing relates the images.

    Parameters
    ----------
    n : int
        Number of matches.
    blobs : int
        Number of blobs.
    spread : float
        Standard deviation of the points of a blob along each axis, in normalised coordinates.
    rng : int or numpy.random.Generator

    Returns
    -------
    ImageMatches
    """
    check_count("n", n)
    check_count("blobs", blobs)
    check_not_negative("spread", spread)
    n, blobs, spread = int(n), int(blobs), float(spread)
    generator = generator_of(rng)
    first, second = generator.uniform(-_WIDE, _WIDE, (2, blobs, 2))
    of = generator.integers(blobs, size=n)
    points1, points2 = (centres[of] + spread * generator.standard_normal((n, 2)) for centres in (first, second))
    return ImageMatches(points1, points2, _NO_TRUTH.copy(), np.zeros(n, dtype=np.bool_))


def blobs_in_space(n: int, blobs: int, spread: float, rng: Seed) -> Pairs:
    """The same for pairs of 3D points, in a scene whose points have a standard deviation of 1 along each axis.

    Parameters
    ----------
    n, blobs : int
        Number of pairs, and of blobs.
    spread : float
        Standard deviation of the points of a blob along each axis.
    rng : int or numpy.random.Generator

    Returns
    -------
    Pairs
    """
    check_count("n", n)
    check_count("blobs", blobs)
    check_not_negative("spread", spread)
    n, blobs, spread = int(n), int(blobs), float(spread)
    generator = generator_of(rng)
    first, second = generator.standard_normal((2, blobs, 3))
    of = generator.integers(blobs, size=n)
    source, target = (centres[of] + spread * generator.standard_normal((n, 3)) for centres in (first, second))
    return Pairs(source, target, _NO_TRUTH.copy(), np.zeros(n, dtype=np.bool_))


def statue(n: int, outlier_ratio: float, noise: float, rng: Seed, base: float = 0.5) -> Pairs:
    """Pairs of a statue on a round base, turned by 70 to 100 degrees: the base matches itself, turned by less.

    The base, a disc with a rim, looks the same from all sides. Descriptors match its points with others of the same
    ring, and prefer those nearby on the ring, about one wrong angle of up to 30 degrees. The figure above it is a
    random smooth body, a share of whose matches are right; the others go to random points of it.

    Parameters
    ----------
    n : int
        Number of pairs.
    outlier_ratio : float
        Share of wrong matches of the figure.
    noise : float
        Standard deviation along each axis, where the base has the radius 1.
    rng : int or numpy.random.Generator
    base : float
        Share of the pairs that are on the base.

    Returns
    -------
    Pairs
    """
    check_count("n", n)
    check_share("outlier_ratio", outlier_ratio)
    check_share("base", base)
    check_not_negative("noise", noise)
    n, outlier_ratio, noise, base = int(n), float(outlier_ratio), float(noise), float(base)
    generator = generator_of(rng)
    on_base = round(base * n)
    radius = np.sqrt(generator.uniform(0.2, 1.0, on_base))
    on_rim = generator.random(on_base) < 0.4
    radius[on_rim] = 1.0
    height = np.where(on_rim, generator.uniform(-0.3, 0.0, on_base), 0.0)
    angle = generator.uniform(0.0, 2.0 * np.pi, on_base)
    slip = np.radians(generator.uniform(-30.0, 30.0)) + np.radians(8.0) * generator.standard_t(2, on_base)
    figure = _body(n - on_base, generator)
    turn = np.eye(4)
    turn[:3, :3] = rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(generator.uniform(70.0, 100.0)))
    matched = move(turn, figure)
    wrong = generator.permutation(n - on_base)[: round(outlier_ratio * (n - on_base))]
    matched[wrong] = matched[generator.permutation(n - on_base)[: len(wrong)]]
    source = np.concatenate([_on_ring(radius, angle, height), figure])
    target = np.concatenate([_on_ring(radius, angle + slip, height), matched])
    right = np.concatenate([np.zeros(on_base, dtype=np.bool_), np.ones(n - on_base, dtype=np.bool_)])
    right[on_base + wrong] = False
    pose = random_motion(generator)
    order = generator.permutation(n)
    noisy = move(pose, target) + noise * generator.standard_normal((n, 3))
    return Pairs(source[order], noisy[order], pose @ turn, right[order])


def periodic_texture(n: int, slipped: float, noise: float, rng: Seed, scattered: bool = False) -> ImageMatches:
    """Matches of a wall with a repetitive texture, many of them displaced by a period or more.

    The wall, 8 wide, is 6 away and repeats every .5; a third of the points lie before or behind it, and their matches
    are right. The camera moves by 1 along the wall and turns by some degrees.

    Parameters
    ----------
    n : int
        Number of matches.
    slipped : float
        Share of the wall's matches that are displaced.
    noise : float
        Standard deviation along each axis of both images, in normalised coordinates.
    rng : int or numpy.random.Generator
    scattered : bool
        Whether each match is displaced by a number of periods of its own, from one to three either way; otherwise
        all of them by the same single period.

    Returns
    -------
    ImageMatches
    """
    check_count("n", n)
    check_share("slipped", slipped)
    check_not_negative("noise", noise)
    if not isinstance(scattered, (bool, np.bool_)):
        raise TypeError(f"scattered is {shown(scattered)}; expected True or False")
    n, slipped, noise = int(n), float(slipped), float(noise)
    generator = generator_of(rng)
    on_wall = generator.random(n) < 2.0 / 3.0
    points = np.column_stack([generator.uniform(-4.0, 4.0, n), generator.uniform(-3.0, 3.0, n), np.full(n, 6.0)])
    points[~on_wall, 2] = generator.uniform(4.0, 9.0, np.count_nonzero(~on_wall))
    wrong = on_wall & (generator.random(n) < slipped)
    periods = generator.integers(1, 4, n) * generator.choice([-1, 1], n) if scattered else np.ones(n)
    seen = points.copy()
    seen[wrong, 0] += 0.5 * periods[wrong]
    T = np.eye(4)
    T[:3, :3] = _small_rotation(generator, 8.0)
    T[:3, 3] = -T[:3, :3] @ [1.0, 0.0, 0.1 * generator.standard_normal()]
    return _seen(points, seen, T, ~wrong, noise, generator)


def narrow_view(n: int, outlier_ratio: float, noise: float, rng: Seed, degrees: float = 11.0) -> ImageMatches:
    """Two views of an object through a long lens, as on a turntable that turns by 5 to 25 degrees.

    Parameters
    ----------
    n : int
        Number of matches.
    outlier_ratio : float
        Share of wrong matches, uniform over the object in the second image.
    noise : float
        Standard deviation along each axis of both images, as a share of half the image's width.
    rng : int or numpy.random.Generator
    degrees : float
        Field of view, which the object fills; from 0.1 to 170.

    Returns
    -------
    ImageMatches
    """
    check_count("n", n)
    check_share("outlier_ratio", outlier_ratio)
    check_not_negative("noise", noise)
    if not 0.1 <= as_real(degrees) <= 170.0:
        raise ValueError(f"degrees is {shown(degrees)}; expected a number from 0.1 to 170")
    n, outlier_ratio, noise, degrees = int(n), float(outlier_ratio), float(noise), float(degrees)
    generator = generator_of(rng)
    half = np.tan(np.radians(0.5 * degrees))
    points = _body(n, generator)[:, [0, 2, 1]]  # upright in the image
    points[:, 1] -= 0.8
    distance = float((np.abs(points[:, :2]).max(axis=1) / half - points[:, 2]).max())
    points[:, 2] += distance
    T = np.eye(4)
    axis = np.array([0.0, 1.0, 0.0]) + 0.3 * generator.standard_normal(3)
    T[:3, :3] = rotation_about(axis, np.radians(generator.uniform(5.0, 25.0)) * generator.choice([-1.0, 1.0]))
    centre = np.array([0.0, 0.0, distance])
    T[:3, 3] = centre - T[:3, :3] @ centre
    seen, right = points.copy(), np.ones(n, dtype=np.bool_)
    wrong = generator.permutation(n)[: round(outlier_ratio * n)]
    seen[wrong] = points[generator.permutation(n)[: len(wrong)]]
    right[wrong] = False
    return _seen(points, seen, T, right, noise * half, generator)


def local_displacements(n: int, displaced: float, reach: float, noise: float, rng: Seed) -> ImageMatches:
    """Matches of a camera that only turns, many of them displaced by some pixels, as those of a tracker.

    There is no baseline, so that `T` has a translation of NaN: the rotation is all that is determined.

    Parameters
    ----------
    n : int
        Number of matches.
    displaced : float
        Share of displaced matches.
    reach : float
        Largest displacement, in normalised coordinates, from 0 to 1.
    noise : float
        Standard deviation along each axis of both images, in normalised coordinates.
    rng : int or numpy.random.Generator

    Returns
    -------
    ImageMatches
    """
    check_count("n", n)
    check_share("displaced", displaced)
    check_share("reach", reach)
    check_not_negative("noise", noise)
    n, displaced, reach, noise = int(n), float(displaced), abs(float(reach)), float(noise)
    generator = generator_of(rng)
    points = np.column_stack([generator.uniform(-_WIDE, _WIDE, (n, 2)), np.ones(n)])
    T = np.eye(4)
    T[:3, :3] = _small_rotation(generator, 8.0)
    matches = _seen(points, points, T, np.ones(n, dtype=np.bool_), noise, generator)
    wrong = generator.random(n) < displaced
    matches.points2[wrong] += generator.uniform(-reach, reach, (np.count_nonzero(wrong), 2))
    T[:3, 3] = np.nan
    return ImageMatches(matches.points1, matches.points2, T, ~wrong)


def moving_object(n: int, moving: float, outlier_ratio: float, noise: float, rng: Seed) -> ImageMatches:
    """Two views of a scene in which a compact object moved on its own; `T` is the motion of the scene.

    Parameters
    ----------
    n : int
        Number of matches.
    moving : float
        Share of the matches that are on the object.
    outlier_ratio : float
        Share of wrong matches in all.
    noise : float
        Standard deviation along each axis of both images, in normalised coordinates.
    rng : int or numpy.random.Generator

    Returns
    -------
    ImageMatches
    """
    check_count("n", n)
    check_share("moving", moving)
    check_share("outlier_ratio", outlier_ratio)
    check_not_negative("noise", noise)
    n, moving, outlier_ratio, noise = int(n), float(moving), float(outlier_ratio), float(noise)
    generator = generator_of(rng)
    depth = generator.uniform(4.0, 12.0, n)
    points = np.column_stack([generator.uniform(-_WIDE, _WIDE, (n, 2)) * depth[:, None], depth])
    on_object = np.arange(n) < round(moving * n)
    middle = np.array([*generator.uniform(-1.5, 1.5, 2), 6.0])
    points[on_object] = middle + generator.uniform(-1.0, 1.0, (np.count_nonzero(on_object), 3))
    own = np.eye(4)
    own[:3, :3] = _small_rotation(generator, 15.0)
    own[:3, 3] = middle - own[:3, :3] @ middle + generator.uniform(-1.0, 1.0, 3)
    seen = points.copy()
    seen[on_object] = move(own, points[on_object])
    T = np.eye(4)
    T[:3, :3] = _small_rotation(generator, 10.0)
    T[:3, 3] = generator.standard_normal(3)
    right = ~on_object
    wrong = generator.permutation(n)[: round(outlier_ratio * n)]
    seen[wrong] = points[generator.permutation(n)[: len(wrong)]]
    right[wrong] = False
    return _seen(points, seen, T, right, noise, generator)


def two_planes(n: int, outlier_ratio: float, noise: float, rng: Seed) -> PointMatches:
    """One view of two walls that meet in a corner, as in a room.

    Parameters
    ----------
    n : int
        Number of matches.
    outlier_ratio : float
        Share of wrong matches.
    noise : float
        Standard deviation along each axis of the image, in normalised coordinates.
    rng : int or numpy.random.Generator

    Returns
    -------
    PointMatches
    """
    check_count("n", n)
    check_share("outlier_ratio", outlier_ratio)
    check_not_negative("noise", noise)
    n, outlier_ratio, noise = int(n), float(outlier_ratio), float(noise)
    generator = generator_of(rng)
    along, height, left = generator.uniform(0.0, 3.0, n), generator.uniform(-1.5, 1.5, n), generator.random(n) < 0.5
    points = np.column_stack([np.where(left, along, 0.0), height, np.where(left, 0.0, along)])
    T = np.eye(4)
    T[:3, :3] = random_rotation(generator)
    T[:3, 3] = [*generator.uniform(-0.5, 0.5, 2), generator.uniform(5.0, 8.0)] - T[:3, :3] @ [1.0, 0.0, 1.0]
    seen = move(T, points)
    image = seen[:, :2] / seen[:, 2:] + noise * generator.standard_normal((n, 2))
    wrong, right = generator.permutation(n)[: round(outlier_ratio * n)], np.ones(n, dtype=np.bool_)
    image[wrong] = image[generator.permutation(n)[: len(wrong)]]
    right[wrong] = False
    return PointMatches(image, points, T, right)


def _on_ring(radius: Floats, angle: Floats, height: Floats) -> Floats:
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])


def _body(n: int, generator: np.random.Generator) -> Floats:
    """Points of a random smooth surface about 1.5 high, above the origin."""
    directions = generator.standard_normal((n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    waves, phases = 2.5 * generator.standard_normal((6, 3)), generator.uniform(0.0, 2.0 * np.pi, 6)
    radius = 0.6 * np.exp(0.25 * np.cos(directions @ waves.T + phases).sum(axis=1) / np.sqrt(3.0))
    return directions * radius[:, None] * [0.7, 0.5, 1.2] + [0.0, 0.0, 0.8]


def _small_rotation(generator: np.random.Generator, degrees: float) -> Floats:
    return rotation_about(generator.standard_normal(3), np.radians(generator.uniform(0.3 * degrees, degrees)))


def _seen(
    points: Floats, seen: Floats, T: Floats, right: NDArray[np.bool_], noise: float, generator: np.random.Generator
) -> ImageMatches:
    """What two cameras see: the first of `points`, the second of `seen`, both in the frame of the first."""
    moved, T = move(T, seen), T.copy()
    length = np.linalg.norm(T[:3, 3])
    T[:3, 3] /= length or 1.0
    first, second = points[:, :2] / points[:, 2:], moved[:, :2] / moved[:, 2:]
    first += noise * generator.standard_normal(first.shape)
    second += noise * generator.standard_normal(second.shape)
    return ImageMatches(first, second, T, right)
