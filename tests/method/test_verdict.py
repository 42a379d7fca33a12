import numpy as np
import pytest
from scipy.stats import binom

import naive
import nonsac
from nonsac import Noise, SpecialCase, register_pairs, simulate
from nonsac.layouts import Rows
from nonsac.method import verdict as verdicts
from nonsac.method.residuals import Residuals
from nonsac.method.verdict import Candidate, Effort, judge_rows
from nonsac.problems import Registration
from nonsac.problems.contract import background
from nonsac.result import Remark, Status
from plane import Plane

THRESHOLD = 0.1


def scene(seed, n=500, right=50):
    """A motion and rows in a box of side 2, of which the first are right."""
    rng = np.random.default_rng(seed)
    model = naive.random_model(rng, spread=0.0)
    a = rng.uniform(-1, 1, (n, 3))
    b = rng.uniform(-1, 1, (n, 3))
    b[:right] = naive.moved(model, a[:right]) + 0.02 * rng.standard_normal((right, 3))
    return model, np.hstack([a, b])


def chance_rate(problem, model, rows, threshold):
    return verdicts.chance_rate(Residuals.of(problem, model, Rows(rows)).background, threshold)


def judge(model, rows, tested=1000, problem=None, threshold=THRESHOLD, weights=None, known=True):
    candidate = Candidate(problem or Registration(), model, Rows(rows, weights), Noise.within(threshold, known))
    return judge_rows(candidate, tested if isinstance(tested, Effort) else Effort(tested, tested))


def test_many_right_rows_are_trusted():
    verdict = judge(*scene(0))
    assert verdict.status is Status.OK
    assert verdict.confidence > 0.99


def test_no_right_rows_are_not_trusted():
    for seed in range(20):
        verdict = judge(*scene(seed, right=0))
        assert verdict.status is Status.LOW_SUPPORT
        assert verdict.confidence < 0.5


@pytest.mark.parametrize("right", [0, 1, 2, 3])
def test_no_more_than_a_minimal_sample_supports_nothing(right):
    model, rows = scene(1, n=10, right=right)
    rows[right:, 3:] += 100.0
    verdict = judge(model, rows)
    assert (verdict.status, verdict.confidence) == (Status.LOW_SUPPORT, 0.0)


def test_collinear_inliers_are_degenerate():
    rng = np.random.default_rng(0)
    model = naive.random_model(rng)
    a = np.linspace(-1, 1, 100)[:, None] * [1.0, 0.0, 0.0]
    verdict = judge(model, np.hstack([a, naive.moved(model, a)]))
    assert (verdict.status, verdict.confidence) == (Status.DEGENERATE, 0.0)


def test_the_chance_is_a_binomial_tail_times_the_number_of_models():
    model, rows = scene(3, right=7)
    inliers = (naive.residuals(model, rows) < THRESHOLD).sum()
    rate = chance_rate(Registration(), model, rows, THRESHOLD)
    for tested in (1, 2, 50):
        chance = tested * sum(binom.pmf(k, len(rows) - 3, rate) for k in range(inliers - 3, len(rows)))
        assert chance > 1e-9
        confidence = 1 - min(1, chance) ** (np.log(0.5) / np.log(1e-6))
        assert judge(model, rows, tested).confidence == pytest.approx(confidence, abs=1e-6)


def test_inliers_that_share_a_point_count_once():
    model, rows = scene(3, right=8)
    once = judge(model, rows)
    inliers = rows[naive.residuals(model, rows) < THRESHOLD]
    again = judge(model, np.vstack([rows, *[inliers] * 20]))
    assert again.confidence <= once.confidence


def test_more_tested_models_lower_the_confidence():
    model, rows = scene(3, right=12)
    confidences = [judge(model, rows, tested).confidence for tested in (1, 10**3, 10**6, 10**12, 10**18)]
    assert confidences == sorted(confidences, reverse=True)
    assert confidences[-1] < confidences[0]


def test_the_chance_rate_is_the_share_of_wrong_rows_within_the_threshold():
    """Uniform points in a box of side 2: a ball of radius .1 around the moved point holds .1^3 4/3 pi / 8 of it."""
    rng = np.random.default_rng(0)
    a = rng.uniform(-0.8, 0.8, (3000, 3))
    rows = np.hstack([a, rng.uniform(-1, 1, (3000, 3))])
    rate = chance_rate(Registration(), np.eye(4)[:3], rows, 0.1)
    assert rate == pytest.approx(4 / 3 * np.pi * 0.1**3 / 8, rel=0.5)


def test_right_rows_do_not_raise_the_chance_rate():
    model, rows = scene(0, right=0)
    _, matched = scene(0, right=500)
    rates = [chance_rate(Registration(), model, r, THRESHOLD) for r in (rows, matched)]
    assert rates[1] < 0.01
    assert rates[0] < 0.01


@pytest.mark.parametrize("n", [2, 4, 5, 30])
def test_no_row_keeps_its_own_partner_in_the_chance_rate(n):
    """With exact rows far apart, only a row's own partner could count: half a count remains."""
    a = 100.0 * np.arange(n)[:, None] * [1.0, 0.0, 0.0]
    rate = chance_rate(Registration(), np.eye(4)[:3], np.hstack([a, a]), THRESHOLD)
    assert 0 < rate < 1e-4


def test_the_chance_rate_is_the_same_each_time():
    model, rows = scene(2)
    assert chance_rate(Registration(), model, rows, 0.3) == chance_rate(Registration(), model, rows, 0.3)


def test_background_rows_keep_either_half_and_lose_the_matches(rng):
    rows = np.arange(60.0).reshape(10, 6)
    drawn = background(Registration(), Rows(rows), 6000)
    assert drawn.shape == (6000, 6)
    firsts, seconds = (np.searchsorted(rows[:, column], drawn[:, column]) for column in (0, 3))
    np.testing.assert_array_equal(drawn, np.hstack([rows[firsts, :3], rows[seconds, 3:]]))
    assert (firsts != seconds).all()
    pairs, mirrored = (sorted(zip(*numbers, strict=True)) for numbers in ((firsts, seconds), (seconds, firsts)))
    assert pairs == mirrored
    assert len(set(pairs)) == 90
    np.testing.assert_array_equal(drawn, background(Registration(), Rows(rows), 6000))


def test_scattered_rows_of_a_normal_distribution_nearly_are_that_distribution(rng):
    rows = rng.standard_normal((20_000, 3)) * [1.0, 50.0, 0.0] + [7.0, -3.0, 2.0]
    drawn = background(Plane(), Rows(rows), 20_000)
    assert drawn.shape == (20_000, 3)
    np.testing.assert_allclose(drawn.mean(axis=0), [7.0, -3.0, 2.0], atol=1.5)
    np.testing.assert_allclose(drawn.std(axis=0), [1.0, 50.0, 0.0], rtol=0.03, atol=1e-12)
    tails = np.quantile((drawn[:, :2] - [7.0, -3.0]) / [1.0, 50.0], [0.01, 0.25, 0.75, 0.99], axis=0)
    np.testing.assert_allclose(tails, np.array([-2.326, -0.674, 0.674, 2.326])[:, None] * [1, 1], atol=0.3)
    np.testing.assert_array_equal(drawn, background(Plane(), Rows(rows), 20_000))


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0])
def test_scattered_rows_of_a_line_among_others_lie_on_no_line(angle, rng):
    normal = np.array([-np.sin(np.radians(angle)), np.cos(np.radians(angle))])
    rows = rng.uniform(-1, 1, (2000, 2))
    rows[:1000] -= np.outer(rows[:1000] @ normal, normal)
    assert (np.abs(background(naive.Line(), Rows(rows), 10_000) @ normal) < 0.01).mean() < 0.06


CLUSTERS = np.random.default_rng(7).uniform(-1, 1, (30, 3))
NO_PLANE = {
    "normal": lambda rng, n: rng.standard_normal((n, 3)),
    "even": lambda rng, n: rng.uniform(-1, 1, (n, 3)),
    "even, and two far away": lambda rng, n: np.vstack([rng.uniform(-1, 1, (n, 3)), [[50.0] * 3, [-50.0] * 3]]),
    "denser near the scanner": lambda rng, n: around(rng, n) * rng.exponential(8.0, n)[:, None],
    "clusters": lambda rng, n: CLUSTERS[rng.integers(30, size=n)] + rng.normal(scale=0.3, size=(n, 3)),
    "a ball": lambda rng, n: around(rng, n) * np.cbrt(rng.random(n))[:, None],
    "other units": lambda rng, n: rng.uniform(0, 1, (n, 3)) * [1.0, 1000.0, 10.0] + 5.0,
}


def around(rng, n):
    directions = rng.standard_normal((n, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("noise", [0.01, 0.05, None])
@pytest.mark.parametrize("kind", NO_PLANE)
@pytest.mark.slow
def test_no_plane_is_claimed_in_points_of_any_density(kind, noise, rng):
    points = NO_PLANE[kind](rng, 4000)
    given = None if noise is None else noise * np.median(points.std(axis=0))
    result = nonsac.estimate(nonsac.ArraySource(points), Plane(), noise=given, max_samples=4)
    assert not result.success, result


def test_a_problem_may_have_a_background_of_its_own():
    class Far(naive.Shift):
        def background(self, rows, size, rng):
            return np.full((size, 2), [0.0, 1e6])

    rows = np.column_stack([np.zeros(100), np.full(100, 3.0)])
    residuals = Residuals.of(Far(), naive.shift_model(3.0), Rows(rows))
    assert residuals.support(0.1) == pytest.approx(1.0, abs=1e-3)
    assert Residuals.of(naive.Shift(), naive.shift_model(3.0), Rows(rows)).support(0.1) == pytest.approx(0.0, abs=1e-3)


def test_verdicts_are_calibrated_on_random_rows():
    """The best of many random models, corrected for their number: a chance below 1 % comes up in about 1 % of cases."""
    low = 0
    for seed in range(100):
        rng = np.random.default_rng([9, seed])
        rows = rng.uniform(-1, 1, (300, 6))
        models = np.stack([naive.random_model(rng, spread=0.3) for _ in range(40)])
        best = models[np.argmax(Registration().count_inliers(models, rows, 0.3))]
        low += judge(best, rows, 40, threshold=0.3).confidence > 0.99
    assert low <= 5


# --- right in part only -----------------------------------------------------------------------------------------------


def spread_scene(rng, width, n=4000, right=400):
    """Shifts of 3, of which the residuals spread over a share of the threshold, evenly or as the noise does."""
    rows = np.column_stack([rng.uniform(-1, 1, n), rng.uniform(-3, 9, n)])
    rows[:right, 1] = rows[:right, 0] + 3.0 + THRESHOLD * width * rng.standard_normal(right)
    return naive.shift_model(3.0)[None][0], rows


@pytest.mark.parametrize(("width", "trusted"), [(0.2, True), (0.1, True), (0.5, False), (1.0, False)])
def test_inliers_that_spread_over_the_threshold_are_not_trusted(rng, width, trusted):
    verdict = judge(*spread_scene(rng, width), 1, naive.Shift())
    assert (verdict.status is Status.OK) is trusted
    assert verdict.remarks == (() if trusted else (Remark.PARTLY_RIGHT,))
    assert (verdict.confidence > 0.99) if trusted else (verdict.confidence < 0.5)


def test_inliers_that_spread_are_trusted_after_a_search_that_leaves_nothing_better(rng):
    model, rows = spread_scene(rng, 0.5)
    confidences = [judge(model, rows, tested, naive.Shift()).confidence for tested in (1, 30, 300)]
    assert confidences == sorted(confidences)
    assert confidences[0] < 0.5 < 0.99 < confidences[-1]


def test_models_compared_count_against_an_answer_and_samples_searched_for_it(rng):
    """A search may be known to have compared much and not known to have searched at all."""
    model, rows = spread_scene(rng, 0.5)
    assert judge(model, rows, Effort(1, 300), naive.Shift()).confidence > 0.99
    for compared in (1, 300, 10**6):
        verdict = judge(model, rows, Effort(compared, 1), naive.Shift())
        assert (verdict.status, verdict.remarks) == (Status.LOW_SUPPORT, (Remark.PARTLY_RIGHT,))
    few = scene(3, right=12)
    confidences = [judge(*few, Effort(compared, 10**18)).confidence for compared in (1, 10**6, 10**18)]
    assert confidences[0] > confidences[1] > confidences[2]
    unsearched, searched = (judge(*few, Effort(1, searched)).confidence for searched in (1, 10**18))
    assert unsearched == pytest.approx(searched, abs=0.02)  # as the inliers keep to the noise


def test_a_model_that_looks_right_at_a_noise_nobody_gave_is_trusted_only_after_a_search(rng):
    model, rows = spread_scene(rng, 0.2)
    for tested in (1, 300):
        assert judge(model, rows, tested, naive.Shift()).status is Status.OK
    verdicts_on_unknown = [judge(model, rows, tested, naive.Shift(), known=False) for tested in (1, 300)]
    assert [v.status for v in verdicts_on_unknown] == [Status.LOW_SUPPORT, Status.OK]
    assert verdicts_on_unknown[0].remarks == (Remark.PARTLY_RIGHT,)


@pytest.mark.parametrize(("dimension", "share"), [(1, 0.9545), (2, 0.8647), (3, 0.7385)])
def test_the_share_within_two_sigma_is_that_of_a_chi_distribution(rng, dimension, share):
    """A right model is certain, and one with the fourth power of that share is at the bound."""
    lengths = np.linalg.norm(rng.standard_normal((20_000, dimension)), axis=1) / 5.0
    by_chance = np.full(6000, 10.0)
    assert (lengths < 0.4).mean() == pytest.approx(share, abs=0.01)
    assert verdicts._certainty_of_spread(Residuals(lengths, by_chance), 1.0, dimension) > 0.999
    bound = share**4
    at_bound = np.where(np.arange(20_000) < bound * 20_000, 0.1, 0.9)
    assert verdicts._certainty_of_spread(Residuals(at_bound, by_chance), 1.0, dimension) == pytest.approx(0.5, abs=0.15)


# --- rows that are no independent evidence ----------------------------------------------------------------------------


def few_targets(rng):
    """Four targets that twelve sources each are matched to, and random pairs."""
    rotation = naive.random_model(rng, spread=0.0)
    targets = np.repeat(rng.standard_normal((4, 3)), 12, axis=0)
    sources = targets @ rotation[:, :3] + 0.003 * rng.standard_normal(targets.shape)
    noise = rng.standard_normal((50, 6))
    return rotation, np.vstack([np.hstack([sources, targets]), noise])


def test_weights_do_not_make_rows_distinct(rng):
    model, rows = few_targets(rng)
    weights = 1.0 + 1e-6 * rng.random(len(rows))
    assert judge(model, rows, threshold=0.05).status is Status.LOW_SUPPORT
    assert judge(model, rows, threshold=0.05, weights=weights).status is Status.LOW_SUPPORT


def test_the_verdict_counts_rows_and_not_weights(rng):
    model, rows = scene(3, right=12)
    assert judge(model, rows, weights=rng.uniform(0.01, 100.0, len(rows))) == judge(model, rows)


def test_copies_with_different_weights_are_copies(rng):
    model, rows = scene(5, n=60, right=18)
    often, weights = np.tile(rows, (5, 1)), rng.uniform(0.5, 2.0, 300)
    assert judge(model, often) == judge(model, rows)
    weighted, even = judge(model, often, weights=weights), judge(model, rows)
    assert (weighted.status, weighted.tests["chance"]) == (even.status, even.tests["chance"])
    assert weighted.confidence == pytest.approx(even.confidence, abs=0.01)  # the parts' fits have weights


@pytest.mark.parametrize("copies", [2, 10])
def test_copies_of_all_rows_change_little(copies):
    model, rows = scene(5, n=60, right=18)
    once = judge(model, rows)
    again = judge(model, np.tile(rows, (copies, 1)))
    assert once.status is again.status is Status.OK
    assert again.confidence == pytest.approx(once.confidence, abs=0.02)


# --- special cases of the data ----------------------------------------------------------------------------------------


class Special(naive.Shift):
    """Shifts, of which a special case explains so large a share of the inliers."""

    def __init__(self, share, determined=True, others=()):
        self.share, self.case = share, {"determined": determined, "others": others}

    def special_cases(self, model, inliers, noise):
        return [SpecialCase("special", np.arange(len(inliers)) < self.share * len(inliers), **self.case)]


def judge_special(rng, *case):
    return judge(*spread_scene(rng, 0.2), 300, Special(*case))


@pytest.mark.parametrize("determined", [True, False])
@pytest.mark.parametrize("share", [0.0, 0.4, 0.6])
def test_a_special_case_that_leaves_much_unexplained_is_none(rng, share, determined):
    verdict = judge_special(rng, share, determined)
    assert (verdict.status, verdict.remarks, verdict.alternatives) == (Status.OK, (), ())


@pytest.mark.parametrize("others", [(), np.empty((0, 3, 4))], ids=["tuple", "array"])
def test_a_special_case_without_other_models_is_remarked_on(rng, others):
    verdict = judge_special(rng, 1.0, True, others)
    assert (verdict.status, verdict.remarks, verdict.alternatives) == (Status.OK, ("special",), ())
    assert verdict.confidence > 0.99


def test_a_special_case_that_determines_nothing_is_degenerate(rng):
    verdict = judge_special(rng, 1.0, False)
    assert (verdict.status, verdict.confidence, verdict.remarks) == (Status.DEGENERATE, 0.0, ("special",))


def test_other_models_that_fit_as_well_make_the_answer_ambiguous(rng):
    near, far = naive.shift_model(3.0 + 1e-4), naive.shift_model(3.5)
    verdict = judge_special(rng, 1.0, True, np.stack([far, near]))
    assert (verdict.status, verdict.confidence, verdict.remarks) == (Status.AMBIGUOUS, 0.5, ("special",))
    (other,) = verdict.alternatives
    np.testing.assert_array_equal(other.model, near)
    np.testing.assert_array_equal(other.T, np.vstack([near, [0, 0, 0, 1]]))
    assert other.support == pytest.approx(0.1, rel=0.3)
    assert judge_special(rng, 1.0, True, far[None]).status is Status.OK


def test_another_model_that_is_no_motion_has_no_matrix():
    other = verdicts.alternative(naive.Line(), naive.line_model(30.0, 2.0), 0.4)
    assert (other.T, other.support) == (None, 0.4)
    np.testing.assert_array_equal(other.model, naive.line_model(30.0, 2.0))


@pytest.mark.parametrize("outliers", [0.992, 0.995])
def test_more_rows_than_a_scene_has_places_do_not_make_an_answer_less_certain(outliers):
    """Of 256,000 rows 1,000 are near by chance, and 2,000 are right, in 400 places."""
    pairs = simulate.registration(300_000, outliers, 0.02, 0)
    result = register_pairs(pairs.source, pairs.target, noise=0.02, samples=128, sample_size=2000)
    assert result.info["tests"]["facts"] < 0.4 * result.num_inliers
    assert result.success
    assert naive.angle_between(result.R, pairs.T[:3, :3]) < 1.0
