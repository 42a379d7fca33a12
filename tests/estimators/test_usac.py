import numpy as np
import pytest

import naive
from nonsac import AbsolutePose, Noise, Registration, RelativePose, Rows, simulate
from nonsac.estimators import Ransac
from nonsac.estimators.named import ESTIMATORS
from nonsac.estimators.scores import Inliers, Marginalised, Truncated
from nonsac.estimators.usac import Consensus, LocalOptimiser, Reweighting, Usac
from nonsac.testing import check_estimator

NOISE = 1e-3
METHODS = ("msac", "magsac", "lo-ransac", "gc-ransac")
methods = pytest.mark.parametrize("name", METHODS)


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


def made(name, problem):
    return ESTIMATORS[name].made_for(problem)


def estimate(estimator, problem, rows, noise=NOISE, seed=0, weights=None):
    return estimator.estimate(problem, Rows(rows, weights), Noise.given(noise), np.random.default_rng(seed))


def a_line(rng, n=300, inliers=100, noise=0.01, degrees=60.0, offset=0.2):
    """Points of which the first lie on a line."""
    line, rows = naive.line_model(degrees, offset), rng.uniform(-1, 1, (n, 2))
    rows[:inliers] += (offset + noise * rng.standard_normal((inliers, 1)) - rows[:inliers] @ line[:2, None]) * line[:2]
    return rows, line


# --- options ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("iterations", [0, -1, 1.5, True, "10", None])
def test_a_wrong_number_of_iterations_is_refused_by_name(iterations):
    with pytest.raises(ValueError, match="iterations must be a whole number of at least 1, got"):
        Usac(iterations)


@pytest.mark.parametrize("confidence", [0, 1, 2.0, np.nan, True, "high"])
def test_a_wrong_confidence_is_refused_by_name(confidence):
    with pytest.raises(ValueError, match="confidence must be None or between 0 and 1, got"):
        Usac(confidence=confidence)


@pytest.mark.parametrize("part", ["score", "optimiser", "sampler"])
@pytest.mark.parametrize("wrong", ["msac", Truncated, 3])
def test_a_wrong_part_is_refused_by_name(part, wrong):
    with pytest.raises(TypeError, match=f"^{part} must be "):
        Usac(**{part: wrong})


@pytest.mark.parametrize("wrong", [1, "yes", None])
def test_eager_is_a_truth_value(wrong):
    with pytest.raises(TypeError, match="eager must be True or False, got"):
        Usac(eager=wrong)


@methods
def test_a_budget_multiplies_the_iterations_and_keeps_the_rest(name):
    estimator = made(name, Registration())
    larger = estimator.with_budget(7)
    assert larger.iterations == 7 * estimator.iterations
    assert larger.with_budget(2) == estimator.with_budget(14)
    assert estimator.with_budget(1) == estimator


# --- every method -----------------------------------------------------------------------------------------------------


@methods
@problems
def test_does_what_the_contract_says(rng, name, problem, make_rows):
    check_estimator(made(name, problem), problem, make_rows(rng)[0], NOISE)


@methods
@problems
def test_finds_the_model_among_outliers(rng, name, problem, make_rows):
    good = 0
    for seed in range(10):
        rows, T = make_rows(rng)
        hypothesis = estimate(made(name, problem), problem, rows, seed=seed)
        good += naive.angle_between(hypothesis.model, T) < 1.5
        expected = problem.residuals(hypothesis.model[None], rows)[0]
        np.testing.assert_array_equal(hypothesis.residuals, expected)
    assert good >= 9


@methods
def test_solves_a_problem_whose_models_are_no_motions(rng, name):
    rows, line = a_line(rng)
    hypothesis = estimate(made(name, naive.Line()), naive.Line(), rows, 0.01)
    assert naive.Line().distance(hypothesis.model, line) < 3.0
    assert hypothesis.tested > 1


@methods
@problems
def test_rows_that_say_the_same_give_no_model_and_no_error(rng, name, problem, make_rows):
    rows = make_rows(rng)[0]
    for hopeless in (np.repeat(rows[:1], 50, axis=0), rows[: problem.minimal_size - 1], rows[:0]):
        hypothesis = estimate(made(name, problem), problem, hopeless)
        assert not hypothesis.found
        assert len(hypothesis.residuals) == len(hopeless)
        assert hypothesis.num_inliers == 0


@methods
def test_weights_draw_rows_and_count_them(rng, name):
    """Of two lines with as many points, the one that weighs more is found."""
    rows, first = a_line(rng, n=200, inliers=100)
    rows[100:], second = a_line(rng, n=100, inliers=100, degrees=130.0, offset=-0.1)
    for line, weights in ((first, (3.0, 1.0)), (second, (1.0, 3.0))):
        hypothesis = estimate(made(name, naive.Line()), naive.Line(), rows, 0.01, weights=np.repeat(weights, 100))
        assert naive.Line().distance(hypothesis.model, line) < 3.0


# --- the loop ---------------------------------------------------------------------------------------------------------


class Recorded(naive.Line):
    def __init__(self):
        self.models = []

    def solve_minimal(self, samples):
        self.models.append(super().solve_minimal(samples))
        return self.models[-1]


@pytest.mark.parametrize("score", [Inliers(), Truncated(), Marginalised()], ids=str)
@pytest.mark.parametrize("iterations", [1, 64, 65, 700])
def test_the_model_with_the_highest_score_wins(rng, score, iterations):
    rows, _ = a_line(rng)
    problem = Recorded()
    hypothesis = estimate(Usac(iterations, None, score), problem, rows, 0.01)
    models = np.concatenate(problem.models)
    assert len(models) == hypothesis.tested == iterations
    expected = models[np.argmax(score.of(problem, models, Rows(rows), 0.05))]
    np.testing.assert_array_equal(hypothesis.model, expected)


def test_of_inliers_alone_it_is_ransac(rng):
    """The published loop, drawn in other batches."""
    rows, _ = two_clouds(rng)
    first, second = (estimate(each, Registration(), rows) for each in (Usac(64, None), Ransac(64)))
    np.testing.assert_array_equal(first.model, second.model)


class Taken(LocalOptimiser):
    """Takes down what it is asked to improve."""

    def __init__(self):
        self.asked = []

    def models(self, consensus, model, rng):
        self.asked.append(consensus.scores(model[None])[0])
        return np.full((2, *model.shape), np.nan)


@pytest.mark.parametrize("eager", [False, True])
def test_only_models_better_than_all_before_are_improved_unless_it_is_eager(rng, eager):
    rows, _ = a_line(rng)
    optimiser = Taken()
    hypothesis = estimate(Usac(640, None, optimiser=optimiser, eager=eager), naive.Line(), rows, 0.01)
    assert hypothesis.num_inliers == max(optimiser.asked)
    assert hypothesis.tested == 640 + 2 * len(optimiser.asked)
    if eager:
        assert len(optimiser.asked) == 10
    else:
        assert 1 < len(optimiser.asked) < 10
        assert (np.diff(optimiser.asked) > 0).all()


def test_stops_earlier_the_more_inliers_there_are(rng):
    tested = []
    for outliers in (0.5, 0.8, 0.9):
        rows, _ = two_clouds(rng, outliers=outliers)
        tested.append(estimate(Usac(20_000, 0.99), Registration(), rows).tested)
    assert 2 * tested[0] < tested[1] < 0.5 * tested[2] < 10_000


# --- what is published of them ----------------------------------------------------------------------------------------


def errors_at(name, threshold, seeds=20):
    """Mean error of a line if rows are inliers within so many standard deviations."""
    errors = []
    for seed in range(seeds):
        rows, line = a_line(np.random.default_rng(seed), 400, 200)
        estimator, noise = made(name, naive.Line()), Noise.within(threshold * 0.01)
        found = estimator.estimate(naive.Line(), Rows(rows), noise, np.random.default_rng(seed))
        errors.append(naive.Line().distance(found.model, line))
    return float(np.mean(errors))


def test_magsac_depends_little_on_the_threshold():
    """Its claim (Barath et al. 2020): a largest threshold, and no need to tune it."""
    assert errors_at("magsac", 20.0) < 2.0 * errors_at("magsac", 4.0)
    assert errors_at("magsac", 20.0) < 0.4 * errors_at("msac", 20.0)


def test_msac_is_nearer_than_the_number_of_inliers_if_the_threshold_is_wide(rng):
    """Torr and Zisserman 2000: it does not prefer just any model that has all inliers."""
    errors = {}
    for score in (Inliers(), Truncated()):
        errors[score] = 0.0
        for seed in range(20):
            rows, line = a_line(np.random.default_rng(seed), 200, 150)
            found = estimate(Usac(500, None, score), naive.Line(), rows, 0.04, seed=seed)
            errors[score] += naive.Line().distance(found.model, line)
    assert errors[Truncated()] < 0.8 * errors[Inliers()]


def test_weights_of_fits_reach_as_far_as_the_noise_they_allow(rng):
    """Beside a slow and obvious one, at a largest noise that shrinks from four times the last."""
    rows, T = two_clouds(rng)
    start = naive.nudged(rng, T[:3], 0.3)
    consensus = Consensus(Registration(), Rows(rows), 5 * NOISE, Marginalised())
    models = Reweighting(steps=5).models(consensus, start, rng)
    assert len(models) == 6
    for before, after, width in zip(models, models[1:], [4.0, 1.0, 1.0, 1.0, 1.0], strict=False):
        ratios = naive.residuals(before, rows) / (5 * NOISE * width)
        weights = np.where(ratios < 1.0, Marginalised().weights(ratios), 0.0)
        np.testing.assert_allclose(after, naive.kabsch(rows, weights), atol=1e-9)


def test_wrong_settings_of_reweighting_are_refused_by_name():
    with pytest.raises(TypeError, match="score must be a Marginalised"):
        Reweighting(score=Truncated())
    for wrong in (0, 1.5, True, "3"):
        with pytest.raises(ValueError, match="steps must be a whole number of at least 1, got"):
            Reweighting(steps=wrong)
    for wrong in (0.5, np.nan, np.inf, "2"):
        with pytest.raises(ValueError, match="widest must be a number of at least 1, got"):
            Reweighting(widest=wrong)


@problems
def test_reweighting_never_raises_the_loss_by_much(rng, problem, make_rows):
    """Each fit minimises a bound of the loss that touches it at the model before."""
    rows, T = make_rows(rng)
    consensus = Consensus(problem, Rows(rows), 5 * NOISE, Marginalised())
    start = naive.nudged(rng, T[:3], 0.1, direction=isinstance(problem, RelativePose))
    models = Reweighting(widest=1.0).models(consensus, start, rng)
    scores = consensus.scores(models)
    assert len(models) > 3
    assert (np.diff(scores) > -1e-3).all()
    assert scores[-1] > 1.05 * scores[0]
    assert naive.angle_between(models[-1], T) < 0.5 * naive.angle_between(start, T)
