import time

import numpy as np
import pytest

import naive
from nonsac import (
    ArraySource,
    ContractBroken,
    Estimator,
    Hypothesis,
    Noise,
    Pcr99,
    Ransac,
    absolute_pose,
    estimate,
    register_pairs,
    relative_pose,
    simulate,
)
from nonsac.evaluation import rotation_error
from nonsac.layouts import Rows
from nonsac.method import unknown_noise
from nonsac.method.noise import guessed_noise
from nonsac.method.residuals import Residuals, measured_noise
from nonsac.problems import AbsolutePose, Registration, RelativePose
from nonsac.result import Remark, Status

RANSAC = Ransac(5000, confidence=0.9999, local_optimisation=True, least_iterations=500)
PROBLEMS = {
    "relative-pose": (RelativePose(), RANSAC, lambda *a: _rows(simulate.relative_pose(*a), "points1", "points2")),
    "absolute-pose": (AbsolutePose(), RANSAC, lambda *a: _rows(simulate.absolute_pose(*a), "points2d", "points3d")),
    "registration": (
        Registration(),
        Pcr99.for_pairs(),
        lambda *a: _rows(simulate.registration(*a), "source", "target"),
    ),
}
CALLS = {"relative-pose": relative_pose, "absolute-pose": absolute_pose, "registration": register_pairs}


def measured(problem, model, rows, threshold):
    return measured_noise(Residuals.of(problem, model, Rows(rows)), threshold, problem.residual_dimension)


def guessed(problem, estimator, rows, rng):
    return guessed_noise(problem, estimator, Rows(rows), rng)


def _rows(data, *halves):
    return np.hstack([getattr(data, half) for half in halves]), data.T[:3]


def test_the_threshold_is_five_standard_deviations():
    for noise in (Noise.given(0.01), Noise.within(0.05)):
        assert (noise.sigma, noise.threshold, noise.known) == (0.01, 0.05, True)
    assert not Noise.given(0.01, known=False).known
    assert not Noise.within(0.05, known=False).known
    assert type(Noise.given(1).threshold) is type(Noise.within(np.float32(1)).sigma) is float


@pytest.mark.parametrize("factor", [0.2, 1.0, 20.0])
@pytest.mark.parametrize("ratio", [0.0, 0.8])
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_noise_of_the_true_model_is_measured_from_any_threshold(rng, name, ratio, factor):
    problem, _, simulated = PROBLEMS[name]
    rows, truth = simulated(20_000, ratio, 0.004, rng)
    assert measured(problem, truth, rows, 5 * 0.004 * factor) == pytest.approx(0.004, rel=0.1)


def test_a_model_without_inliers_shows_no_noise(rng):
    rows = np.column_stack([rng.uniform(-1, 1, 500), rng.uniform(50, 60, 500)])
    assert np.isnan(measured(naive.Shift(), naive.shift_model(0.0), rows, 0.1))


def test_exact_rows_have_no_noise():
    x = np.arange(100.0)
    rows = np.column_stack([x, x + 3.0])
    assert measured(naive.Shift(), naive.shift_model(3.0), rows, 0.1) == 0.0


@pytest.mark.parametrize("noise", [0.001, 0.004, 0.016])
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_noise_is_guessed_before_there_is_a_model(rng, name, noise):
    problem, estimator, simulated = PROBLEMS[name]
    rows, _ = simulated(2000, 0.6, noise, rng)
    assert guessed(problem, estimator, rows, rng) == pytest.approx(noise, rel=0.25)


def test_rows_that_determine_nothing_still_get_a_guess(rng):
    for rows in (np.ones((100, 6)), np.ones((2, 6)), rng.random((1, 6)), np.empty((0, 6))):
        assert guessed(Registration(), Pcr99.for_pairs(), rows, rng) == 1.0


def test_where_single_samples_say_nothing_a_joint_search_finds_the_noise():
    """Of 2,000 rows ten are right: no sample shows them, four together do."""
    drawn = []
    for seed in range(8):
        pairs = simulate.registration(20_000, 0.995, 0.01, seed)
        result = register_pairs(pairs.source, pairs.target, rng=seed)
        assert result.success
        assert result.noise == pytest.approx(0.01, rel=0.35)
        assert naive.angle_between(result.R, pairs.T[:3, :3]) < 1.0
        drawn.append(result.info["samples"])
    assert np.median(drawn) <= 4
    assert max(drawn) <= 8


class Jointly(Ransac):
    """Finds nothing in a sample, and what it is told to in several."""

    def __init__(self, answer):
        super().__init__(10)
        object.__setattr__(self, "answer", answer)

    def estimate_at_any_noise(self, problem, rows, rng):
        return Hypothesis(problem.solve_minimal(rows.values[None, :1])[0], np.full(len(rows), 1.0), 0.1, tested=1)

    def search_jointly_at_any_noise(self, problem, hypotheses, rng):
        return self.answer()


def test_a_joint_search_that_fails_costs_nothing_and_one_that_gives_nonsense_is_named(rng):
    x = rng.uniform(-1, 1, 20_000)
    source = ArraySource(np.column_stack([x, x + 3.0 + 0.01 * rng.standard_normal(20_000)]))
    result = estimate(source, naive.Shift(), estimator=Jointly(lambda: 1 / 0), noise=None)
    assert result.found
    with pytest.raises(ContractBroken, match=r"Jointly.search_jointly_at_any_noise must give a nonsac.Hypothesis"):
        estimate(source, naive.Shift(), estimator=Jointly(lambda: 3), noise=None)


class Failing(Estimator):
    """Fails at every second noise that it is asked for, or always; else what RANSAC does."""

    def __init__(self, always):
        self.always, self.asked = always, []

    def estimate(self, problem, rows, noise, rng):
        self.asked.append(noise)
        if self.always or len(self.asked) % 2:
            raise ValueError("mine")
        return Ransac(200).estimate(problem, rows, noise, rng)


def test_an_estimator_that_fails_costs_one_guess(rng):
    rows = np.column_stack([rng.uniform(-1, 1, 1000), rng.uniform(-9, 9, 1000)])
    rows[:500, 1] = rows[:500, 0] + 3.0 + 0.01 * rng.standard_normal(500)
    estimator = Failing(always=False)
    assert guessed(naive.Shift(), estimator, rows, rng) == pytest.approx(0.01, rel=0.25)
    assert not any(noise.known for noise in estimator.asked)
    thresholds = [noise.threshold for noise in estimator.asked]
    np.testing.assert_allclose(np.divide(thresholds[:-1], thresholds[1:]), 4.0)
    fallback = guessed(naive.Shift(), Failing(always=True), rows, rng)
    assert 0.01 < fallback < 1.0


@pytest.mark.parametrize(
    ("rows", "status"),
    [
        (np.ones((100, 6)), Status.DEGENERATE),
        (np.linspace(0, 1, 100)[:, None] * np.ones(6), Status.DEGENERATE),
        (np.full((100, 6), np.nan), Status.TOO_FEW),
    ],
    ids=["equal", "collinear", "nan"],
)
@pytest.mark.filterwarnings("ignore:dropped")
def test_the_status_is_that_with_a_noise(rows, status):
    for noise in (None, 0.01):
        assert register_pairs(rows[:, :3], rows[:, 3:], noise=noise).status is status


@pytest.mark.filterwarnings("ignore:dropped")
def test_a_first_sample_without_finite_rows_does_not_end_the_search(rng):
    pairs = simulate.registration(3000, 0.5, 0.01, rng)
    source = pairs.source.copy()
    source[rng.permutation(3000)[:2000]] = np.nan
    for seed in range(3):
        assert register_pairs(source, pairs.target, sample_size=60, rng=seed).success


def guess_first(monkeypatch, noise):
    """As if the estimator needed a noise, and this were the first guess."""
    monkeypatch.setattr(unknown_noise, "first_findings", lambda *_: None)
    monkeypatch.setattr(unknown_noise, "guessed_with", lambda *_: noise)


def test_a_time_limit_keeps_what_was_found(rng, monkeypatch):
    """The noise that is measured calls for a second run, for which there is no time: the first one stands."""
    pairs = simulate.registration(20_000, 0.98, 0.02, rng)
    guess_first(monkeypatch, 0.06)
    seconds, counts = [0.0], []
    monkeypatch.setattr(time, "perf_counter", lambda: seconds[0])

    def a_second_later(done, _):
        counts.append(done)
        seconds[0] += 1.0

    result = register_pairs(pairs.source, pairs.target, time_limit=5.5, workers=1, progress=a_second_later)
    assert counts == [1, 2, 3, 4, 5, 6]
    assert len(result.hypotheses) == 6
    assert result.info["measured_noise"] == pytest.approx(0.02, rel=0.2)


@pytest.mark.parametrize("name", CALLS)
def test_without_a_noise_the_answer_is_about_that_with_the_right_one(rng, name):
    rows, truth = PROBLEMS[name][2](20_000, 0.7, 0.004, rng)
    halves = np.split(rows, [PROBLEMS[name][0].layout.split], axis=1)
    found, given = CALLS[name](*halves), CALLS[name](*halves, noise=0.004)
    assert found.success
    assert found.noise == pytest.approx(0.004, rel=0.1)
    assert found.threshold == 5 * found.noise
    error, least = (rotation_error(result.R, truth[:, :3]) for result in (found, given))
    assert error < 1.5 * least + 0.01


@pytest.mark.parametrize("factor", [0.1, 10.0])
@pytest.mark.parametrize("name", CALLS)
@pytest.mark.slow
def test_a_wrong_noise_is_reported(rng, name, factor):
    rows, truth = PROBLEMS[name][2](20_000, 0.5, 0.002, rng)
    halves = np.split(rows, [PROBLEMS[name][0].layout.split], axis=1)
    result = CALLS[name](*halves, noise=0.002 * factor)
    (remark,) = (remark for remark in result.info["remarks"] if remark.startswith("noise"))
    kind = Remark.NOISE_LARGER if factor < 1 else Remark.NOISE_SMALLER
    assert remark.startswith(f"{kind}: by a factor of ")
    assert float(remark.split()[-1]) == pytest.approx(10, rel=0.2)
    assert result.info["measured_noise"] == pytest.approx(0.002, rel=0.1)
    assert rotation_error(result.R, truth[:, :3]) < 1.0


@pytest.mark.parametrize("name", CALLS)
def test_a_right_noise_is_not_remarked_on(rng, name):
    rows, _ = PROBLEMS[name][2](20_000, 0.5, 0.002, rng)
    halves = np.split(rows, [PROBLEMS[name][0].layout.split], axis=1)
    assert CALLS[name](*halves, noise=0.002).info["remarks"] == ()


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.slow
def test_a_noise_that_nobody_gave_is_not_remarked_on(rng, name, monkeypatch):
    """Not even if the first guess is far off and there is no second run."""
    rows, _ = PROBLEMS[name][2](20_000, 0.5, 0.002, rng)
    guess_first(monkeypatch, 0.0002)
    monkeypatch.setattr(unknown_noise, "_SAME_NOISE", 1e9)
    monkeypatch.setattr(unknown_noise, "_MUCH_LESS", 1e9)
    result = CALLS[name](*np.split(rows, [PROBLEMS[name][0].layout.split], axis=1))
    assert (result.noise, result.remarks) == (0.0002, (Remark.SLIPPING,))
    assert result.info["measured_noise"] == pytest.approx(0.002, rel=0.1)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_the_unit_changes_neither_rotation_nor_inliers_nor_verdict(rng, factor):
    pairs = simulate.registration(10_000, 0.9, 0.01, rng)
    first = register_pairs(pairs.source, pairs.target)
    second = register_pairs(factor * pairs.source, factor * pairs.target)
    np.testing.assert_allclose(second.R, first.R, atol=1e-6)
    np.testing.assert_allclose(second.t, factor * first.t, rtol=1e-4)
    assert second.noise == pytest.approx(factor * first.noise, rel=1e-4)
    assert (second.inliers == first.inliers).mean() > 0.9999
    assert (second.status, second.confidence) == (first.status, pytest.approx(first.confidence, abs=1e-3))


def test_data_without_matches_stay_without_an_answer(rng):
    for _ in range(3):
        source, target = rng.uniform(-1, 1, (2, 8000, 3))
        result = register_pairs(source, target, max_samples=8)
        assert not result.success


def test_exact_pairs_need_no_noise(rng):
    rows = naive.matching_rows(rng, 500, naive.random_model(rng))
    result = register_pairs(rows[:, :3], rows[:, 3:])
    assert result.success
    assert result.inlier_ratio == 1.0
