"""No warning of NumPy's leaves the package, whatever the numbers are."""

import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import nonsac
from nonsac import simulate
from nonsac.values.quiet import quiet

VIEWS = simulate.relative_pose(60, 0.3, 0.001, 0)
SCENE = simulate.absolute_pose(60, 0.3, 0.001, 0)
PAIRS = simulate.registration(60, 0.3, 0.01, 0)


def one_row(points, value):
    points = points.copy()
    points[0] = value
    return points


HARD = {
    "one huge": lambda points: one_row(points, 1e300),
    "one large": lambda points: one_row(points, 1e154),
    "one denormal": lambda points: one_row(points, 5e-324),
    "all huge": lambda points: np.clip(points, -1, 1) * 1e300,
    "all tiny": lambda points: points * 1e-310,
    "beyond doubles": lambda points: points.astype(np.longdouble) * np.longdouble("1e4000"),
    "largest halves": lambda points: (np.sign(points) * 65504).astype(np.float16),
    "infinite": lambda points: one_row(points, np.inf),
    "the same": lambda points: np.zeros_like(points),
}
CALLS = {
    "relative": lambda f, **options: nonsac.relative_pose(f(VIEWS.points1), f(VIEWS.points2), **options),
    "lens": lambda f, **options: nonsac.relative_pose(
        f(VIEWS.points1 * 500), VIEWS.points2 * 500, "FULL_OPENCV 500 500 0 0 0.1 0 0 0 0 0.2 0 0", **options
    ),
    "absolute": lambda f, **options: nonsac.absolute_pose(SCENE.points2d, f(SCENE.points3d), **options),
    "pairs": lambda f, **options: nonsac.register_pairs(f(PAIRS.source), PAIRS.target, **options),
    "scaled": lambda f, **options: nonsac.register_pairs(
        f(PAIRS.source), f(PAIRS.target), scale=None, refine="full", **options
    ),
    "weights": lambda f, **options: nonsac.register_pairs(
        PAIRS.source, PAIRS.target, weights=np.append(np.abs(f(PAIRS.source))[1:, 0], 1), **options
    ),
    "clouds": lambda f, **options: nonsac.register_clouds(f(PAIRS.source), f(PAIRS.target), samples=1, workers=1),
}


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("kind", HARD)
def test_nothing_is_warned_of_but_by_us(kind, call, workers):
    def changed(points):
        with np.errstate(all="ignore"):
            return HARD[kind](points)

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = CALLS[call](changed, noise=0.01, workers=workers)
        if call != "clouds":
            assert len(result.residuals) == len(result.inliers) == 60
        assert repr(result)
        assert result.to_json()
    assert [str(warning.message) for warning in caught if issubclass(warning.category, RuntimeWarning)] == []


def test_the_state_of_numpy_is_put_back():
    @quiet
    def divided(depth):
        return np.ones(1) / 0 if depth == 0 else divided(depth - 1)

    before = np.geterr()
    with ThreadPoolExecutor(4) as pool:
        assert all(np.isinf(value) for value in pool.map(divided, [2] * 50))
    assert np.isinf(divided(3))
    assert np.geterr() == before
    with pytest.raises(RuntimeWarning, match="divide by zero"):
        np.ones(1) / 0
