import numpy as np
import pytest

from nonsac.kernels.homography import homography_errors


def errors(homographies, rows, focals=(1.0, 1.0)):
    found = np.empty((len(homographies), len(rows)))
    homography_errors(homographies, np.ascontiguousarray(rows.T), *focals, found)
    return found


def errors_slowly(homography, row, focals):
    """By the homography's derivatives: how noise of one pixel in x1 arrives in the second image."""
    point = np.array([row[0], row[1], 1.0])
    seen = homography @ point
    if seen[2] <= 0.0:
        return np.nan
    derivative = (homography[:2, :2] - np.outer(seen[:2], homography[2, :2]) / seen[2]) / seen[2]
    magnified = abs(np.linalg.det(derivative)) * (focals[1] / focals[0]) ** 2
    return focals[1] * np.linalg.norm(seen[:2] / seen[2] - row[2:]) / np.sqrt(1.0 + magnified)


@pytest.mark.parametrize("focals", [(1.0, 1.0), (800.0, 500.0)])
def test_equals_the_definition(rng, focals):
    homographies, rows = rng.standard_normal((7, 3, 3)), rng.standard_normal((50, 4))
    slow = [[errors_slowly(h, row, focals) for row in rows] for h in homographies]
    assert 0.1 < np.isnan(slow).mean() < 0.9
    np.testing.assert_allclose(errors(homographies, rows, focals), slow, rtol=1e-9)


def test_a_point_that_is_seen_where_it_is_has_no_error(rng):
    homography = np.eye(3) + 0.1 * rng.standard_normal((3, 3))
    first = rng.uniform(-1, 1, (20, 2))
    seen = np.column_stack([first, np.ones(20)]) @ homography.T
    assert errors(homography[None], np.hstack([first, seen[:, :2] / seen[:, 2:]])).max() < 1e-12


def test_the_scale_of_a_homography_does_not_matter(rng):
    homography, rows = np.eye(3) + 0.1 * rng.standard_normal((3, 3)), rng.uniform(-1, 1, (20, 4))
    np.testing.assert_allclose(errors(3.0 * homography[None], rows), errors(homography[None], rows), rtol=1e-9)
