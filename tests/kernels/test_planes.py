import numpy as np
import pytest

from nonsac.kernels.planes import fit_planes


def planes(points, neighbors):
    moved, normals, variation = (np.full(shape, np.nan) for shape in (points.shape, points.shape, len(points)))
    fit_planes(points, neighbors, moved, normals, variation)
    return moved, normals, variation


@pytest.mark.parametrize("offset", [0.0, 1e3])
def test_equals_the_singular_vectors_of_each_neighbourhood(rng, offset):
    points = rng.standard_normal((40, 3)) + offset
    neighbors = np.stack([rng.choice(40, 9, replace=False) for _ in range(40)])
    moved, normals, variation = planes(points, neighbors)
    for i in range(40):
        mean = points[neighbors[i]].mean(axis=0)
        _, deviations, axes = np.linalg.svd(points[neighbors[i]] - mean)
        assert abs(normals[i] @ axes[2]) == pytest.approx(1.0)
        assert variation[i] == pytest.approx(deviations[2] ** 2 / (deviations**2).sum())
        np.testing.assert_allclose(moved[i], points[i] - ((points[i] - mean) @ axes[2]) * axes[2], atol=1e-8)


def test_points_of_a_plane_stay_where_they_are(rng):
    points = rng.standard_normal((30, 3)) * [1.0, 1.0, 0.0] + [0.0, 0.0, 5.0]
    moved, normals, variation = planes(points, np.tile(np.arange(30), (30, 1)))
    np.testing.assert_allclose(moved, points, atol=1e-12)
    np.testing.assert_allclose(np.abs(normals), np.tile([0.0, 0.0, 1.0], (30, 1)), atol=1e-12)
    np.testing.assert_allclose(variation, 0.0, atol=1e-12)


def test_identical_points_have_no_variation():
    points = np.ones((5, 3))
    moved, normals, variation = planes(points, np.tile(np.arange(5), (5, 1)))
    np.testing.assert_allclose(moved, points)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    np.testing.assert_array_equal(variation, 0.0)
