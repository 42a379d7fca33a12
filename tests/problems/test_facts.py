import numpy as np
import pytest

import naive
from nonsac import simulate
from nonsac.problems import AbsolutePose, Noise, Registration, RelativePose
from nonsac.problems.facts import Facts, Places

SIGMA = 1e-4
PROBLEMS = {
    "registration": (Registration(), simulate.registration, ("source", "target")),
    "relative pose": (RelativePose(), simulate.relative_pose, ("points1", "points2")),
    "absolute pose": (AbsolutePose(), simulate.absolute_pose, ("points2d", "points3d")),
}
CASES = pytest.mark.parametrize("case", PROBLEMS)


def right_rows(case, n, rng):
    problem, make, names = PROBLEMS[case]
    data = make(n, 0.0, 0.0, rng)
    return problem, data.T[:3], np.hstack([getattr(data, name) for name in names])


def facts_of(problem, model, inliers, rows=None, sigma=SIGMA):
    rows = len(inliers) if rows is None else rows
    return Facts.of(model, inliers, rows, Noise.given(sigma), Places.finest(problem))


def count(facts):
    return np.count_nonzero(facts.chosen)


def blobs(rng, rows, times, spread):
    """Each row so many times, a little displaced, in any order."""
    repeated = np.repeat(rows, times, axis=0)
    return rng.permutation(repeated + spread * rng.standard_normal(repeated.shape))


@CASES
def test_rows_that_are_well_separated_all_count(rng, case):
    problem, model, rows = right_rows(case, 30, rng)
    facts = facts_of(problem, model, rows, 80)
    assert facts.chosen.all()
    assert (facts.rows, facts.share, facts.repetition) == (80, 1.0, 1.0)


@CASES
def test_blobs_count_about_once_each(rng, case):
    problem, model, rows = right_rows(case, 10, rng)
    facts = facts_of(problem, model, blobs(rng, rows, 100, SIGMA), 1500)
    assert 10 <= count(facts) <= 14
    assert facts.rows == 500 + count(facts)
    assert facts.repetition == pytest.approx(1000 / count(facts))


@CASES
def test_blobs_that_the_noise_lets_one_resolve_count_more_often(rng, case):
    problem, model, rows = right_rows(case, 10, rng)
    inliers = blobs(rng, rows, 100, SIGMA)
    counts = [count(facts_of(problem, model, inliers, sigma=sigma)) for sigma in (SIGMA, SIGMA / 4, SIGMA / 100)]
    assert counts[0] < 20 < counts[1] < 900 < counts[2]


@pytest.mark.parametrize("make", [simulate.blobs_in_images, simulate.blobs_in_space])
def test_simulated_blobs_are_few_facts(rng, make):
    first, second = (RelativePose(), ("points1", "points2")), (Registration(), ("source", "target"))
    problem, names = first if make is simulate.blobs_in_images else second
    data = make(1000, 8, SIGMA, rng)
    rows = np.hstack([getattr(data, name) for name in names])
    assert 8 <= count(facts_of(problem, np.eye(3, 4), rows)) <= 12


def test_of_many_inliers_some_are_looked_at(rng):
    rows = np.hstack([rng.uniform(-1, 1, (10_000, 3)), rng.uniform(-1, 1, (10_000, 3))])
    facts = facts_of(Registration(), np.eye(3, 4), rows, 20_000)
    assert (facts.share, facts.rows, count(facts)) == (0.2, 4000, 2000)
    chosen = np.flatnonzero(facts.chosen)
    assert (chosen[0], chosen[-1]) == (0, 9999)
    assert set(np.diff(chosen)) == {5, 6}
    assert facts.repetition == 1.0


def test_many_inliers_of_few_places_are_few_facts(rng):
    """2,000 of 10,000 inliers are looked at, and so the 10,000 other rows count as 2,000."""
    rows = blobs(rng, rng.uniform(-1, 1, (10, 6)), 1000, SIGMA)
    facts = facts_of(Registration(), np.eye(3, 4), rows, 20_000)
    assert 10 <= count(facts) <= 16
    assert facts.rows == 2000 + count(facts)
    assert facts.repetition == pytest.approx(2000 / count(facts))


@pytest.mark.parametrize("problem", [naive.Shift(), naive.Line()])
def test_problems_that_do_not_know_what_is_near_count_rows_that_differ(problem):
    rows = np.array([[0.0, 1.0], [0.0, 1.0], [0.0, 1.0 + 1e-12], [5.0, 1.0], [0.0, 1.0]])
    model = naive.shift_model(1.0) if isinstance(problem, naive.Shift) else naive.line_model(90.0, 1.0)
    assert count(facts_of(problem, model, rows, sigma=1.0)) == 3


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e3])
def test_the_unit_of_pairs_does_not_matter(rng, unit):
    problem, model, rows = right_rows("registration", 10, rng)
    rows = blobs(rng, rows, 20, 2 * SIGMA)
    chosen = facts_of(problem, model, rows).chosen
    both = np.column_stack([model[:, :3], unit * model[:, 3]])
    np.testing.assert_array_equal(facts_of(problem, both, unit * rows, sigma=unit * SIGMA).chosen, chosen)
    of_source = np.column_stack([model[:, :3] / unit, model[:, 3]])
    units = np.repeat([unit, 1.0], 3)
    np.testing.assert_array_equal(facts_of(Registration(None), of_source, units * rows).chosen, chosen)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_units_of_pixels_and_of_the_world_do_not_matter(rng, unit):
    problem, model, rows = right_rows("relative pose", 10, rng)
    rows = blobs(rng, rows, 20, 2 * SIGMA)
    chosen = facts_of(problem, model, rows).chosen
    np.testing.assert_array_equal(facts_of(RelativePose(unit, unit), model, rows, sigma=unit * SIGMA).chosen, chosen)
    problem, model, rows = right_rows("absolute pose", 10, rng)
    rows = blobs(rng, rows, 20, 2 * SIGMA)
    chosen = facts_of(problem, model, rows).chosen
    larger = np.column_stack([model[:, :3], unit * model[:, 3]])
    world = np.repeat([1.0, unit], [2, 3])
    np.testing.assert_array_equal(facts_of(AbsolutePose(unit), larger, world * rows, sigma=unit * SIGMA).chosen, chosen)


def test_no_inliers_are_no_facts():
    facts = facts_of(Registration(), np.eye(3, 4), np.empty((0, 6)), 50)
    assert (count(facts), facts.repetition) == (0, 1.0)


@CASES
def test_neighbours_are_one_place_however_small_the_noise_is(rng, case):
    """A hundredth of the scene is one place, a tenth is not."""
    problem, model, rows = right_rows(case, 400, rng)
    places = Places.of(problem, rows)
    spans = np.subtract(*np.percentile(rows, [90, 10], axis=0))
    few = rows[:10]
    near, far = (few + share * spans * rng.choice([-1, 1], few.shape) for share in (0.003, 0.1))
    for beside, expected in ((near, 10), (far, 20)):
        facts = Facts.of(model, np.concatenate([few, beside]), 400, Noise.given(1e-9), places)
        assert abs(facts.count - expected) <= 1


def test_facts_among_some_inliers(rng):
    facts = facts_of(Registration(), np.eye(3, 4), blobs(rng, rng.uniform(-1, 1, (10, 6)), 5, SIGMA))
    chosen = facts.among(np.arange(50) < 20)
    np.testing.assert_array_equal(chosen.chosen, facts.chosen & (np.arange(50) < 20))
    assert (chosen.rows, chosen.share, chosen.count) == (facts.rows, facts.share, np.count_nonzero(chosen.chosen))
