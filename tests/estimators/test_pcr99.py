import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac import simulate
from nonsac.estimators import Pcr99
from nonsac.layouts import Rows
from nonsac.problems import Noise, Registration
from nonsac.result import Hypothesis

NOISE = 0.01
THRESHOLD = 5 * NOISE
VARIANTS = {
    "published": (Pcr99(), 1.0),
    "for pairs": (Pcr99.for_pairs(), 1.0),
    "for all pairs": (Pcr99.for_all_pairs(), 1.0),
    "random": (Pcr99("distance", order="random", tolerance=0.6, max_drawn=400_000, max_valid=2000), 1.0),
    "known scale": (Pcr99(), 2.5),
    "known scale, distances": (Pcr99.for_pairs(), 2.5),
    "free scale": (Pcr99(), None),
    "ranked by sums": (Pcr99(rank="sum"), 1.0),
    "ranked by sums, free scale": (Pcr99(rank="sum"), None),
}
variants = pytest.mark.parametrize(("estimator", "scale"), VARIANTS.values(), ids=VARIANTS)


def simulated(rng, scale=1.0, n=1000, outliers=0.95, noise=NOISE):
    pairs = simulate.registration(n, outliers, noise, rng, scale=scale)
    return np.hstack([pairs.source, pairs.target]), pairs.T, pairs.inliers


def run(estimator, rows, scale=1.0, threshold=THRESHOLD, seed=0):
    return estimator.estimate(Registration(scale), Rows(rows), Noise.within(threshold), np.random.default_rng(seed))


@variants
def test_finds_the_motion_among_95_percent_outliers(rng, estimator, scale):
    rows, T, inliers = simulated(rng, scale or 3.0)
    hypothesis = run(estimator, rows, scale)
    assert naive.angle_between(hypothesis.model, T) < 4.0  # worst of 30 seeds: 2.9
    assert np.cbrt(np.linalg.det(hypothesis.model[:, :3])) == pytest.approx(scale or 3.0, rel=0.03)
    assert (hypothesis.residuals[inliers] < THRESHOLD).mean() > 0.9


@variants
def test_residuals_are_those_of_the_model(rng, estimator, scale):
    rows, *_ = simulated(rng, scale or 3.0, outliers=0.8)
    hypothesis = run(estimator, rows, scale)
    np.testing.assert_allclose(hypothesis.residuals, naive.residuals(hypothesis.model, rows), atol=1e-12)


@pytest.mark.parametrize("true_scale", [0.05, 0.5, 1.0, 8.0])
def test_a_free_scale_is_recovered(rng, true_scale):
    rows, T, _ = simulated(rng, true_scale, outliers=0.9, noise=1e-3 * true_scale)
    model = run(Pcr99(tolerance=0.05), rows, None, threshold=5e-3 * true_scale).model
    np.testing.assert_allclose(model, T[:3], atol=0.01 * max(true_scale, 0.1))


@pytest.mark.parametrize("estimator", [Pcr99(), Pcr99.for_pairs(), Pcr99.for_all_pairs()])
def test_99_percent_outliers_in_a_ranked_search(estimator):
    """One sample of 2,000 rows with 20 right ones: a fair share of samples succeeds."""
    errors = []
    for seed in range(12):
        rows, T, _ = simulated(seed, n=2000, outliers=0.99, noise=0.005)
        errors.append(naive.angle_between(run(estimator, rows, threshold=0.025).model, T))
    assert np.mean(np.array(errors) < 10.0) >= 0.4


def test_published_settings():
    assert Pcr99() == Pcr99("log_ratio", "ranked", 0.1, 0.009, "weighted", 0, 100_000, 10_000_000)
    assert Pcr99.for_pairs() == Pcr99("distance", "ranked", 0.4, None, "weighted", 0, 1000, 10_000)
    assert Pcr99.for_all_pairs() == Pcr99("distance", "ranked", 0.4, 0.0009, "weighted", 1000, 5000, 10_000_000)


def test_a_larger_budget_draws_more_but_asks_for_no_more_consistent_triplets():
    larger = Pcr99.for_pairs().with_budget(30)
    assert (larger.max_drawn, larger.max_valid) == (300_000, 1000)


def test_the_search_stops_at_the_settings(rng):
    rows = naive.matching_rows(rng, 60, naive.random_model(rng), noise=NOISE)  # all triplets are consistent
    assert run(Pcr99("distance", tolerance=9, enough_inliers=None, max_valid=500), rows).tested == 500
    assert run(Pcr99("distance", tolerance=9, enough_inliers=None, max_drawn=123), rows).tested == 123
    assert run(Pcr99("distance", tolerance=9, enough_inliers=None, max_valid=10**6), rows).tested == 60 * 59 * 58 // 6
    early = run(Pcr99("distance", tolerance=9, enough_inliers=0.5, max_valid=10**6), rows).tested
    late = run(Pcr99("distance", tolerance=9, enough_inliers=0.5, min_valid=3500, max_valid=10**6), rows).tested
    assert early <= 1000 < 3500 <= late <= 4500


def test_the_random_order_draws_no_more_than_allowed(rng):
    rows = naive.matching_rows(rng, 60, naive.random_model(rng), noise=NOISE)
    settings = {"order": "random", "tolerance": 9, "enough_inliers": None}
    assert run(Pcr99("distance", **settings, max_drawn=300), rows).tested == 300
    assert run(Pcr99("distance", **settings, max_valid=700), rows).tested == 100_000  # one batch


def test_triplets_that_are_not_consistent_count_as_tested(rng):
    """A model was chosen over them: data without matches must not look unlikely because they were left out."""
    rows = np.hstack([rng.uniform(-1, 1, (300, 3)), rng.uniform(-1, 1, (300, 3))])
    for order in ("ranked", "random"):
        settings = {"order": order, "tolerance": 0.1, "enough_inliers": None, "max_drawn": 5000}
        assert run(Pcr99("distance", **settings), rows).tested == 5000


def test_enough_inliers_are_at_least_nine(rng):
    model = naive.random_model(rng)
    settings = {"tolerance": 1e9, "enough_inliers": 1e-6, "max_valid": 5000}
    for right, tested in ((8, 5000), (9, 1000)):
        wrong = np.hstack([rng.uniform(-50, 50, (60, 3)), rng.uniform(1e3, 2e3, (60, 3))])
        rows = np.vstack([naive.matching_rows(rng, right, model), wrong])
        assert run(Pcr99("distance", **settings), rows).tested == tested


def test_only_the_random_order_uses_the_random_numbers(rng):
    rows, *_ = simulated(rng, outliers=0.99)
    ranked = Pcr99.for_pairs()
    np.testing.assert_array_equal(run(ranked, rows, seed=1).model, run(ranked, rows, seed=2).model)
    drawn = Pcr99("distance", order="random", tolerance=0.6, max_drawn=3000)
    assert not np.array_equal(run(drawn, rows, seed=1).model, run(drawn, rows, seed=2).model)


def test_the_model_is_refitted_to_its_inliers(rng):
    """Three noisy rows give a poor model; the fit to all inliers is as good as the oracle's."""
    rows, T, inliers = simulated(rng, outliers=0.5)
    model = run(Pcr99.for_pairs(), rows).model
    best = naive.kabsch(rows[inliers], np.ones(inliers.sum()))
    assert naive.angle_between(model, best) < 0.3
    assert naive.angle_between(model, T) < 0.5


@pytest.mark.parametrize("scale", [1.0, None])
def test_ten_thousand_rows_take_little_memory(rng, scale):
    rows, *_ = simulated(rng, scale or 1.0, n=10_000, outliers=0.5)
    estimator = Pcr99.for_pairs() if scale else Pcr99(max_valid=1000)
    run(estimator, rows[:50].copy(), scale)
    tracemalloc.start()
    try:
        run(estimator, rows, scale)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 100e6  # a table of all pairs would take 10^8 entries


def inverse(model):
    scale = np.cbrt(np.linalg.det(model[:, :3]))
    linear = model[:, :3].T / scale**2
    return np.column_stack([linear, -linear @ model[:, 3]])


@variants
def test_symmetries_of_the_data(rng, estimator, scale):
    """Swapped clouds, another order of rows, another unit or another frame: the same motion."""
    rows, T, _ = simulated(rng, scale or 1.7, n=600, outliers=0.7, noise=0.004)
    threshold, true_scale = 0.02, scale or 1.7

    def check(rows, expected, scale=scale, threshold=threshold):
        model = run(estimator, rows, scale, threshold).model
        assert naive.angle_between(model, expected) < 1.5
        moved = naive.moved(model, rows[:, :3]) - naive.moved(expected, rows[:, :3])
        assert np.abs(moved).max() < threshold

    check(rows, T[:3])
    check(rows[rng.permutation(600)], T[:3])
    check(rows[:, [3, 4, 5, 0, 1, 2]].copy(), inverse(T[:3]), scale and 1 / scale, threshold / true_scale)
    for unit in (1e-3, 1e3):
        check(unit * rows, np.column_stack([T[:3, :3], unit * T[:3, 3]]), scale, unit * threshold)
    turn, shift = Rotation.random(random_state=rng).as_matrix(), np.array([50.0, -20.0, 8.0])
    moved = np.hstack([rows[:, :3] @ turn.T + shift, rows[:, 3:]])
    linear = T[:3, :3] @ turn.T
    check(moved, np.column_stack([linear, T[:3, 3] - linear @ shift]))


@pytest.mark.parametrize("unit", [2.0**-40, 2.0**-20, 2.0**20, 2.0**40])
def test_the_unit_changes_nothing(rng, unit):
    """A power of two scales all floating-point numbers exactly, as long as nothing over- or underflows."""
    rows, _, _ = simulated(rng, n=600, outliers=0.95, noise=0.004)
    plain = run(Pcr99.for_pairs(), rows, threshold=0.02)
    scaled = run(Pcr99.for_pairs(), unit * rows, threshold=0.02 * unit)
    assert scaled.tested == plain.tested
    np.testing.assert_array_equal(scaled.model[:, :3], plain.model[:, :3])


@pytest.mark.parametrize("far", [1e6, 1e9, 1e15, 1e30])
def test_one_row_far_from_all_others_does_no_harm(rng, far):
    rows, T, _ = simulated(rng, n=600, outliers=0.9, noise=0.004)
    rows[5, 3:] = far
    rows[6, :3] = -far
    assert naive.angle_between(run(Pcr99.for_pairs(), rows, threshold=0.02).model, T) < 1.5


def test_a_row_that_is_not_finite_does_no_harm(rng):
    rows, T, _ = simulated(rng, n=600, outliers=0.9, noise=0.004)
    rows[5, 3] = np.nan
    assert naive.angle_between(run(Pcr99.for_pairs(), rows, threshold=0.02).model, T) < 1.5


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        *(("compare", x) for x in ("ratio", None)),
        *(("order", x) for x in ("best", None)),
        *(("rank", x) for x in ("mean", None)),
        *(("refit", x) for x in ("twice", None)),
        *(("tolerance", x) for x in (0, -0.1, np.nan)),
        *(("enough_inliers", x) for x in (-0.1, np.nan)),
        *(("min_valid", x) for x in (-1,)),
        *(("max_valid", x) for x in (0, -1)),
        *(("max_drawn", x) for x in (0, -1)),
    ],
)
def test_wrong_settings_are_refused_by_name(name, wrong):
    with pytest.raises(ValueError, match=rf"^{name} must be"):
        Pcr99(**{name: wrong})


def test_distances_need_a_known_scale(rng):
    with pytest.raises(ValueError, match="needs a known scale"):
        run(Pcr99.for_pairs(), rng.standard_normal((20, 6)), scale=None)
    with pytest.raises(ValueError, match="needs a known scale"):
        Pcr99.for_pairs().check(Registration(None))


def samples_of(rng, count, right, noise=0.02):
    """Samples of 1,000 rows of which few are right."""
    model = naive.random_model(rng, spread=0.0)
    samples = []
    for _ in range(count):
        rows = np.hstack([rng.uniform(-1, 1, (1000, 3)), rng.uniform(-1, 1, (1000, 3))])
        rows[:right, 3:] = naive.moved(model, rows[:right, :3]) + noise * rng.standard_normal((right, 3))
        samples.append(rows)
    return model, samples


def test_a_joint_search_finds_what_single_samples_do_not_show(rng):
    estimator, noise, alone, jointly = Pcr99.for_pairs(), Noise.within(0.1), 0, 0
    for _ in range(10):
        model, samples = samples_of(rng, 10, 5)
        found = [estimator.estimate(Registration(), Rows(rows), noise, rng) for rows in samples]
        alone += sum(naive.angle_between(h.model, model) < 5 for h in found)
        joint = estimator.search_jointly(Registration(), found, Rows(np.concatenate(samples)), noise, rng)
        jointly += naive.angle_between(joint.model, model) < 5
        assert len(joint.residuals) == 1000
    assert alone < 50
    assert jointly >= 9


@pytest.mark.parametrize("samples", [4, 8])
def test_so_does_one_without_a_noise(samples):
    alone, jointly = 0, 0
    for seed in range(5):
        data = simulate.registration(2000 * samples, 0.995, 0.01, seed)
        rows = Rows(np.hstack([data.source, data.target]))
        random = np.random.default_rng(seed)
        pieces = [rows[piece] for piece in random.permutation(len(rows)).reshape(samples, -1)]
        found = [Pcr99.for_pairs().estimate_at_any_noise(Registration(), piece, random) for piece in pieces]
        alone += sum(naive.angle_between(h.model, data.T[:3]) < 5 for h in found)
        joint = Pcr99.for_pairs().search_jointly_at_any_noise(Registration(), found, random)
        jointly += naive.angle_between(joint.model, data.T[:3]) < 5
        assert 0.01 < joint.threshold < 0.1
        assert len(joint.residuals) <= 200 * samples
    assert alone < 2.5 * samples
    assert jointly == 5


def test_without_a_noise_there_is_no_joint_search_of_nothing(rng):
    nothing = Hypothesis(np.full((3, 4), np.nan), np.full(1000, np.inf), 0.1, tested=0)
    assert Pcr99.for_pairs().search_jointly_at_any_noise(Registration(), [nothing], rng) is None


def standardised(scores):
    return (scores - scores.mean()) / max(scores.std(), 1.0)


def test_promising_rows_are_consistent_with_the_most_others(rng):
    _, (rows,) = samples_of(rng, 1, 60)
    hypothesis = run(Pcr99.for_pairs(), rows, threshold=0.1)
    a, b = (np.linalg.norm(half[:, None] - half[None], axis=2) for half in (rows[:, :3], rows[:, 3:]))
    counts = (np.abs(a - b) < 0.04).sum(axis=1) - 1
    assert len(hypothesis.promising) == len(hypothesis.rank_scores) == 100
    expected = np.sort(standardised(counts))[::-1][:100]
    np.testing.assert_allclose(hypothesis.rank_scores, expected, atol=1.1 / counts.std())
    assert {tuple(row) for row in hypothesis.promising.values} <= {tuple(row) for row in rows}


def test_ranked_by_sums_promising_rows_are_those_whose_ratios_differ_least(rng):
    _, (rows,) = samples_of(rng, 1, 60)
    hypothesis = run(Pcr99(rank="sum", max_drawn=1000), rows, threshold=0.1)
    a, b = (np.linalg.norm(half[:, None] - half[None], axis=2) for half in (rows[:, :3], rows[:, 3:]))
    ratios = np.log(b + np.eye(1000)) - np.log(a + np.eye(1000))  # 0 of a row with itself
    sums = np.maximum(0, 0.1 - np.abs(ratios)).sum(axis=1) - 0.1
    np.testing.assert_allclose(hypothesis.rank_scores, np.sort(standardised(sums))[::-1][:100], atol=1e-9)


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_ranked_by_sums_of_distances_they_are_those_whose_distances_differ_least(rng, scale):
    _, (rows,) = samples_of(rng, 1, 60)
    rows[:, 3:] *= scale
    estimator = Pcr99("distance", rank="sum", tolerance=0.4, max_drawn=1000)
    hypothesis = run(estimator, rows, threshold=0.1, scale=scale)
    a, b = (np.linalg.norm(half[:, None] - half[None], axis=2) for half in (rows[:, :3], rows[:, 3:]))
    sums = np.maximum(0, 0.4 - np.abs(b - scale * a) / 0.1).sum(axis=1) - 0.4  # in thresholds; 0 of a row with itself
    np.testing.assert_allclose(hypothesis.rank_scores, np.sort(standardised(sums))[::-1][:100], atol=1e-9)


def test_a_random_order_has_no_joint_search(rng):
    _, (rows,) = samples_of(rng, 1, 500)
    estimator = Pcr99("distance", "random", tolerance=0.4)
    hypothesis = run(estimator, rows, threshold=0.1)
    assert hypothesis.promising is None
    assert len(hypothesis.rank_scores) == 0
    assert estimator.search_jointly(Registration(), [hypothesis], Rows(rows), Noise.within(0.1), rng) is None


def test_a_joint_search_goes_without_samples_that_promise_nothing(rng):
    model, (rows,) = samples_of(rng, 1, 200)
    found = run(Pcr99.for_pairs(), rows, threshold=0.1)
    nothing = Hypothesis(np.full((3, 4), np.nan), np.full(1000, np.inf), 0.1, tested=0)
    joint = Pcr99.for_pairs().search_jointly(Registration(), [nothing, found], Rows(rows), Noise.within(0.1), rng)
    assert naive.angle_between(joint.model, model) < 5


def test_promising_rows_keep_their_weights_and_are_ranked_by_them(rng):
    _, (rows,) = samples_of(rng, 1, 60)
    weights = np.where(np.arange(1000) % 2, 1.0, 3.0)
    estimator, noise = Pcr99.for_pairs(), Noise.within(0.1)
    weighted = estimator.estimate(Registration(), Rows(rows, weights), noise, rng)
    where = {tuple(row): weight for row, weight in zip(rows, weights, strict=True)}
    np.testing.assert_array_equal(weighted.promising.weights, [where[tuple(row)] for row in weighted.promising.values])
    a, b = (np.linalg.norm(half[:, None] - half[None], axis=2) for half in (rows[:, :3], rows[:, 3:]))
    counts = (np.abs(a - b) < 0.04).sum(axis=1) - 1
    ranks = counts * weights / weights.mean()
    np.testing.assert_allclose(weighted.rank_scores, np.sort(standardised(ranks))[::-1][:100], atol=3 / ranks.std())
