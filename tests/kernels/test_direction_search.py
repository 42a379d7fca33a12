"""Branch and bound, against all directions, angles and shifts of a grid."""

import numpy as np
import pytest

from nonsac.kernels.direction_search import best_angle, best_direction, best_shift

WIDTH = 0.5
by_both = pytest.mark.parametrize("by_count", [False, True])


def gains(distances, slacks, by_count):
    """Of absolute residuals, by definition."""
    if by_count:
        return (distances <= WIDTH + slacks + 1e-12).astype(float)
    return np.clip(WIDTH - (distances - slacks), 0.0, WIDTH)


def gain_at(shift, values, slacks, by_count):
    return gains(np.abs(values - shift), slacks, by_count).sum()


def largest_gain(values, by_count, slacks=0.0):
    """Over the shifts at which the sum changes its slope or its value."""
    corners = np.concatenate([values + sign * (slacks + width) for sign in (-1, 1) for width in (0.0, WIDTH)])
    return max(gain_at(shift, values, slacks, by_count) for shift in corners)


@by_both
@pytest.mark.parametrize("n", [1, 2, 3, 40])
def test_a_shift_is_the_best_of_all(rng, n, by_count):
    for slacks in (np.zeros(n), rng.uniform(0, 1, n)):
        values = rng.uniform(-3, 3, n)
        gain, shift = best_shift(values, slacks, WIDTH, by_count, np.empty((4, n)))
        assert gain == pytest.approx(largest_gain(values, by_count, slacks))
        assert gain == pytest.approx(gain_at(shift, values, slacks, by_count))
        grid = max(gain_at(x, values, slacks, by_count) for x in np.linspace(-5, 5, 2001))
        assert gain >= grid - 1e-9


def some_rows(rng, n, truth):
    """Points and values of which a half is truth . point + 1, nearly."""
    points = rng.uniform(-3, 3, (n, len(truth)))
    values = points @ truth + 1.0 + 0.05 * rng.standard_normal(n)
    values[n // 2 :] = rng.uniform(-6, 6, n - n // 2)
    return points, values


@by_both
@pytest.mark.parametrize("faces", [6, 3])
def test_no_direction_is_better(rng, by_count, faces):
    for number in range(4):
        truth = rng.standard_normal(3)
        truth /= np.linalg.norm(truth) * (1.0 if truth[number % 3] > 0 or faces == 6 else -1.0)
        points, values = some_rows(rng, 30, truth)
        if faces == 3:
            values = np.zeros(30)
            points[:15] -= (points[:15] @ truth - 1.0)[:, None] * truth  # in a plane
        found = np.zeros(3)
        gain, shift, bound, _ = best_direction(points, values, WIDTH, by_count, faces, 0.01, 50_000, found)
        assert np.linalg.norm(found) == pytest.approx(1.0)
        rounding = 1.0 if by_count else 1e-9
        assert gain == pytest.approx(gain_at(shift, values - points @ found, 0.0, by_count), abs=rounding)
        assert gain <= bound <= 1.01 * gain + 1e-9
        others = rng.standard_normal((300, 3))
        others /= np.linalg.norm(others, axis=1, keepdims=True)
        others = np.vstack([others, truth])
        assert max(largest_gain(values - points @ other, by_count) for other in others) <= bound + 1e-9
        assert abs(found @ truth) > 0.95


@by_both
def test_a_bound_holds_if_the_search_is_broken_off(rng, by_count):
    truth = np.array([0.0, 0.6, -0.8])
    points, values = some_rows(rng, 30, truth)
    best = largest_gain(values - points @ truth, by_count)
    bounds = []
    for budget in (1, 10, 40, 200, 1000):
        gain, _, bound, cells = best_direction(points, values, WIDTH, by_count, 6, 0.0, budget, np.zeros(3))
        assert best <= bound + 1e-9
        assert gain <= bound
        assert cells <= budget + 6
        bounds.append(bound)
    assert bounds == sorted(bounds, reverse=True)
    assert bounds[-1] < bounds[0]


@by_both
def test_no_angle_is_better(rng, by_count):
    for _ in range(4):
        truth = rng.uniform(-np.pi, np.pi)
        turn = np.array([[np.cos(truth), -np.sin(truth)], [np.sin(truth), np.cos(truth)]])
        points = rng.uniform(-3, 3, (40, 2))
        values = points @ turn.T + [0.3, -2.0] + 0.05 * rng.standard_normal((40, 2))
        values[20:] = rng.uniform(-6, 6, (20, 2))
        shifts = np.zeros(2)
        angle, gain, _ = best_angle(points, values, WIDTH, by_count, 0.01, 10_000, shifts)
        assert np.cos(angle - truth) > 0.99
        np.testing.assert_allclose(shifts, [0.3, -2.0], atol=0.6)
        for other in np.append(np.linspace(-np.pi, np.pi, 200), truth):
            turn = np.array([[np.cos(other), -np.sin(other)], [np.sin(other), np.cos(other)]])
            both = [largest_gain(column, by_count) for column in (values - points @ turn.T).T]
            assert (min(both) if by_count else sum(both)) <= 1.01 * gain + 1e-9
