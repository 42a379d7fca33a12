"""What a problem has that says no more than it has to, and what is said to one that breaks its contract."""

import dataclasses
import pickle

import numpy as np
import pytest

import naive
import nonsac
from nonsac import Layout, Noise, Problem, Rows, SpecialCase
from nonsac.problems import ContractBroken, Streaming
from nonsac.problems.contract import refitted, solved
from nonsac.problems.fits import inlier_fit, reweighted_fit

LINE = naive.Line()
NEEDED = ["layout", "minimal_size", "solve_minimal", "residuals", "refit"]


@pytest.fixture
def scene(rng):
    """Points of which half lie near a line, and this line."""
    model, points = naive.line_model(30.0, 0.4), rng.uniform(-1, 1, (100, 2))
    points[:50] += (0.4 + 0.01 * rng.standard_normal((50, 1)) - points[:50] @ model[:2, None]) * model[:2]
    return points, model


# --- deriving ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("missing", NEEDED)
def test_a_problem_without_what_it_needs_is_refused_by_name(missing):
    members = {name: getattr(naive.Line, name) for name in NEEDED if name != missing}
    with pytest.raises(TypeError, match=rf"Incomplete.*{missing}"):
        type("Incomplete", (Problem,), members)()


def test_what_it_needs_is_enough():
    problem = type("Complete", (Problem,), {name: getattr(naive.Line, name) for name in NEEDED})()
    assert problem.model_shape == (3, 4)
    assert problem.residual_dimension == 1
    assert problem.streaming is None
    assert problem.special_cases(None, np.ones((5, 2)), Noise.given(0.1)) == ()
    assert problem.covariance(None, np.ones((5, 2)), Noise.given(0.1)) is None
    assert problem.transform(None) is None


def test_what_only_looks_like_a_problem_is_refused():
    class Lookalike:
        layout, minimal_size, model_shape = LINE.layout, LINE.minimal_size, LINE.model_shape
        solve_minimal, residuals, refit = LINE.solve_minimal, LINE.residuals, LINE.refit

    with pytest.raises(TypeError, match=r"derived from nonsac\.Problem, got Lookalike"):
        nonsac.estimate(nonsac.ArraySource(np.ones((9, 2))), Lookalike(), noise=0.1)


def test_sums_for_all_rows_are_there_if_they_are_derived():
    assert nonsac.Registration().streaming == nonsac.Registration()
    assert all(isinstance(p, Streaming) for p in (nonsac.Registration(), nonsac.RelativePose(), nonsac.AbsolutePose()))
    assert naive.Shift().streaming is None


# --- defaults ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("weighted", [False, True])
def test_inliers_of_many_models_are_counted_in_blocks(rng, weighted):
    """Of a million residuals at once; here there are three million."""
    rows = rng.uniform(-1, 1, (5000, 2))
    models = np.array([naive.line_model(*pair) for pair in zip(np.arange(600) / 4, rng.normal(size=600), strict=True)])
    weights = rng.uniform(0, 2, 5000) if weighted else np.ones(5000)
    counts = LINE.count_inliers(models, rows, 0.1, weights if weighted else None)
    expected = [weights[np.abs(rows @ model[:2] - model[2]) < 0.1].sum() for model in models]
    np.testing.assert_allclose(counts, expected)
    assert counts.dtype.kind == ("f" if weighted else "i")
    assert LINE.count_inliers(models[:0], rows, 0.1, weights if weighted else None).shape == (0,)


def test_rows_that_are_none_hold_no_inliers():
    model = naive.line_model(30.0, 0.4)[None]
    assert LINE.count_inliers(model, np.empty((0, 2)), 0.1).tolist() == [0]
    assert LINE.count_inliers(model, np.empty((0, 2)), 0.1, np.empty(0)).tolist() == [0.0]


def test_the_robust_fit_is_where_tukeys_loss_is_least(scene):
    points, model = scene
    weights = np.linspace(0.5, 2, 100)
    fitted = LINE.fit_robustly(model, points, weights, 0.05, 200)

    def loss(change):
        degrees = np.degrees(np.arctan2(fitted[1], fitted[0])) + change[0]
        distances = np.abs(points @ naive.line_model(degrees, 0)[:2] - fitted[2] - change[1])
        return sum(w * naive.tukey(r, 0.05)[0] for w, r in zip(weights, distances, strict=True))

    assert np.abs(naive.gradient(loss, np.zeros(2), 1e-5)).max() < 1e-5
    assert loss([0, 0]) < min(loss([0.1, 0]), loss([-0.1, 0]), loss([0, 0.001]), loss([0, -0.001]))
    assert LINE.distance(fitted, LINE.refit(model, points, weights)) > 1.0


def test_a_robust_fit_takes_no_more_steps_than_it_is_given(scene):
    points, model = scene

    class Counted(naive.Line):
        fits = 0

        def refit(self, *arguments):
            self.fits += 1
            return super().refit(*arguments)

    for steps in (0, 1, 3):
        problem = Counted()
        problem.fit_robustly(model, points, np.ones(100), 0.05, steps)
        assert problem.fits == steps


def test_a_fit_to_rows_that_are_all_far_away_is_the_start(scene):
    points, model = scene
    far = Rows(points + 100.0)
    np.testing.assert_array_equal(reweighted_fit(LINE, model, far, 0.05, 20), model)
    np.testing.assert_array_equal(inlier_fit(LINE, model, far, 0.05), model)


@pytest.mark.parametrize("degrees", [0.0, 1e-5, 1.0, 60.0, 90.0])
def test_models_differ_by_the_angle_between_their_numbers(degrees):
    a, b = naive.line_model(20.0, 0.0), naive.line_model(20.0 + degrees, 0.0)
    for factor in (1.0, 3.0, -1.0):
        assert LINE.distance(a, factor * b) == pytest.approx(degrees, abs=1e-9, rel=1e-6)
    assert LINE.distance(a, naive.line_model(170.0, 0.0)) == pytest.approx(30.0)


def test_models_of_any_shape_differ_by_an_angle(rng):
    class Homography(naive.Line):
        model_shape = (3, 3)

    a, b = rng.standard_normal((2, 3, 3))
    angle = np.degrees(np.arccos(abs(a.ravel() @ b.ravel()) / np.linalg.norm(a) / np.linalg.norm(b)))
    assert Homography().distance(a, b) == pytest.approx(angle)
    table = Homography().distance(np.stack([a, b])[:, None], np.stack([a, -2 * b])[None])
    np.testing.assert_allclose(table, [[0, angle], [angle, 0]], atol=1e-9)


def test_as_many_different_rows_as_a_minimal_sample_determine_a_model(rng):
    noise, rows = Noise.given(0.1), rng.standard_normal((2, 2))
    assert LINE.determined(LINE.no_model, rows, noise)
    assert LINE.determined(LINE.no_model, np.repeat(rows, 5, axis=0), noise)
    assert not LINE.determined(LINE.no_model, np.repeat(rows[:1], 5, axis=0), noise)
    assert not LINE.determined(LINE.no_model, np.vstack([rows[:1], [[np.nan, 1.0], [np.inf, 2.0]]]), noise)
    assert not LINE.determined(LINE.no_model, rows[:0], noise)


def test_the_background_of_matches_is_other_matches(rng):
    """Each half of a row is one of the rows' halves, with each pair there is the other one, and no row is itself."""
    rows = np.arange(20.0)[:, None] + [0.0, 100.0]
    background = naive.Shift().background(rows, 1000, rng)
    first, second = background[:, 0], background[:, 1] - 100.0
    assert background.shape == (1000, 2)
    assert set(first) == set(second) == set(range(20))
    assert (first != second).all()
    np.testing.assert_array_equal(first[:500], second[500:])
    np.testing.assert_array_equal(first[500:], second[:500])


def test_the_background_of_one_match_is_that_match(rng):
    np.testing.assert_array_equal(naive.Shift().background(np.array([[1.0, 5.0]]), 4, rng), np.tile([1.0, 5.0], (4, 1)))


def test_the_background_of_points_is_as_wide_as_they_are(rng):
    rows = rng.uniform(-1, 1, (5000, 2)) * [1.0, 30.0] + [1.0, 0.0]
    background = LINE.background(rows, 5000, rng)
    assert background.shape == (5000, 2)
    np.testing.assert_allclose(background.mean(axis=0), rows.mean(axis=0), atol=1.0)
    np.testing.assert_allclose(background.std(axis=0), rows.std(axis=0), rtol=0.05)


def test_the_background_of_one_point_is_that_point(rng):
    np.testing.assert_array_equal(LINE.background(np.array([[2.0, 5.0]]), 4, rng), np.tile([2.0, 5.0], (4, 1)))


@pytest.mark.parametrize(
    ("attribute", "value", "told"),
    [
        ("layout", "x y", r"layout must be a nonsac\.Layout, such as .*, got 'x y'"),
        ("model_shape", 3, r"model_shape must be a tuple of integers, such as \(3,\) or \(3, 3\), got 3"),
        ("minimal_size", 2.0, r"minimal_size must be an integer of at least 1, got 2\.0"),
        ("residual_dimension", 0, r"residual_dimension must be an integer of at least 1, got 0"),
    ],
)
def test_attributes_are_checked_before_the_work(attribute, value, told):
    kind = type("Mine", (naive.Line,), {attribute: value})
    with pytest.raises(nonsac.ContractBroken, match=f"^Mine\\.{told}"):
        nonsac.estimate(nonsac.ArraySource(np.ones((9, 2))), kind(), noise=0.1)


class OneForAll(naive.Line):
    """Forgets that there are several models."""

    def residuals(self, models, rows):
        return np.abs(rows @ models[0, :2] - models[0, 2])


class Misspelt(naive.Line):
    def residuals(self, models, rows):
        return np.abs(models[:, :2] @ rows.T - models[:, 2:]).misspelt


class Unready(naive.Line):
    def solve_minimal(self, samples):
        raise NotImplementedError("later")


@pytest.mark.parametrize("noise", [0.01, None])
@pytest.mark.parametrize(
    ("kind", "told"),
    [
        (OneForAll, r"OneForAll\.residuals gave the shape \(\d+,\) for \d+ models and \d+ rows: return \(M, N\)"),
        (Misspelt, r"Misspelt\.residuals raised AttributeError: .* has no attribute 'misspelt'"),
        (Unready, r"Unready\.solve_minimal raised NotImplementedError: later"),
    ],
)
def test_faults_of_the_problem_are_told_of_the_problem(kind, told, noise, rng):
    with pytest.raises(nonsac.ContractBroken, match=told):
        nonsac.estimate(nonsac.ArraySource(rng.uniform(-1, 1, (500, 2))), kind(), noise=noise)


def test_singular_samples_cost_themselves_only(rng):
    class Solving(naive.Line):
        """y = a x + b, by NumPy, which raises for all samples if one is vertical."""

        def solve_minimal(self, samples):
            slopes = np.linalg.solve(np.stack([samples[..., 0], np.ones(samples.shape[:2])], axis=2), samples[..., 1:])
            a, b = slopes[:, 0, 0], slopes[:, 1, 0]
            return np.column_stack([a, -np.ones(len(a)), -b]) / np.hypot(a, 1.0)[:, None]

        def refit(self, model, rows, weights):
            if np.count_nonzero(weights) < 300:
                raise np.linalg.LinAlgError("Singular matrix")
            return super().refit(model, rows, weights)

    points = rng.uniform(-1, 1, (1000, 2))
    points[:500, 1] = 0.3 * points[:500, 0] + 0.01 * rng.standard_normal(500)
    points[500:700, 0] = 0.5
    assert nonsac.estimate(nonsac.ArraySource(points), Solving(), noise=0.01).success


# --- broken contracts -------------------------------------------------------------------------------------------------


class WrongShape(naive.Line):
    model_shape = (4,)


def test_models_of_another_shape_than_was_said_are_refused_with_what_to_do(scene):
    points, _ = scene
    with pytest.raises(
        ContractBroken, match=r"WrongShape\.solve_minimal gave .* \(3,\) instead of \(4,\).*model_shape"
    ):
        solved(WrongShape(), points[None, :2])
    with pytest.raises(ContractBroken, match=r"WrongShape\.refit gave .* \(3,\) instead of \(4,\)"):
        refitted(WrongShape(), np.ones(4), points, np.ones(100))
    with pytest.raises(ContractBroken, match=r"WrongShape\.solve_minimal"):
        nonsac.estimate(nonsac.ArraySource(points), WrongShape(), noise=0.01)


def test_a_problem_is_not_asked_for_models_of_no_samples(scene):
    class Particular(naive.Line):
        def solve_minimal(self, samples):
            return np.stack([self.refit(None, sample, np.ones(2)) for sample in samples])

    assert solved(Particular(), np.empty((0, 2, 2))).shape == (0, 3)
    assert solved(Particular(), scene[0][None, :2]).shape == (1, 3)


def test_whole_numbers_are_numbers(scene):
    class Whole(naive.Line):
        def solve_minimal(self, samples):
            return [[1, 0, 0]] * len(samples)

        def refit(self, model, rows, weights):
            return [0, 1, 0]

    points, model = scene
    assert solved(Whole(), points[None, :2]).dtype == np.float64
    assert refitted(Whole(), model, points, np.ones(100)).dtype == np.float64


# --- the small parts --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [True, False])
def test_a_noise_is_known_by_its_deviation_or_its_threshold(known):
    given, within = Noise.given(0.25, known), Noise.within(1.25, known)
    assert given == within == Noise(0.25, 1.25, known)
    assert Noise.given(1).known
    assert type(Noise.given(1).sigma) is type(Noise.within(np.float32(1)).threshold) is float
    with pytest.raises(dataclasses.FrozenInstanceError):
        given.sigma = 1.0


@pytest.mark.parametrize("threshold", [0.1, 0.05, 1 / 3, 1e-9])
def test_a_threshold_is_kept_to_the_last_bit(threshold):
    assert Noise.within(threshold).threshold == threshold
    assert Noise.given(threshold).sigma == threshold


def test_a_special_case_may_have_no_other_models():
    assert SpecialCase("flat", np.ones(3, bool), determined=True).others == ()


@pytest.mark.parametrize("value", [Noise.given(0.1), Layout("x y | z")], ids=["noise", "layout"])
def test_the_small_parts_travel_to_another_process(value):
    assert pickle.loads(pickle.dumps(value)) == value
