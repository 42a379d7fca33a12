"""Cameras that are not what is said of them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nonsac
from nonsac import Camera, Remark, Status
from nonsac.calls.image_area import remarks_on_image_area
from nonsac.evaluation import rotation_error
from nonsac.problems.two_view import Miscalibration, are_mirrored, miscalibrated_rotation

FOCAL, SIZE = 1000.0, np.array([1280.0, 720.0])


def pixels(points, rng, distortion=0.0):
    rays = points[:, :2] / points[:, 2:]
    rays = rays * (1.0 + distortion * (rays**2).sum(axis=1, keepdims=True))
    return FOCAL * rays + 0.5 * SIZE + rng.normal(scale=0.5, size=rays.shape)


def seen(points, rotation, shift, rng, distortion=0.0, outliers=0.3):
    """Pixels in both images, as far as they are inside of both."""
    moved = points @ rotation.T + shift
    first, second = pixels(points, rng, distortion), pixels(moved, rng, distortion)
    inside = (moved[:, 2] > 0.5) & ((second > 0.0) & (second < SIZE)).all(axis=1)
    first, second = first[inside], second[inside]
    wrong = rng.random(len(first)) < outliers
    second[wrong] = rng.uniform(0.0, SIZE, (np.count_nonzero(wrong), 2))
    return first, second


def cloud(rng, n=600):
    depth = rng.uniform(4.0, 12.0, n)
    return np.column_stack([*(rng.uniform(-0.5, 0.5, (2, n)) * SIZE[:, None] / FOCAL * depth), depth])


def turn(rng, degrees):
    axis = rng.standard_normal(3)
    return Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()


def camera(focal=FOCAL):
    return Camera("PINHOLE", (focal, focal, *(0.5 * SIZE)))


# --- rotations that look like translations ----------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.5, None])
@pytest.mark.parametrize("degrees", [6.0, 10.0, 15.0])
@pytest.mark.parametrize(("told", "distortion"), [(1.2, 0.0), (0.8, 0.0), (1.0, -0.2), (1.0, 0.15), (1.1, -0.1)])
def test_a_rotation_seen_with_a_wrong_calibration_is_no_translation(rng, told, distortion, degrees, noise):
    first, second = seen(cloud(rng), turn(rng, degrees), np.zeros(3), rng, distortion)
    result = nonsac.relative_pose(first, second, camera(told * FOCAL), noise=noise)
    assert result.status is Status.DEGENERATE, result
    assert result.info["remarks"][0].startswith(Remark.PURE_ROTATION)


@pytest.mark.parametrize("told", [1.2, 0.8])
def test_the_remark_says_which_focal_length_would_do(rng, told):
    first, second = seen(cloud(rng, 2000), turn(rng, 15.0), np.zeros(3), rng)
    (remark,) = nonsac.relative_pose(first, second, camera(told * FOCAL), noise=0.5).info["remarks"]
    factor = float(remark.removeprefix("pure rotation: with a focal length ").split()[0])
    assert factor == pytest.approx(1.0 / told, abs=0.05)


SCENES = {
    "cloud": cloud,
    "wall": lambda rng: cloud(rng) * [1, 1, 0] + [0, 0, 8.0],
    "slanted wall": lambda rng: (points := cloud(rng)) * [1, 1, 0] + (8.0 + points[:, :1] * [[0, 0, 0.4]]) * [0, 0, 1],
    "far away": lambda rng: 30.0 * cloud(rng),
    "shallow": lambda rng: cloud(rng) * [1, 1, 0.05] + [0, 0, 8.0],
}
SHIFTS = {"sideways": [1.0, 0.0, 0.0], "forward": [0.0, 0.0, -1.5], "askew": [0.6, -0.3, 0.5]}


@pytest.mark.parametrize("noise", [0.5, None])
@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("scene", ["cloud", "wall", "slanted wall", "shallow"])
@pytest.mark.parametrize("degrees", [0.0, 10.0])
def test_translations_stay_what_they_are(rng, scene, shift, degrees, noise):
    first, second = seen(SCENES[scene](rng), turn(rng, degrees), np.array(SHIFTS[shift]), rng)
    result = nonsac.relative_pose(first, second, camera(), noise=noise)
    assert result.status in (Status.OK, Status.AMBIGUOUS), result
    assert not any(str(remark).startswith(Remark.PURE_ROTATION) for remark in result.info["remarks"])


def test_the_calibration_is_found(rng):
    rotation = turn(rng, 12.0)
    points, true = cloud(rng, 300), Miscalibration(0.85, -0.15)
    right = np.hstack([points[:, :2] / points[:, 2:], (points @ rotation.T)[:, :2] / (points @ rotation.T)[:, 2:]])
    given = np.hstack([half / 0.85 * (1.0 - 0.15 * (half**2).sum(axis=1)[:, None]) for half in np.hsplit(right, 2)])
    start = np.column_stack([turn(rng, 1.0) @ rotation, [1.0, 0.0, 0.0]])
    model, found = miscalibrated_rotation(start, given, 1e-6)
    assert rotation_error(model[:, :3], rotation) < 0.01
    np.testing.assert_allclose(found, true, atol=2e-3)
    np.testing.assert_allclose(found.corrected(given), right, atol=2e-3)


# --- images that are not those of the camera --------------------------------------------------------------------------


def flipped(points):
    return np.column_stack([SIZE[0] - points[:, 0], points[:, 1]])


SPOILT = {
    "mirrored": (flipped, {Remark.MIRRORED}),
    "upside down": (lambda points: SIZE - flipped(points), {Remark.MIRRORED}),
    "x and y exchanged": (lambda points: points[:, ::-1].copy(), {Remark.MIRRORED, Remark.OTHER_IMAGE}),
    "half the size": (lambda points: 0.5 * points, {Remark.OTHER_IMAGE}),
    "twice the size": (lambda points: 2.0 * points, {Remark.OTHER_IMAGE}),
    "turned by 90 degrees": (lambda points: flipped(points)[:, ::-1].copy(), {Remark.OTHER_IMAGE}),
    "as it is": (lambda points: points, set()),
}


@pytest.mark.parametrize("noise", [0.5, None])
@pytest.mark.parametrize("name", SPOILT)
def test_what_is_wrong_with_the_second_image_is_told(rng, name, noise):
    first, second = seen(cloud(rng), turn(rng, 10.0), np.array([1.0, 0.2, 0.1]), rng)
    spoil, expected = SPOILT[name]
    result = nonsac.relative_pose(first, spoil(second), camera(), noise=noise)
    said = {kind for kind in (Remark.MIRRORED, Remark.OTHER_IMAGE) for each in result.remarks if each.startswith(kind)}
    assert said == expected if result.success else said <= expected


def test_pixels_of_another_image_are_told_to_absolute_pose(rng):
    points = cloud(rng)
    first, _ = seen(points, turn(rng, 10.0), np.array([1.0, 0.2, 0.1]), rng, outliers=0.0)
    for spoilt, expected in ((first, 0), (first[:, ::-1].copy(), 1), (0.5 * first, 1)):
        result = nonsac.absolute_pose(spoilt, points[: len(spoilt)], camera(), noise=0.5)
        assert sum(remark.startswith(Remark.OTHER_IMAGE) for remark in result.remarks) == expected


@pytest.mark.parametrize("size", [(None, None), (1280, 720)])
def test_the_area_of_an_image_is_known_or_taken_from_the_principal_point(rng, size):
    known = Camera("PINHOLE", (FOCAL, FOCAL, 640.0, 360.0), *size)
    inside = rng.uniform(0.0, SIZE, (500, 2))
    assert remarks_on_image_area(inside, "points1", known) == ()
    assert remarks_on_image_area(inside, "points1", None) == ()
    assert remarks_on_image_area(2.0 * inside[:40], "points1", known) == ()
    (told,) = remarks_on_image_area(2.0 * inside, "points1", known)
    assert told.startswith(f"{Remark.OTHER_IMAGE}: ")
    assert told.endswith("% of points1 are outside of about 1,280 x 720 pixels")
    (told,) = remarks_on_image_area(0.45 * inside, "points1", known)
    assert told.endswith("points1 are all in one corner, seen from the principal point")


@pytest.mark.parametrize("mirror", [True, False])
def test_mirrors_turn_the_affine_map_over(rng, mirror):
    points = rng.standard_normal((200, 2))
    linear = rng.standard_normal((2, 2))
    linear *= np.sign(np.linalg.det(linear)) ** np.array([[1], [0]])
    moved = points @ linear.T + rng.normal(scale=0.01, size=(200, 2)) + [3.0, 4.0]
    assert are_mirrored(points, moved * [-1.0 if mirror else 1.0, 1.0]) == mirror
    assert not are_mirrored(points, rng.standard_normal((200, 2)))
