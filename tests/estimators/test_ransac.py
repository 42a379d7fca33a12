import importlib.util
from dataclasses import dataclass, field
from itertools import combinations, permutations
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chisquare

import naive
from nonsac import simulate
from nonsac.estimators import Ransac
from nonsac.estimators.ransac import _promising, minimal_samples
from nonsac.layouts import Layout, Rows
from nonsac.problems import AbsolutePose, Noise, Problem, Registration, RelativePose
from nonsac.problems.fits import biweight_costs, trials_needed
from nonsac.result import Hypothesis

NOISE = 1e-3
THRESHOLD = 5 * NOISE


@dataclass
class Constant(Problem):
    """A problem whose every sample gives a model with the same share of inliers; it takes down what is asked of it."""

    minimal_size: int = 3
    share: float = 0.5
    models_per_sample: int = 1
    samples: list = field(default_factory=list)

    layout = Layout("x | y")

    def solve_minimal(self, samples):
        self.samples.append(samples)
        return np.broadcast_to(np.eye(4)[:3], (len(samples) * self.models_per_sample, 3, 4))

    def residuals(self, models, rows):
        return np.broadcast_to(
            np.where(np.arange(len(rows)) < self.share * len(rows), 0.0, 9.0), (len(models), len(rows))
        )

    def refit(self, model, rows, weights):
        return model

    @property
    def drawn(self):
        return sum(map(len, self.samples))


def estimate(estimator, problem, rows, threshold=THRESHOLD, seed=0, weights=None):
    return estimator.estimate(problem, Rows(rows, weights), Noise.within(threshold), np.random.default_rng(seed))


def two_views(rng, n=400, outliers=0.5):
    matches = simulate.relative_pose(n, outliers, NOISE, rng)
    return np.hstack([matches.points1, matches.points2]), matches.T


def one_view(rng, n=400, outliers=0.5):
    matches = simulate.absolute_pose(n, outliers, NOISE, rng)
    return np.hstack([matches.points2d, matches.points3d]), matches.T


def two_clouds(rng, n=400, outliers=0.5):
    pairs = simulate.registration(n, outliers, NOISE, rng)
    return np.hstack([pairs.source, pairs.target]), pairs.T


PROBLEMS = {
    "relative pose": (RelativePose(), two_views),
    "absolute pose": (AbsolutePose(), one_view),
    "registration": (Registration(), two_clouds),
}
problems = pytest.mark.parametrize(("problem", "make_rows"), PROBLEMS.values(), ids=PROBLEMS)
options = pytest.mark.parametrize(
    "settings",
    [{}, {"confidence": 0.999}, {"local_optimisation": True}, {"confidence": 0.999, "local_optimisation": True}],
    ids=["plain", "confidence", "optimised", "both"],
)

# --- options ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("iterations", [0, -1, 1.5, 10.0, True, "10", None])
def test_a_wrong_number_of_iterations_is_refused_by_name(iterations):
    with pytest.raises(ValueError, match="iterations must be an integer of at least 1, got"):
        Ransac(iterations)


@pytest.mark.parametrize("confidence", [0, 1, -0.1, 2, np.nan, np.inf, True])
def test_a_wrong_confidence_is_refused_by_name(confidence):
    with pytest.raises(ValueError, match="confidence must be None or between 0 and 1, got"):
        Ransac(confidence=confidence)


@pytest.mark.parametrize("confidence", ["high", [0.9], 1j])
def test_a_confidence_of_the_wrong_type_is_refused(confidence):
    with pytest.raises((TypeError, ValueError), match="confidence"):
        Ransac(confidence=confidence)


def test_integers_of_numpy_are_integers():
    assert Ransac(np.int64(7)).with_budget(3) == Ransac(21)


@options
def test_a_budget_multiplies_the_iterations_and_keeps_the_rest(settings):
    assert Ransac(100, **settings).with_budget(7) == Ransac(700, **settings)


# --- how many samples -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("iterations", [1, 2, 63, 64, 65, 1000, 5000])
@pytest.mark.parametrize("settings", [{}, {"local_optimisation": True}], ids=["plain", "optimised"])
@pytest.mark.parametrize("models_per_sample", [0, 1, 3])
def test_without_a_confidence_the_number_of_samples_is_fixed(rng, iterations, settings, models_per_sample):
    problem = Constant(3, 0.5, models_per_sample)
    hypothesis = estimate(Ransac(iterations, **settings), problem, rng.standard_normal((20, 2)))
    assert problem.drawn == iterations
    assert hypothesis.tested == iterations * models_per_sample


# Hartley and Zisserman, "Multiple View Geometry", Table 4.3: samples for a probability of 0.99.
PUBLISHED = {
    2: [2, 3, 5, 6, 7, 11, 17],
    3: [3, 4, 7, 9, 11, 19, 35],
    4: [3, 5, 9, 13, 17, 34, 72],
    5: [4, 6, 12, 17, 26, 57, 146],
    6: [4, 7, 16, 24, 37, 97, 293],
    7: [4, 8, 20, 33, 54, 163, 588],
    8: [5, 9, 26, 44, 78, 272, 1177],
}
table = pytest.mark.parametrize(
    ("size", "outliers", "samples"),
    [
        (size, outliers, samples)
        for size, row in PUBLISHED.items()
        for outliers, samples in zip((5, 10, 20, 25, 30, 40, 50), row, strict=True)
    ],
)


@table
def test_trials_needed_are_the_published_ones(size, outliers, samples):
    assert trials_needed(1 - outliers / 100, size, 0.99) == samples


@table
def test_stops_after_the_published_number_of_samples(rng, size, outliers, samples):
    """Not before the first batch of 64 is through."""
    for settings in ({}, {"local_optimisation": True}):
        problem = Constant(size, 1 - outliers / 100)
        estimate(Ransac(10**6, confidence=0.99, **settings), problem, rng.standard_normal((100, 2)))
        assert problem.drawn == max(64, samples)


def test_never_draws_more_than_the_iterations(rng):
    for iterations in (10, 100):
        problem = Constant(8, 0.5)
        estimate(Ransac(iterations, confidence=0.99), problem, rng.standard_normal((100, 2)))
        assert problem.drawn == iterations


def test_a_higher_confidence_takes_more_samples():
    needed = [trials_needed(0.3, 5, confidence) for confidence in (0.5, 0.9, 0.99, 0.9999)]
    assert needed == sorted(set(needed))
    assert needed[3] == pytest.approx(2 * needed[2], abs=2)  # log 1e-4 = 2 log 1e-2


@pytest.mark.parametrize("size", [1, 3, 8])
def test_trials_needed_at_the_ends(size):
    assert trials_needed(1.0, size, 0.99) == 1
    assert trials_needed(1.0 + 1e-12, size, 0.99) == 1
    assert trials_needed(0.0, size, 0.99) >= 10**15
    assert trials_needed(1e-3, 5, 0.99) == pytest.approx(-np.log(0.01) * 1e15, rel=0.01)


def test_stops_earlier_the_more_inliers_there_are(rng):
    tested = []
    for outliers in (0.5, 0.8, 0.9):
        rows, _ = one_view(rng, outliers=outliers)
        tested.append(estimate(Ransac(30_000, confidence=0.999), AbsolutePose(), rows).tested)
    assert 3 * tested[0] < tested[1] < 0.5 * tested[2] < 15_000  # 64, about 900 and 7000 samples


# --- which samples ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rows", [3, 4, 5, 50, 10**6])
def test_rows_of_a_sample_are_different_and_exist(rng, rows):
    samples = minimal_samples(rows, 3, 5000, rng)
    assert samples.shape == (5000, 3)
    assert samples.min() >= 0
    assert samples.max() < rows
    assert (np.diff(np.sort(samples, axis=1), axis=1) > 0).all()


@pytest.mark.parametrize(("rows", "size"), [(6, 3), (7, 2), (8, 5), (5, 1)])
def test_all_subsets_are_equally_likely(rng, rows, size):
    samples = np.sort(minimal_samples(rows, size, 40_000, rng), axis=1)
    subsets = list(combinations(range(rows), size))
    found = dict.fromkeys(subsets, 0)
    for sample in map(tuple, samples.tolist()):
        found[sample] += 1
    assert chisquare(list(found.values())).pvalue > 1e-4


def test_samples_are_independent(rng):
    """All pairs of consecutive samples are equally likely, too."""
    samples = minimal_samples(4, 1, 80_000, rng)[:, 0]
    pairs = 4 * samples[::2] + samples[1::2]
    assert chisquare(np.bincount(pairs, minlength=16)).pvalue > 1e-4


def test_a_sample_of_all_rows_holds_each(rng):
    samples = minimal_samples(4, 4, 200, rng)
    np.testing.assert_array_equal(np.sort(samples, axis=1), np.broadcast_to(np.arange(4), (200, 4)))


def test_the_same_random_numbers_give_the_same_samples():
    for weights in (None, np.arange(20.0)):
        first, second = (minimal_samples(20, 3, 100, np.random.default_rng(5), weights) for _ in range(2))
        np.testing.assert_array_equal(first, second)


def test_weighted_samples_of_one_follow_the_weights(rng):
    weights = np.array([0.0, 3.0, 1.0, 0.0, 5.0, 1.0, 0.0])
    drawn = np.bincount(minimal_samples(7, 1, 50_000, rng, weights)[:, 0], minlength=7)
    assert (drawn[weights == 0] == 0).all()
    assert chisquare(drawn[weights > 0], 5000 * weights[weights > 0]).pvalue > 1e-4


def test_weighted_samples_follow_the_product_of_the_weights(rng):
    """Drawn one by one with replacement, again as a whole where a row came twice."""
    weights = np.array([1.0, 2.0, 0.5, 3.0, 1.0, 2.0])
    samples = minimal_samples(6, 3, 60_000, rng, weights)
    different = (np.diff(np.sort(samples, axis=1), axis=1) > 0).all(axis=1)
    assert different.mean() > 0.9999  # it gives up after a few attempts
    samples = samples[different]
    chances = {order: np.prod(weights[list(order)]) for order in permutations(range(6), 3)}
    found = dict.fromkeys(chances, 0)
    for sample in map(tuple, samples.tolist()):
        found[sample] += 1
    expected = np.array(list(chances.values())) / sum(chances.values()) * len(samples)
    assert chisquare(list(found.values()), expected).pvalue > 1e-4


def test_the_unit_of_the_weights_does_not_matter():
    weights = np.array([1.0, 2.0, 0.5, 3.0, 1.0])
    samples = [
        minimal_samples(5, 2, 1000, np.random.default_rng(3), unit * weights) for unit in (1.0, 2.0**-40, 2.0**40)
    ]
    np.testing.assert_array_equal(samples[0], samples[1])
    np.testing.assert_array_equal(samples[0], samples[2])


@pytest.mark.parametrize("positive", [1, 2])
def test_too_few_rows_with_a_weight_come_twice_but_none_without(rng, positive):
    weights = np.zeros(10)
    weights[[4, 7][:positive]] = 1.0
    samples = minimal_samples(10, 3, 100, rng, weights)
    assert set(samples.ravel()) == {4, 7} if positive == 2 else {4}


def test_rows_of_weight_zero_are_never_drawn_by_the_estimator(rng):
    problem = Constant(3, 0.5)
    rows = np.column_stack([np.arange(40.0), rng.standard_normal(40)])
    estimate(Ransac(2000), problem, rows, weights=np.arange(40.0) % 2)
    drawn = np.concatenate(problem.samples)[..., 0]
    assert set(drawn.ravel()) == set(np.arange(1.0, 40.0, 2.0))


# --- which model ------------------------------------------------------------------------------------------------------


class Recorded(naive.Shift):
    def __init__(self):
        self.models = []

    def solve_minimal(self, samples):
        self.models.append(super().solve_minimal(samples))
        return self.models[-1]


@pytest.mark.parametrize("iterations", [1, 64, 65, 700])
def test_the_first_model_with_the_most_inliers_wins(rng, iterations):
    rows = rng.uniform(-1, 1, (300, 2))
    rows[:60, 1] = rows[:60, 0] + rng.normal(0.3, 0.02, 60)
    problem = Recorded()
    hypothesis = estimate(Ransac(iterations), problem, rows, 0.05)
    models = np.concatenate(problem.models)
    assert len(models) == iterations
    counts = (problem.residuals(models, rows) < 0.05).sum(axis=1)
    np.testing.assert_array_equal(hypothesis.model, models[np.argmax(counts)])
    np.testing.assert_array_equal(hypothesis.residuals, problem.residuals(hypothesis.model[None], rows)[0])
    assert hypothesis.num_inliers == counts.max()
    assert hypothesis.tested == iterations


@problems
@options
def test_finds_the_model_among_outliers(rng, problem, make_rows, settings):
    good = 0
    for seed in range(10):
        rows, T = make_rows(rng)
        hypothesis = estimate(Ransac(3000, **settings), problem, rows, seed=seed)
        good += naive.angle_between(hypothesis.model, T) < 1.5
        expected = problem.residuals(hypothesis.model[None], rows)[0]
        np.testing.assert_array_equal(hypothesis.residuals, expected)
    assert good >= 9


@problems
def test_local_optimisation_lowers_the_cost(rng, problem, make_rows):
    better = lower = 0
    for seed in range(10):
        rows, T = make_rows(rng)
        plain, optimised = (
            estimate(Ransac(300, local_optimisation=on), problem, rows, seed=seed) for on in (False, True)
        )
        costs = [biweight_costs(problem, h.model[None], Rows(rows), THRESHOLD)[0] for h in (plain, optimised)]
        angles = [naive.angle_between(h.model, T) for h in (plain, optimised)]
        assert costs[1] <= costs[0]
        lower, better = lower + (costs[1] < costs[0]), better + (angles[1] < angles[0])
    assert lower >= 9
    assert better >= 7


def test_local_optimisation_keeps_what_costs_least(rng):
    """A refit that makes matters worse is not taken."""

    class Spoilt(naive.Shift):
        def refit(self, model, rows, weights):
            return naive.shift_model(77.0)

    rows = rng.uniform(-1, 1, (200, 2))
    rows[:80, 1] = rows[:80, 0] + rng.normal(0.3, 0.01, 80)
    hypothesis = estimate(Ransac(300, local_optimisation=True), Spoilt(), rows, 0.05)
    assert hypothesis.num_inliers > 70


def test_weights_decide_between_two_models(rng):
    """The larger set of rows weighs less."""
    x = rng.uniform(-1, 1, (300, 1))
    rows = np.hstack([x, x + np.repeat([0.3, -0.4], [200, 100])[:, None]])
    weights = np.repeat([1.0, 3.0], [200, 100])
    for settings in ({}, {"confidence": 0.99}, {"local_optimisation": True}):
        heavy = estimate(Ransac(300, **settings), naive.Shift(), rows, 0.05, weights=weights)
        light = estimate(Ransac(300, **settings), naive.Shift(), rows, 0.05)
        assert heavy.model[0, 3] == pytest.approx(-0.4)
        assert light.model[0, 3] == pytest.approx(0.3)


def test_early_stopping_goes_by_the_weight_of_the_inliers(rng):
    """Half of the rows are inliers, but nine tenths of the weight: 6 samples of 5 would do, not 146."""
    n = 100
    rows = rng.standard_normal((n, 2))
    for weights, drawn in ((np.repeat([9.0, 1.0], n // 2), 64), (np.ones(n), 146), (None, 146)):
        problem = Constant(5, 0.5)
        estimate(Ransac(10**6, confidence=0.99), problem, rows, weights=weights)
        assert problem.drawn == drawn


# --- no model ---------------------------------------------------------------------------------------------------------


@options
def test_no_model_at_all_gives_nan_and_infinite_residuals(rng, settings):
    hypothesis = estimate(Ransac(100, **settings), Constant(3, 0.5, models_per_sample=0), rng.standard_normal((20, 2)))
    assert not hypothesis.found
    assert hypothesis.model.shape == (3, 4)
    assert np.isnan(hypothesis.model).all()
    np.testing.assert_array_equal(hypothesis.residuals, np.full(20, np.inf))
    assert hypothesis.tested == 0
    assert hypothesis.num_inliers == 0


@options
def test_models_without_inliers_are_no_answer(rng, settings):
    hypothesis = estimate(Ransac(100, **settings), Constant(3, 0.0), rng.standard_normal((20, 2)))
    assert not hypothesis.found
    np.testing.assert_array_equal(hypothesis.residuals, np.full(20, np.inf))
    assert hypothesis.tested == 100


@problems
@pytest.mark.parametrize("missing", [1, 2])
def test_fewer_rows_than_a_minimal_sample_give_no_model_and_no_error(rng, problem, make_rows, missing):
    rows = make_rows(rng)[0][: problem.minimal_size - missing]
    hypothesis = estimate(Ransac(100), problem, rows)
    assert not hypothesis.found
    np.testing.assert_array_equal(hypothesis.residuals, np.full(len(rows), np.inf))


# --- a problem of the user's own --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def line():
    spec = importlib.util.spec_from_file_location("line", Path(__file__).parents[2] / "examples" / "line.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Line()


@options
@pytest.mark.parametrize("weighted", [False, True])
def test_a_problem_in_plain_numpy_works_with_all_options(rng, line, settings, weighted):
    points = rng.uniform(-1, 1, (500, 2))
    points[:150, 1] = 0.5 * points[:150, 0] + 0.2 + rng.normal(0, 0.005, 150)
    hypothesis = estimate(Ransac(500, **settings), line, points, 0.025, weights=np.ones(500) if weighted else None)
    a, b, c = hypothesis.model
    assert -a / b == pytest.approx(0.5, abs=0.03)
    assert c / b == pytest.approx(0.2, abs=0.02)
    assert 130 < hypothesis.num_inliers < 190


@options
def test_points_that_are_all_the_same_give_no_line(line, settings):
    assert not estimate(Ransac(100, **settings), line, np.ones((20, 2)), 0.025).found


def test_a_joint_search_goes_on_from_a_model_that_is_right_in_part(rng):
    """Rows near a wrong line hold more right rows than all rows do."""
    problem, noise = naive.Shift(), 0.01
    rows = np.column_stack([rng.uniform(-1, 1, 4000), rng.uniform(-200, 200, 4000)])
    rows[:40, 1] = rows[:40, 0] + 3.0 + noise * rng.standard_normal(40)
    near = naive.shift_model(3.0 + 4 * noise)
    start = Hypothesis(near, problem.residuals(near[None], rows)[0], 5 * noise)
    nothing = Hypothesis(np.full((3, 4), np.nan), np.full(10, np.inf), 5 * noise)
    joint = Ransac(10).search_jointly(problem, [nothing, start], Rows(rows), Noise.given(noise), rng)
    assert abs(joint.model[0, 3] - 3.0) < 2 * noise
    assert joint.tested >= 300
    np.testing.assert_array_equal(joint.residuals, problem.residuals(joint.model[None], rows)[0])


def test_of_many_rows_a_joint_search_counts_the_most_promising_models_only(rng, monkeypatch):
    class Counting(naive.Shift):
        def count_inliers(self, models, rows, threshold, weights=None):
            counted.append((len(models), len(rows)))
            return super().count_inliers(models, rows, threshold, weights)

    rows = np.column_stack([rng.uniform(-1, 1, 30_000), rng.uniform(-50, 50, 30_000)])
    rows[:900, 1] = rows[:900, 0] + 3.0 + 0.01 * rng.standard_normal(900)
    near = naive.shift_model(3.04)
    found = []
    for most in (10_000, 30_000):
        monkeypatch.setattr("nonsac.estimators.ransac.RANKED_ON", most)
        problem, counted = Counting(), []
        start = Hypothesis(near, problem.residuals(near[None], rows)[0], 0.05)
        random = np.random.default_rng(0)
        found.append(Ransac(10).search_jointly(problem, [start], Rows(rows), Noise.given(0.01), random))
        assert counted == ([(300, 10_000), (25, 30_000)] if most == 10_000 else [(300, 30_000)])
    assert abs(found[0].model[0, 3] - 3.0) < 0.02
    assert abs(found[1].model[0, 3] - 3.0) < 0.02


def test_a_joint_search_goes_by_the_weights_too(rng):
    """Most rows near the start have one shift, the heavier ones another."""
    problem, x = naive.Shift(), rng.uniform(-1, 1, 300)
    rows = np.column_stack([x, x + np.repeat([0.0, 0.1], [200, 100]) + 1e-3 * rng.standard_normal(300)])
    model = naive.shift_model(0.05)
    start = Hypothesis(model, problem.residuals(model[None], rows)[0], 0.08)
    for weights, shift in ((None, 0.0), (np.repeat([1.0, 9.0], [200, 100]), 0.1)):
        joint = Ransac(10).search_jointly(problem, [start], Rows(rows, weights), Noise.within(0.08), rng)
        assert joint.model[0, 3] == pytest.approx(shift, abs=5e-3)


def test_a_joint_search_without_inliers_returns_what_there_was(rng):
    problem = naive.Shift()
    rows = np.column_stack([np.zeros(10), 10.0 + np.arange(10.0)])
    model = naive.shift_model(0.0)
    start = Hypothesis(model, problem.residuals(model[None], rows)[0], 0.1)
    joint = Ransac(10).search_jointly(problem, [start], Rows(rows), Noise.within(0.1), rng)
    np.testing.assert_array_equal(joint.model, model)
    assert joint.tested == 0


@problems
def test_a_good_model_is_promising_among_many_bad_ones(rng, problem, make_rows):
    rows, truth = make_rows(rng, n=4000, outliers=0.9)
    samples = rows[minimal_samples(len(rows), problem.minimal_size, 400, rng)]
    models = np.concatenate([problem.solve_minimal(samples), truth[None, :3]])
    left = _promising(problem, models, Rows(rows), THRESHOLD)
    assert len(left) == len(models) // 8
    assert (left == truth[:3]).all(axis=(1, 2)).any()


@problems
@pytest.mark.parametrize("n", [100, 1500])
def test_of_few_rows_none_is_left_out(rng, problem, make_rows, n):
    rows, truth = make_rows(rng, n=n)
    models = np.repeat(truth[None, :3], 100, axis=0)
    assert _promising(problem, models, Rows(rows), THRESHOLD) is models
