from itertools import combinations
from math import comb

import numpy as np
import pytest
from scipy.stats import chisquare

import naive
from nonsac import ArraySource, Noise, Registration, RelativePose, Rows, estimate, simulate
from nonsac.estimators.named import ESTIMATORS
from nonsac.estimators.prosac import Progressive, _distinct_below, growth, samples_needed
from nonsac.estimators.usac import Uniform, Usac

NOISE = 1e-3


def two_views(rng, n=400, outliers=0.5):
    """Rows, their weights, which are higher for right ones in the mean, and the truth."""
    matches = simulate.relative_pose(n, outliers, NOISE, rng)
    rows, T = np.hstack([matches.points1, matches.points2]), matches.T
    right = RelativePose().residuals(T[None, :3], rows)[0] < 5 * NOISE
    return rows, np.where(right, rng.beta(4, 2, n), rng.beta(2, 4, n)), T


# --- growth -----------------------------------------------------------------------------------------------------------


def published_growth(rows, size, horizon):
    """Eq. 3 and what follows it, step by step."""
    average = horizon
    for i in range(size):
        average *= (size - i) / (rows - i)
    whole, ends = 1, [1]
    for n in range(size, rows):
        following = average * (n + 1) / (n + 1 - size)
        whole += int(np.ceil(following - average - 1e-9))
        ends.append(whole)
        average = following
    return ends


@pytest.mark.parametrize(("rows", "size"), [(20, 3), (57, 5), (8, 8), (100, 1)])
def test_sets_grow_as_published(rows, size):
    found = growth(rows, size, 5000)
    assert len(found) == rows - size + 1
    np.testing.assert_array_equal(found, published_growth(rows, size, 5000))


def test_after_the_horizon_all_sets_were_drawn_as_often_as_by_ransac():
    """Sec. 2.1: T_n of T_N samples of RANSAC are from the n best rows; of the first three, one will do."""
    ends = growth(40, 3, 200_000)
    for n in (5, 10, 20, 40):
        assert ends[n - 3] == pytest.approx(1 + 200_000 * (comb(n, 3) - 1) / comb(40, 3), abs=n)


def test_each_sample_holds_the_newest_row_and_better_ones(rng):
    rows = Rows(rng.standard_normal((30, 2)), rng.permutation(30) + 1.0)
    rank = np.argsort(np.argsort(-rows.weights))
    samples = Progressive(horizon=1000).draw(rows, 3, 0, 1100, rng)
    newest = rank[samples].max(axis=1) + 1
    ends = growth(30, 3, 1000)
    for t in range(1, ends[-1] + 1):
        assert newest[t - 1] == 3 + np.argmax(ends >= t)
    assert newest[0] == 3
    assert (np.diff(np.sort(samples, axis=1), axis=1) > 0).all()


def test_samples_do_not_depend_on_the_batches_they_come_in(rng):
    rows, sampler = Rows(rng.standard_normal((30, 2)), rng.random(30) + 0.1), Progressive(horizon=500)
    newest = np.argsort(np.argsort(-rows.weights))
    whole = sampler.draw(rows, 3, 0, 200, rng)
    parts = np.concatenate([sampler.draw(rows, 3, first, 50, rng) for first in range(0, 200, 50)])
    np.testing.assert_array_equal(newest[whole].max(axis=1), newest[parts].max(axis=1))


def test_it_ends_as_ransac(rng):
    """Beyond the horizon all samples are alike."""
    rows = Rows(rng.standard_normal((6, 2)), rng.random(6) + 0.1)
    samples = np.sort(Progressive(horizon=10).draw(rows, 2, 100, 15_000, rng), axis=1)
    found = dict.fromkeys(combinations(range(6), 2), 0)
    for sample in map(tuple, samples.tolist()):
        found[sample] += 1
    assert chisquare(list(found.values())).pvalue > 1e-4


def test_all_sets_below_a_top_are_equally_likely(rng):
    drawn = np.sort(_distinct_below(np.full(30_000, 7), 3, rng), axis=1)
    found = dict.fromkeys(combinations(range(7), 3), 0)
    for sample in map(tuple, drawn.tolist()):
        found[sample] += 1
    assert chisquare(list(found.values())).pvalue > 1e-4


# --- stopping ---------------------------------------------------------------------------------------------------------


def published_need(right, size, share, confidence, chance, least):
    """Eq. 7 to 12 for each set of the best rows, one after the other."""
    needs = []
    for n in range(max(least, size + 1), len(right) + 1):
        count = int(np.sum(right[:n]))
        if count <= size:
            continue
        by_chance = sum(
            share ** (i - size) * (1 - share) ** (n - i) * comb(n - size, i - size) for i in range(count, n + 1)
        )
        if by_chance >= chance:
            continue
        all_inliers = np.prod([(count - j) / (n - j) for j in range(size)])
        needs.append(1 if all_inliers == 1 else int(np.ceil(np.log(1 - confidence) / np.log(1 - all_inliers))))
    return min(needs, default=2**62)


@pytest.mark.parametrize("ratio", [0.02, 0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("size", [1, 3, 5])
def test_stops_as_published(rng, ratio, size):
    for _ in range(20):
        right = np.sort(rng.random(80)) < rng.random() if ratio == 0.3 else rng.random(80) < ratio
        found = samples_needed(np.cumsum(right), size, 0.1, 0.95, 0.05, 20)
        assert found == published_need(right, size, 0.1, 0.95, 0.05, 20)


@pytest.mark.parametrize("size", [1, 3, 5])
def test_as_many_inliers_are_asked_for_as_published(size):
    """Of thirty rows, each number of them."""
    found, published = (
        [need(np.cumsum(right) if need is samples_needed else right, size, 0.2, 0.95, 0.05, 30) for right in rights]
        for need, rights in ((need, [np.arange(30) < count for count in range(31)]) for need in NEEDS)
    )
    assert found == published


NEEDS = (samples_needed, published_need)


def test_inliers_that_chance_explains_do_not_end_the_search():
    right = np.arange(1000) % 10 == 0
    assert samples_needed(np.cumsum(right), 3, 0.1, 0.95, 0.05, 20) == 2**62
    assert samples_needed(np.cumsum(right), 3, 0.001, 0.95, 0.05, 20) < 10_000


def test_finds_it_in_far_fewer_samples_than_ransac():
    """What it is for (Sec. 3)."""
    tested = np.zeros(2)
    for seed in range(10):
        rows, weights, T = two_views(np.random.default_rng(seed), 1000, 0.8)
        for i, sampler in enumerate((Progressive(), Uniform())):
            of_weights = weights if sampler == Progressive() else None
            found = Usac(50_000, sampler=sampler).estimate(
                RelativePose(), Rows(rows, of_weights), Noise.given(NOISE), np.random.default_rng(seed)
            )
            tested[i] += found.tested
            assert naive.angle_between(found.model, T) < 2.0
    assert 10 * tested[0] < tested[1]


# --- weights ----------------------------------------------------------------------------------------------------------


def test_only_the_order_of_the_weights_matters_for_the_drawing(rng):
    values, weights = rng.standard_normal((50, 2)), rng.random(50) + 0.1
    first, second = (
        Progressive().draw(Rows(values, w), 3, 10, 100, np.random.default_rng(1)) for w in (weights, weights**5)
    )
    np.testing.assert_array_equal(first, second)


def test_rows_without_weights_are_refused_in_words(rng):
    rows, _, _ = two_views(rng)
    found = ESTIMATORS["prosac"].made_for(RelativePose()).estimate(RelativePose(), Rows(rows), Noise.given(NOISE), rng)
    assert not found.found
    assert found.fault == "PROSAC draws rows in the order of their weights, and these have none"
    with pytest.raises(ValueError, match="rows in the order of their weights, and these have none: give weights="):
        estimate(ArraySource(rows), RelativePose(), "prosac", noise=NOISE, samples=2)


@pytest.mark.parametrize("hopeless", ["same", "few", "none"])
def test_hopeless_rows_give_nothing(rng, hopeless):
    pairs = simulate.registration(100, 0.5, NOISE, rng)
    rows = np.hstack([pairs.source, pairs.target])
    rows = {"same": np.repeat(rows[:1], 50, axis=0), "few": rows[:2], "none": rows[:0]}[hopeless]
    estimator = ESTIMATORS["prosac"].made_for(Registration())
    found = estimator.estimate(Registration(), Rows(rows, np.ones(len(rows))), Noise.given(NOISE), rng)
    assert not found.found
    assert len(found.residuals) == len(rows)


def test_the_same_random_numbers_give_the_same_model():
    rows, weights, _ = two_views(np.random.default_rng(0))
    first, second = (
        ESTIMATORS["prosac"]
        .made_for(RelativePose())
        .estimate(RelativePose(), Rows(rows, weights), Noise.given(NOISE), np.random.default_rng(3))
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.model, second.model)


@pytest.mark.parametrize("name", ["horizon", "least"])
@pytest.mark.parametrize("wrong", [0, 1.5, True, "3"])
def test_wrong_numbers_are_refused_by_name(name, wrong):
    with pytest.raises(ValueError, match=f"{name} must be a whole number of at least 1, got"):
        Progressive(**{name: wrong})


@pytest.mark.parametrize("wrong", [0, 1, np.nan, "small"])
def test_a_wrong_chance_is_refused_by_name(wrong):
    with pytest.raises(ValueError, match="chance must be between 0 and 1, got"):
        Progressive(chance=wrong)
