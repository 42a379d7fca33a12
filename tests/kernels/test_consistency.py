from itertools import chain

import numpy as np
import pytest
from scipy.spatial.distance import cdist

import naive
from nonsac.kernels.consistency import (
    count_consistent_distances,
    count_consistent_ratios,
    ranked_triplets,
    screened_triplets,
    sum_consistent_distances,
    sum_consistent_ratios,
)

START = [3, 0, 1, 0]
SCREENS = {
    "distance": (False, True, 1.0, 0.5),
    "distance scale 3": (False, True, 3.0, 0.5),
    "ratio": (True, True, 1.0, 0.2),
    "ratio scale 3": (True, True, 3.0, 0.2),
    "ratio free scale": (True, False, 1.0, 0.2),
}
screens = pytest.mark.parametrize("screen", SCREENS.values(), ids=SCREENS)


def columns(rows, dtype=np.float64):
    return np.ascontiguousarray(rows.T, dtype)


def distance_counts(rows, tolerance):
    counts = np.full(len(rows), -1, np.int32)
    count_consistent_distances(columns(rows, np.float32), np.float32(tolerance), counts)
    return counts


def ratio_counts(rows, scale, tolerance):
    counts = np.full(len(rows), -1, np.int32)
    count_consistent_ratios(columns(rows), scale is not None, np.log(scale or 1.0), tolerance, counts)
    return counts


def draw(rows, screen, room, max_drawn=10**9, state=None):
    found = np.full((room, 3), -1, np.int64)
    state = np.array(START, np.int64) if state is None else state
    count = ranked_triplets(columns(rows), *screen, max_drawn, state, found)
    return [tuple(map(int, triplet)) for triplet in found[:count]]


def naive_triplets(rows, screen, max_drawn=None):
    by_ratio, known, scale, tolerance = screen
    drawn = naive.triplets_by_rank_sum(len(rows))[:max_drawn]
    return [t for t in drawn if naive.triplet_is_consistent(rows, t, by_ratio, scale if known else None, tolerance)]


def mixed_rows(rng, n, scale=1.0, noise=0.02):
    """Half right, half wrong rows, shuffled."""
    rows = naive.matching_rows(rng, n, naive.random_model(rng, scale), noise)
    rows[: n // 2, 3:] = scale * rng.standard_normal((n // 2, 3))
    return rng.permutation(rows)


@pytest.mark.parametrize("n", [0, 1, 2, 3, 17, 90])
@pytest.mark.parametrize("tolerance", [0.05, 0.5, 3.0])
def test_distance_counts_equal_the_double_loop(rng, n, tolerance):
    rows = mixed_rows(rng, n)
    disagreement = naive.distance_disagreement(rows)
    unclear = np.abs(disagreement - tolerance) < 1e-5
    difference = distance_counts(rows, tolerance) - (disagreement < tolerance).sum(axis=1)
    assert (np.abs(difference) <= unclear.sum(axis=1)).all()
    assert unclear.sum() <= 2


@pytest.mark.parametrize("n", [511, 512, 513, 1025, 1100])
def test_distance_counts_of_many_rows(rng, n):
    """The kernel works in blocks: each pair is counted wherever its rows stand."""
    rows = mixed_rows(rng, n)
    disagreement = np.abs(cdist(rows[:, :3], rows[:, :3]) - cdist(rows[:, 3:], rows[:, 3:]))
    np.fill_diagonal(disagreement, np.inf)
    difference = distance_counts(rows, 0.5) - (disagreement < 0.5).sum(axis=1)
    assert (np.abs(difference) <= (np.abs(disagreement - 0.5) < 1e-5).sum(axis=1)).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_rows_that_are_not_finite_agree_with_none(rng, bad):
    rows = mixed_rows(rng, 12)
    rows[5, 1] = bad
    counts = distance_counts(rows, 100.0)
    assert counts[5] == 0
    assert (np.delete(counts, 5) == 10).all()


def test_identical_rows_agree():
    np.testing.assert_array_equal(distance_counts(np.ones((4, 6)), 0.1), [3, 3, 3, 3])


@pytest.mark.parametrize("scale", [1.0, 0.2, 20.0])
@pytest.mark.parametrize("n", [2, 17, 60])
def test_ratio_counts_equal_the_double_loop(rng, n, scale):
    rows = mixed_rows(rng, n, scale)
    np.testing.assert_array_equal(ratio_counts(rows, scale, 0.1), naive.log_ratio_counts(rows, scale, 0.1))


def test_ratio_counts_without_a_scale_find_the_shared_one(rng):
    n, tolerance = 60, 0.1
    rows = mixed_rows(rng, n, scale=4.0, noise=1e-3)
    counts = ratio_counts(rows, None, tolerance)
    for i in range(n):  # the best window of this width anywhere, and the one that the histogram is sure to hold
        pairs = [naive.distances(rows, i, j) for j in range(n) if j != i]
        logs = np.sort([np.log(b / a) for a, b in pairs])
        best = max((np.abs(logs - centre) <= tolerance).sum() for centre in np.linspace(-4, 4, 1601))
        sure = max(((logs >= low) & (logs < low + tolerance)).sum() for low in logs)
        assert sure <= counts[i] <= best + 1


def test_ratios_of_identical_points_do_not_count():
    rows = np.zeros((3, 6))
    rows[2] = 1.0
    np.testing.assert_array_equal(ratio_counts(rows, 1.0, 0.1), [1, 1, 2])
    np.testing.assert_array_equal(ratio_counts(rows, None, 0.1), [1, 1, 2])


@screens
@pytest.mark.parametrize("n", [0, 1, 2, 3, 4, 5, 12, 25])
def test_ranked_triplets_equal_all_triplets_sorted(rng, n, screen):
    rows = mixed_rows(rng, n, scale=screen[2])
    expected = naive_triplets(rows, screen)
    assert draw(rows, screen, room=len(expected) + 1) == expected


def test_every_triplet_is_drawn_once_in_order(rng):
    everything = (False, True, 1.0, 1e9)
    assert draw(rng.standard_normal((30, 6)), everything, room=5000) == naive.triplets_by_rank_sum(30)


@screens
@pytest.mark.parametrize("room", [1, 2, 7])
def test_a_later_call_goes_on_where_the_first_stopped(rng, screen, room):
    rows = mixed_rows(rng, 16, scale=screen[2])
    state, pieces = np.array(START, np.int64), []
    while len(pieces) == 0 or len(pieces[-1]) == room:
        pieces.append(draw(rows, screen, room, state=state))
    assert list(chain(*pieces)) == naive_triplets(rows, screen)
    assert state[3] == 16 * 15 * 14 // 6
    assert draw(rows, screen, room, state=state) == []


@screens
@pytest.mark.parametrize("max_drawn", [0, 1, 10, 100])
def test_no_more_than_max_drawn_are_looked_at(rng, screen, max_drawn):
    rows = mixed_rows(rng, 16, scale=screen[2])
    state = np.array(START, np.int64)
    assert draw(rows, screen, 1000, max_drawn, state) == naive_triplets(rows, screen, max_drawn)
    assert state[3] == max_drawn


def test_max_drawn_counts_over_all_calls(rng):
    everything = (False, True, 1.0, 1e9)
    rows, state = rng.standard_normal((10, 6)), np.array(START, np.int64)
    first = draw(rows, everything, 4, 6, state)
    second = draw(rows, everything, 4, 6, state)
    assert first + second == naive.triplets_by_rank_sum(10)[:6]


@screens
def test_rows_that_are_not_finite_are_in_no_triplet(rng, screen):
    rows = naive.matching_rows(rng, 8, naive.random_model(rng, screen[2]))
    rows[[0, 4], [2, 5]] = np.nan
    found = draw(rows, screen, 100)
    assert len(found) == 6 * 5 * 4 // 6
    assert not {0, 4} & set(np.ravel(found))


@screens
def test_screened_triplets_keep_the_consistent_ones_in_their_order(rng, screen):
    rows = mixed_rows(rng, 12, scale=screen[2])
    drawn = rng.integers(12, size=(500, 3))
    found = np.empty_like(drawn)
    count = screened_triplets(columns(rows), drawn, *screen, found)
    by_ratio, known, scale, tolerance = screen
    expected = [
        list(t)
        for t in drawn.tolist()
        if len(set(t)) == 3 and naive.triplet_is_consistent(rows, t, by_ratio, scale if known else None, tolerance)
    ]
    assert found[:count].tolist() == expected


@pytest.mark.parametrize("n", [0, 1, 2, 3, 60])
@pytest.mark.parametrize("scale", [1.0, 3.0, None])
def test_ratio_sums_are_truncated_differences_turned_round(rng, n, scale):
    rows = mixed_rows(rng, n, scale or 3.0)
    tolerance, sums = 0.1, np.full(n, -1.0)
    sum_consistent_ratios(columns(rows), scale is not None, np.log(scale or 1.0), tolerance, sums)
    for i in range(n):
        a, b = (np.linalg.norm(np.delete(half, i, axis=0) - half[i], axis=1) for half in (rows[:, :3], rows[:, 3:]))
        ratios = np.log(b / a)
        middles = [np.log(scale)] if scale else naive.fullest_windows(ratios, tolerance)
        truncated = [np.minimum(np.abs(ratios - middle), tolerance).sum() for middle in middles]
        expected = tolerance * (n - 1) - np.array(truncated)
        assert np.isclose(sums[i], expected, rtol=1e-9, atol=1e-12).any()


@pytest.mark.parametrize("n", [0, 1, 2, 3, 60])
def test_distance_sums_are_truncated_differences_turned_round(rng, n):
    rows = mixed_rows(rng, n, 1.0)
    tolerance, sums = 0.2, np.full(n, -1.0)
    sum_consistent_distances(columns(rows), tolerance, sums)
    for i in range(n):
        a, b = (np.linalg.norm(np.delete(half, i, axis=0) - half[i], axis=1) for half in (rows[:, :3], rows[:, 3:]))
        expected = tolerance * (n - 1) - np.minimum(np.abs(b - a), tolerance).sum()
        assert np.isclose(sums[i], expected, rtol=1e-9, atol=1e-12)
