import numpy as np
import pytest

from nonsac import simulate
from nonsac.kernels.ladder import best_on_ladder, count_on_ladder, likelihood_ratios
from nonsac.problems import AbsolutePose, Problem, Registration, RelativePose
from nonsac.problems.ladder import BEYOND, LADDER


def counted(residuals, lowest, rungs, few=0):
    counts = np.full((len(residuals), rungs), -1)
    count_on_ladder(residuals, lowest, few, counts)
    return counts


@pytest.mark.parametrize("lowest", [1e-6, 0.3, 1e5])
def test_counts_are_those_of_each_threshold(rng, lowest):
    residuals = lowest * 2.0 ** rng.uniform(-3, 16, (5, 1000))
    residuals[0, :3] = 0.0, np.nan, np.inf
    expected = [[np.count_nonzero(row < lowest * 2 ** (j / 2)) for j in range(25)] for row in residuals]
    np.testing.assert_array_equal(counted(residuals, lowest, 25), expected)


def test_below_a_threshold_with_few_there_are_none():
    residuals = np.array([[0.1, 0.2, 3.0, 3.0, 9.0]])
    np.testing.assert_array_equal(counted(residuals, 1.0, 8), [[2, 2, 2, 2, 4, 4, 4, 5]])
    np.testing.assert_array_equal(counted(residuals, 1.0, 8, few=2), [[0, 0, 0, 2, 4, 4, 4, 5]])


CASES = {
    "registration": (Registration(), simulate.registration, ("source", "target"), 1.0),
    "relative pose": (RelativePose(900.0, 700.0), simulate.relative_pose, ("points1", "points2"), 900.0),
    "absolute pose": (AbsolutePose(800.0), simulate.absolute_pose, ("points2d", "points3d"), 800.0),
}


@pytest.mark.parametrize("case", CASES)
def test_fast_counts_are_those_of_the_residuals(rng, case):
    """In single precision a row in a thousand may change sides."""
    problem, make, names, unit = CASES[case]
    data = make(2000, 0.5, 0.002, rng)
    rows = np.hstack([getattr(data, name) for name in names])
    samples = rows[rng.integers(len(rows), size=(20, problem.minimal_size))]
    models = np.concatenate([data.T[None, :3], problem.solve_minimal(samples)])
    fast, slow = (count(models, rows, unit * LADDER) for count in (problem.count_on_ladder, slow_count(problem)))
    assert fast[0, -1] > 1000
    assert np.abs(fast - slow).max() <= 2


def slow_count(problem):
    return lambda models, rows, thresholds: Problem.count_on_ladder(problem, models, rows, thresholds)


# --- which is least likely by chance ----------------------------------------------------------------------------------


def best(counts, rows=1000, fitted=3, chance=0.0, dimension=2):
    rungs = counts.shape[1] - BEYOND
    scores, numbers = np.empty(rungs), np.empty(rungs, np.int64)
    best_on_ladder(counts, rows, fitted, np.full(rungs, chance), dimension, scores, numbers)
    return scores, numbers


def score(count, rows, fitted, rate):
    """Hoeffding's bound as it is in books: n KL(k / n || p)."""
    share, free = (count - fitted) / (rows - fitted), rows - fitted
    return free * (share * np.log(share / rate) + (1 - share) * np.log((1 - share) / (1 - rate)))


def test_the_score_is_hoeffdings_bound():
    scores, numbers = best(np.full((1, BEYOND + 1), 103), chance=0.01)
    assert numbers[0] == 0
    assert scores[0] == pytest.approx(score(103, 1000, 3, 0.01))


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_rows_that_go_on_beyond_the_threshold_are_chance(dimension):
    """As dense as out to twice as far, a rung two above: nothing is special about the threshold."""
    inside, twice = 100, 100 * 2**dimension
    even = np.array([[inside, inside, twice, twice, twice * 2**dimension]])
    assert best(even, rows=10_000, dimension=dimension)[0] == 0.0
    ended = np.array([[inside, inside, inside + 7, inside + 7, inside + 7]])
    rate = 7.5 / (2**dimension - 1) / 10_000
    assert best(ended, rows=10_000, dimension=dimension)[0] == pytest.approx(score(100, 10_000, 3, rate))


def test_the_best_model_of_each_threshold(rng):
    counts = np.sort(rng.integers(3, 900, (50, 9)), axis=1)
    scores, numbers = best(counts, chance=0.2)
    for rung in range(9 - BEYOND):
        alone = [best(row[None, rung : rung + BEYOND + 1], chance=0.2)[0][0] for row in counts]
        assert scores[rung] == max(alone)
        assert numbers[rung] == (np.argmax(alone) if max(alone) > 0.0 else -1)


def test_no_more_than_chance_is_nothing():
    scores, numbers = best(np.full((1, BEYOND + 2), 50), chance=0.06)
    assert (scores == 0.0).all()
    assert (numbers == -1).all()


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_likelihoods_are_those_of_a_mixture(rng, dimension):
    """Maximised over the share of inliers by trying all; densities over the volume within the threshold."""
    sigma, threshold, n = 0.2, 1.0, 3000
    lengths = np.linalg.norm(sigma * rng.standard_normal((600, dimension)), axis=1)
    chance = 0.1
    wrong = np.where(rng.random(n - 600) < chance, rng.random(n - 600) ** (1 / dimension), 9.0) * threshold
    residuals, found = np.concatenate([lengths, wrong]), np.empty(1)
    near = residuals < threshold
    volume = {1: 2.0, 2: np.pi, 3: 4.0 / 3.0 * np.pi}[dimension]
    gaussian = np.exp(-0.5 * (residuals[near] / sigma) ** 2) / (2.0 * np.pi * sigma**2) ** (dimension / 2)
    relative = gaussian * volume * threshold**dimension / chance
    shares = np.linspace(1e-3, 0.99, 500)
    logs = [np.log(s * relative + 1 - s).sum() + (~near).sum() * np.log(1 - s) for s in shares]
    peak = volume * 5.0**dimension / (2.0 * np.pi) ** (dimension / 2)
    likelihood_ratios(residuals, np.array([threshold]), np.array([chance]), peak, 3, found)
    assert found[0] == pytest.approx(max(logs), abs=1.0)
    assert found[0] > 500.0


def test_few_residuals_within_a_threshold_say_nothing():
    found = np.zeros(2)
    likelihood_ratios(np.array([0.1, 0.2, 5.0, 6.0]), np.array([1.0, 9.0]), np.array([0.1, 0.9]), 4.0, 2, found)
    assert found[0] == -np.inf
    assert np.isfinite(found[1])
