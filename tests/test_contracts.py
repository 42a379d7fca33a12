"""What somebody meets who writes a problem or an estimator of his own."""

import numpy as np
import pytest

import nonsac
from homography import Homography
from line import Line
from nonsac.problems.contract import ContractBroken
from nonsac.result import Remark, Status
from plane import Plane


def points_on_line(rng, angle, n=20_000, share=0.2, noise=0.005):
    normal = np.array([-np.sin(np.radians(angle)), np.cos(np.radians(angle))])
    points = rng.uniform(-1, 1, (n, 2))
    right = int(share * n)
    points[:right] += (0.2 - points[:right] @ normal + rng.normal(scale=noise, size=right))[:, None] * normal
    return nonsac.ArraySource(points), normal


def matches_of_plane(rng, n=4000, right=2000, noise=0.002):
    H = np.array([[0.9, -0.2, 0.1], [0.15, 1.1, -0.05], [0.2, -0.1, 1.0]])
    first = rng.uniform(-1, 1, (n, 2))
    seen = np.column_stack([first, np.ones(n)]) @ H.T
    second = seen[:, :2] / seen[:, 2:] + rng.normal(scale=noise, size=first.shape)
    second[right:] = rng.uniform(-1, 1, (n - right, 2))
    return nonsac.ArraySource(np.hstack([first, second])), H


class Polynomial(nonsac.Problem):
    """y = c_0 + c_1 x + ... + c_14 x^14: fifteen numbers."""

    layout, minimal_size, model_shape = nonsac.Layout("x y"), 15, (15,)

    def solve_minimal(self, samples):
        powers = samples[..., :1] ** np.arange(15)
        good = np.linalg.cond(powers) < 1e10
        return np.linalg.solve(powers[good], samples[good, :, 1:])[..., 0]

    def residuals(self, models, rows):
        return np.abs(models @ (rows[:, :1] ** np.arange(15)).T - rows[:, 1])

    def refit(self, model, rows, weights):
        root = np.sqrt(weights)
        return np.linalg.lstsq(rows[:, :1] ** np.arange(15) * root[:, None], rows[:, 1] * root, rcond=None)[0]


def test_a_model_may_have_more_than_twelve_numbers(rng):
    x = np.cos(np.pi * rng.uniform(0, 1, 3000))
    y = np.cos(3 * x) + rng.normal(scale=0.002, size=3000)
    y[:150] = rng.uniform(-2, 2, 150)
    source = nonsac.ArraySource(np.column_stack([x, y]))
    result = nonsac.estimate(source, Polynomial(), nonsac.Ransac(300, local_optimisation=True), noise=0.002)
    assert result.status is Status.OK
    assert result.model.shape == (15,)
    at = np.linspace(-0.9, 0.9, 50)
    np.testing.assert_allclose(at[:, None] ** np.arange(15) @ result.model, np.cos(3 * at), atol=0.003)


def test_a_homography_speaks_of_no_rotation(rng):
    source, H = matches_of_plane(rng)
    result = nonsac.estimate(source, Homography(), noise=0.002)
    assert result.status is Status.OK
    np.testing.assert_allclose(result.model / result.model[2, 2], H, atol=0.003)
    assert "rotation" not in repr(result)
    assert "model [" in repr(result)
    assert not result.is_motion
    for name in ("T", "R", "t", "scale"):
        with pytest.raises(AttributeError, match=r"a model of Homography is no motion.* see result\.model"):
            getattr(result, name)
    assert result.to_dict()["model"] == result.model.tolist()
    assert np.count_nonzero(result.inliers) == pytest.approx(2000, abs=60)


@pytest.mark.parametrize("noise", [0.005, None])
@pytest.mark.parametrize("angle", [0, 90])
def test_a_line_along_an_axis_is_trusted(rng, angle, noise):
    source, normal = points_on_line(rng, angle)
    result = nonsac.estimate(source, Line(), noise=noise)
    assert result.status is Status.OK
    assert abs(result.model[:2] @ normal) > 0.9999
    assert "x" in repr(result)


@pytest.mark.parametrize("noise", [0.02, None])
def test_level_ground_is_trusted(rng, noise):
    scan = rng.uniform([-30, -30, -3], [30, 30, 8], (30_000, 3))
    scan[:3000, 2] = -1.7 + rng.normal(scale=0.02, size=3000)
    result = nonsac.estimate(nonsac.ArraySource(scan), Plane(), noise=noise)
    assert result.status is Status.OK
    np.testing.assert_allclose(np.abs(result.model), [0, 0, 1, 1.7], atol=0.01)


def test_points_without_a_line_are_not_trusted(rng):
    for seed in range(5):
        points = nonsac.ArraySource(rng.uniform(-1, 1, (2000, 2)))
        assert not nonsac.estimate(points, Line(), noise=0.005, rng=seed).success


class WrongShape(Line):
    model_shape = (3, 4)


def test_a_model_of_another_shape_is_said_to_be_one(rng):
    source, _ = points_on_line(rng, 30)
    with pytest.raises(ContractBroken, match=r"WrongShape\.solve_minimal gave models of the shape \(3,\) instead of"):
        nonsac.estimate(source, WrongShape(), noise=0.005)


def test_what_is_missing_is_named():
    class NoSize(nonsac.Problem):
        layout = nonsac.Layout("x y")
        solve_minimal = residuals = refit = None

    with pytest.raises(TypeError, match=r"abstract .*minimal_size"):
        NoSize()
    with pytest.raises(TypeError, match=r"problem must be an object of a class derived from nonsac\.Problem"):
        nonsac.estimate(nonsac.ArraySource(np.zeros((9, 2))), object())
    with pytest.raises(TypeError, match=r"problem must be an object, got the class Line: write Line\(\.\.\.\)"):
        nonsac.estimate(nonsac.ArraySource(np.zeros((9, 2))), Line)


def test_an_array_in_place_of_a_source_is_not_printed():
    with pytest.raises(TypeError, match=r"wrap an array in nonsac\.ArraySource") as caught:
        nonsac.estimate(np.zeros((100, 2)), Line())
    assert len(str(caught.value)) < 200


class Watched(Line):
    fewest = 10**9

    def refit(self, model, rows, weights):
        type(self).fewest = min(type(self).fewest, np.count_nonzero(weights))
        return super().refit(model, rows, weights)


def test_a_fit_gets_at_least_as_many_rows_as_a_minimal_sample(rng):
    points = np.vstack([[[0.0, 0.0], [1.0, 1.0]], rng.uniform(-1, 1, (50, 2)) * [1, 1e-3] + [0, 5]])
    nonsac.estimate(nonsac.ArraySource(points), Watched(), noise=1e-6)
    assert 2 <= Watched.fewest < 10**9


def median_line(rows, threshold, seed):
    models = Line().solve_minimal(rows[np.random.default_rng(seed).choice(len(rows), (300, 2))])
    return models[np.argmin(np.median(Line().residuals(models, rows), axis=1))]


@pytest.mark.parametrize("noise", [0.005, None])
def test_an_estimator_that_does_not_say_how_much_it_tested_is_trusted(rng, noise):
    source, normal = points_on_line(rng, 20, share=0.7)
    result = nonsac.estimate(source, Line(), median_line, noise=noise)
    assert result.status is Status.OK
    assert all(h.tested is None for h in result.hypotheses)
    assert abs(result.model[:2] @ normal) > 0.9999


def test_an_estimator_that_fails_costs_its_sample(rng):
    source, _ = points_on_line(rng, 20, share=0.7)
    calls = []

    def sometimes(rows, threshold, seed):
        calls.append(seed)
        if len(calls) % 2:
            raise RuntimeError("out of luck")
        return median_line(rows, threshold, seed)

    result = nonsac.estimate(source, Line(), sometimes, noise=0.005, samples=4, workers=1)
    assert result.status is Status.OK
    (remark,) = [r for r in result.remarks if r.startswith(Remark.ESTIMATOR_FAILED)]
    assert remark.endswith(": 2 of 4 (RuntimeError: out of luck)")
    assert "out of luck" in repr(result)


def test_an_estimator_that_always_fails_ends_in_a_status(rng):
    source, _ = points_on_line(rng, 20, share=0.7)

    def never(rows, threshold, seed):
        raise RuntimeError("no")

    result = nonsac.estimate(source, Line(), never, noise=0.005)
    assert not result.success
    assert "8 of 8 (RuntimeError: no)" in repr(result)


def test_everything_public_is_listed():
    names = set(dir(nonsac))
    assert names >= {"Problem", "Estimator", "ScoringRule", "Refiner", "Source", "InputError", "io", "plot", "testing"}
    assert nonsac.plot.picture_suffix
