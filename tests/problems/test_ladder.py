import numpy as np
import pytest
from scipy.stats import binom

import naive
from nonsac import simulate
from nonsac.layouts import Rows
from nonsac.problems import Registration, RelativePose
from nonsac.problems.ladder import LADDER, Ladder, Level, Telling, log_chance


def pairs(rng, n=1000, outliers=0.8, noise=0.01):
    data = simulate.registration(n, outliers, noise, rng)
    return Registration(), data.T[:3], Rows(np.hstack([data.source, data.target]))


def test_thresholds_are_shares_of_what_wrong_rows_leave(rng):
    problem, _, rows = pairs(rng)
    ladder = Ladder.of(problem, rows, rng)
    np.testing.assert_allclose(ladder.thresholds[1:] / ladder.thresholds[:-1], np.sqrt(2.0))
    assert 0.3 < ladder.thresholds[-1] < 3.0  # in a cube of 1
    assert (np.diff(ladder.chance) >= 0.0).all()
    assert 0.0 < ladder.chance[0] < 0.001


@pytest.mark.parametrize("rows", [np.zeros((50, 6)), np.zeros((3, 6)), np.empty((0, 6))])
def test_there_is_none_for_rows_without_extent(rng, rows):
    assert Ladder.of(Registration(), Rows(rows), rng) is None


@pytest.mark.parametrize("noise", [1e-3, 0.01, 0.03])
def test_the_threshold_that_tells_most_is_some_standard_deviations(rng, noise):
    problem, model, rows = pairs(rng, noise=noise)
    level = Telling(problem, rows).of(model, 2.0 * LADDER)
    assert 1.5 * noise < level.threshold < 8.0 * noise
    assert 80 < level.facts + 3 <= 210
    assert level.score > 200.0


@pytest.mark.parametrize("noise", [1e-3, 0.01, 0.03])
def test_rows_are_likeliest_at_five_standard_deviations_of_the_right_model(rng, noise):
    problem, model, rows = pairs(rng, noise=noise)
    telling, turned = Telling(problem, rows), model.copy()
    turned[:, 3] += noise
    likelihood, threshold = telling.likelihood(model, 2.0 * LADDER[::-1])
    assert threshold == pytest.approx(5.0 * noise, rel=0.5)
    assert 200.0 < telling.likelihood(turned, 2.0 * LADDER[::-1])[0] + 20.0 < likelihood


def test_a_model_of_nothing_tells_nothing(rng):
    problem, model, rows = pairs(rng, outliers=1.0)
    level = Telling(problem, rows).of(model, 2.0 * LADDER)
    assert level.score < 12.0
    assert level.chance > 1e-5


def test_repeated_places_tell_no_more(rng):
    data = simulate.blobs_in_space(1000, 8, 0.01, rng)
    rows = Rows(np.hstack([data.source, data.target]))
    problem = Registration()
    model = problem.solve_minimal(rows.values[None, [0, 1, 2]])
    best = max((Telling(problem, rows).of(each, 4.0 * LADDER) for each in model), key=lambda level: level.score)
    assert best.facts < 20


def test_without_a_pairing_rows_that_differ_are_facts(rng):
    problem, model = naive.Line(), naive.line_model(30.0, 0.2)
    rows = rng.uniform(-1, 1, (200, 2))
    off = rows[:100] @ model[:2] - model[2]
    rows[:100] += (0.01 * rng.standard_normal(100) - off)[:, None] * model[:2]
    level = Telling(problem, Rows(rows)).of(model, LADDER)
    assert level.facts + problem.minimal_size > 90


def test_it_does_not_depend_on_the_unit(rng):
    data = simulate.relative_pose(800, 0.6, 0.001, rng)
    rows = Rows(np.hstack([data.points1, data.points2]))
    once, scaled = (Telling(RelativePose(f, f), rows).of(data.T[:3], f * LADDER) for f in (1.0, 1000.0))
    assert scaled.threshold == pytest.approx(1000.0 * once.threshold)
    assert scaled[1:] == pytest.approx(once[1:])


@pytest.mark.parametrize(("facts", "rows", "rate"), [(1, 50, 0.01), (20, 100, 0.05), (50, 60, 0.5)])
def test_the_chance_is_a_binomial_tail_below_its_bound(facts, rows, rate):
    level = Level(1.0, 0.0, facts, rows, rate)
    assert level.chance == pytest.approx(binom.sf(facts - 1, rows, rate))
    assert np.log(level.chance) <= log_chance(facts, rows, rate)


def test_no_facts_are_certain_by_chance():
    assert Level(1.0, 0.0, 0, 10, 0.5).chance == 1.0
    assert log_chance(1, 10, 0.2) == 0.0
