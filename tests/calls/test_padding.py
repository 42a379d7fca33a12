"""Rows that are equal to many others: padding of batches, pixels without a depth, a sensor that is stuck."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nonsac
from nonsac.evaluation import rotation_error

K = np.array([[1000.0, 0, 640], [0, 1000, 360], [0, 0, 1]])
R, T = Rotation.from_euler("xyz", [2, 15, 1], degrees=True).as_matrix(), np.array([1, 0.2, 0.1])
CALLS = {
    "relative_pose": lambda scene, **settings: nonsac.relative_pose(scene[0], scene[1], K, **settings),
    "absolute_pose": lambda scene, **settings: nonsac.absolute_pose(scene[1], scene[2], K, **settings),
    "register_pairs": lambda scene, **settings: nonsac.register_pairs(scene[2], scene[3], **settings),
}


def pixels(points, rng):
    return points[:, :2] / points[:, 2:] * 1000 + [640, 360] + rng.normal(scale=0.5, size=(len(points), 2))


def scene(rng, n, wrong):
    """Pixels in two images, points in the frame of the first camera and in that of the second."""
    depth = rng.uniform(4, 12, n)
    points = np.column_stack([rng.uniform(-0.6, 0.6, n) * depth, rng.uniform(-0.35, 0.35, n) * depth, depth])
    moved = points @ R.T + T
    first, second = pixels(points, rng), pixels(moved, rng)
    noisy = moved + rng.normal(scale=0.01, size=(n, 3))
    second[:wrong] = rng.uniform([0, 0], [1280, 720], (wrong, 2))
    noisy[:wrong] = rng.uniform([-6, -6, 2], [6, 6, 14], (wrong, 3))
    return [first, second, points, noisy]


def padded(scene, rng, copies, values):
    """Each part with so many more rows, which hold one of the values."""
    which = rng.integers(len(values), size=copies)
    return [np.vstack([part, np.tile(np.take(values, which)[:, None], (1, part.shape[1]))]) for part in scene]


@pytest.mark.parametrize("noise", [True, None])
@pytest.mark.parametrize("values", [[0.0], [-1.0, 0.0, 9999.0]], ids=["one", "three"])
@pytest.mark.parametrize("copies", [400, 2000, 20_000])
@pytest.mark.parametrize("name", CALLS)
def test_padding_hides_no_answer(rng, name, copies, values, noise):
    given = noise and (0.01 if name == "register_pairs" else 0.5)
    clean = scene(rng, 1000, 200)
    plain = CALLS[name](clean, noise=given)
    result = CALLS[name](padded(clean, rng, copies, values), noise=given)
    assert result.success, result
    assert rotation_error(result.R, R) < max(0.3, 3.0 * rotation_error(plain.R, R))
    assert result.num_inliers == pytest.approx(plain.num_inliers, rel=0.1)
    assert result.num_rows <= 1000 + 4 * len(values)
    assert f"rows are equal to others: {copies - len(values):,} of {1000 + copies:,}" in result.info["remarks"]


@pytest.mark.parametrize("name", CALLS)
def test_padding_does_not_bend_the_fit_to_all_rows(rng, name):
    """Every second row is one and the same, at the edge of the inliers of the right answer."""
    clean = scene(rng, 20_000, 4000)
    noise = 0.01 if name == "register_pairs" else 0.5
    spoilt = [np.vstack([part, np.tile(part[-1], (20_000, 1))]) for part in clean]
    for part in (spoilt[1], spoilt[3]):
        part[20_000:] += 1.5 * noise
    plain, result = (CALLS[name](each, noise=noise, refine="full") for each in (clean, spoilt))
    assert result.success
    assert result.num_rows == 20_000
    standard_error = np.degrees(np.sqrt(np.trace(plain.covariance[:3, :3])))
    assert rotation_error(result.R, plain.R) < 0.3 * standard_error
    np.testing.assert_allclose(np.diag(result.covariance), np.diag(plain.covariance), rtol=0.1)


@pytest.mark.parametrize("name", CALLS)
def test_rows_that_are_all_equal_are_degenerate(name):
    rows = [np.full((500, part), 300.0) for part in (2, 2, 3, 3)]
    result = CALLS[name](rows)
    assert result.status is nonsac.Status.DEGENERATE
    assert not result.found
