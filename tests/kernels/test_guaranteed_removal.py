"""Bounds on how many rows agree, against those that do."""

import numpy as np
import pytest

import naive
from graph_samples import random_edges, words_of
from nonsac.kernels import guaranteed_removal as kernels
from nonsac.kernels.consistency_graph import count_common_neighbours


def edges_of(pairs, tolerance):
    first, second = (np.linalg.norm(half[:, None] - half[None], axis=2) for half in (pairs[:, :3], pairs[:, 3:]))
    return (np.abs(first - second) < tolerance) & ~np.eye(len(pairs), dtype=bool)


def agreeing_pairs(rng, n, right, size):
    """Pairs of which the first have residuals of at most 1, most of them hardly less."""
    model = naive.random_model(rng, spread=size)
    pairs = rng.uniform(-size, size, (n, 6))
    errors = rng.standard_normal((right, 3))
    errors *= (rng.choice([0.2, 0.999], right) / np.linalg.norm(errors, axis=1))[:, None]
    pairs[:right, 3:] = naive.moved(model, pairs[:right, :3]) + errors
    return pairs


def bounded(pairs, budget=10**8):
    words = words_of(edges_of(pairs, 2.0))
    bounds, model = np.empty((len(pairs),) * 2, np.uint16), np.full((3, 4), np.nan)
    count_common_neighbours(words, bounds)
    before = bounds + np.uint16(2)
    bounds = before.copy()
    order = rng_order(len(pairs))
    lower, stabbed = kernels.bound_edges(pairs, words, order, 2.0, budget, bounds, model)
    return words, before, bounds, model, lower, stabbed


def rng_order(n):
    return np.random.default_rng(n).permutation(n)


@pytest.mark.parametrize("n", [1, 2, 5, 40])
def test_most_arcs_overlap_where_a_grid_says(rng, n):
    for _ in range(10):
        middles, halves = rng.uniform(-7, 7, n), rng.uniform(0.01, 3.0, n)
        best, angle = kernels.most_overlapping(middles, halves, n, np.empty(2 * n), np.empty(2 * n))

        def covered(x, middles=middles, halves=halves):
            return (np.abs((x - middles + np.pi) % (2 * np.pi) - np.pi) <= halves + 1e-9).sum()

        assert best == covered(angle)
        assert best >= max(covered(x) for x in np.linspace(0, 2 * np.pi, 3000))


@pytest.mark.parametrize(("right", "size"), [(12, 5.0), (20, 8.0), (20, 12.0)])
def test_no_bound_is_below_the_rows_that_agree(rng, right, size):
    for _ in range(3):
        pairs = agreeing_pairs(rng, 200, right, size)
        _, before, bounds, model, lower, stabbed = bounded(pairs)
        assert (bounds[:right, :right][~np.eye(right, dtype=bool)] >= right).all()
        assert (bounds <= before).all()
        assert lower == (naive.residuals(model, pairs) < 1.0).sum()
        assert stabbed > 10
        assert lower >= 0.5 * right  # half of the errors are all that a motion may leave
        assert (bounds < before).sum() > 50


def test_arcs_hold_the_true_angle(rng):
    """That between the frames of the two rows, for each row that agrees with them."""
    pairs = agreeing_pairs(rng, 60, 60, 10.0)
    pairs[:, 3:] = naive.moved(np.eye(3, 4), pairs[:, :3])  # no errors: the angle is the same for all
    words, n = words_of(edges_of(pairs, 2.0)), 60
    middles, halves, first, second = np.empty(n), np.empty(n), np.empty((3, 3)), np.empty((3, 3))
    count, anywhere = kernels.arcs_about(pairs, words, 3, 9, 2.0, middles, halves, first, second)
    assert count + anywhere == 58
    assert count > 30
    for frame in (first, second):
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame) > 0.0
    turn = second.T @ first
    angle = np.arctan2(turn[1, 0], turn[0, 0])
    off = np.abs((angle - middles[:count] + np.pi) % (2 * np.pi) - np.pi)
    np.testing.assert_allclose(off, 0.0, atol=1e-6)
    assert (halves[:count] > 0.0).all()


def test_without_a_budget_nothing_is_bounded(rng):
    pairs = agreeing_pairs(rng, 60, 20, 10.0)
    _, before, bounds, *_, stabbed = bounded(pairs, budget=-1)
    assert stabbed == 0
    np.testing.assert_array_equal(bounds, before)


def test_rows_are_left_that_have_neighbours_left(rng):
    edges = random_edges(rng, 70, 0.2)
    edges[:25, :25] = ~np.eye(25, dtype=bool)
    bounds = rng.integers(0, 20, (70, 70)).astype(np.uint16)
    bounds = np.maximum(bounds, bounds.T)
    is_left, expected = np.empty(70, np.bool_), np.ones(70, bool)
    kernels.rows_left(words_of(edges), bounds, 12, is_left)
    kept = edges & (bounds >= 12)
    while (weak := expected & (kept[:, expected].sum(axis=1) + 1 < 12)).any():
        expected &= ~weak
    np.testing.assert_array_equal(is_left, expected)
    assert 0 < expected.sum() < 70
