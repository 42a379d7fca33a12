"""What every core estimator must do; a new one has to be added to EXAMPLES, the test says so."""

import pickle

import numpy as np
import pytest

import naive
import nonsac.estimators
from nonsac.estimators import Estimator, OrientedPairs, Pcr99
from nonsac.overlap import Overlap
from nonsac.problems import OrientedRegistration, Registration
from nonsac.result import Hypothesis
from nonsac.sources import AllPairsSource
from nonsac.surfaces import Surface

THRESHOLD = 0.05
TRUTH = naive.random_model(np.random.default_rng(8), spread=0.5)


def matched_rows(rng, n=600, outliers=0.9):
    rows = naive.matching_rows(rng, n, TRUTH, noise=THRESHOLD / 5)
    wrong = rng.permutation(n)[: int(outliers * n)]
    rows[wrong, 3:] = rng.standard_normal((len(wrong), 3)) + TRUTH[:, 3]
    return rows


def two_clouds():
    """A bumpy closed surface, seen twice."""
    rng = np.random.default_rng(2)
    directions = rng.standard_normal((2, 1500, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    x, y, z = np.moveaxis(directions, 2, 0)
    radius = 1 + 0.3 * np.sin(3 * x + 1) + 0.25 * np.cos(4 * y) * z + 0.2 * x * y
    source, target = radius[..., None] * directions * [1.0, 0.8, 0.6]
    surfaces = [Surface.from_points(p) for p in (source, naive.moved(TRUTH, target))]
    spacing = max(s.spacing for s in surfaces)
    return Overlap.between(*(s.with_spacing(spacing) for s in surfaces), 1.5 * spacing, 0.6 * spacing), spacing


def oriented_example(rng):
    overlap, spacing = two_clouds()
    source = AllPairsSource(overlap.source.oriented, overlap.target.oriented)
    rows = source.take(rng.permutation(len(source))[:2000])
    estimator = OrientedPairs(overlap, tolerance=0.6 * spacing, smallest_distance=3 * spacing)
    return estimator, OrientedRegistration(), rows, overlap.reach


# Name -> an estimator, its problem, a maker of rows with many outliers, and the threshold.
EXAMPLES = {
    "Pcr99 published": lambda rng: (Pcr99(max_drawn=20_000), Registration(), matched_rows(rng), THRESHOLD),
    "Pcr99 for pairs": lambda rng: (Pcr99.for_pairs(), Registration(), matched_rows(rng), THRESHOLD),
    "Pcr99 for all pairs": lambda rng: (Pcr99.for_all_pairs(), Registration(), matched_rows(rng), THRESHOLD),
    "Pcr99 free scale": lambda rng: (Pcr99(max_drawn=20_000), Registration(None), matched_rows(rng), THRESHOLD),
    "Pcr99 random": lambda rng: (
        Pcr99("distance", order="random", tolerance=0.6, max_drawn=200_000, max_valid=2000),
        Registration(),
        matched_rows(rng),
        THRESHOLD,
    ),
    "OrientedPairs": oriented_example,
}


@pytest.fixture(params=EXAMPLES)
def example(request, rng):
    return EXAMPLES[request.param](rng)


def estimate(estimator, problem, rows, threshold, seed=0):
    return estimator.estimate(problem, rows, threshold, np.random.default_rng(seed))


def test_every_estimator_has_an_example():
    exported = {name for name in nonsac.estimators.__all__ if name != "Estimator"}
    assert exported <= {name.split()[0] for name in EXAMPLES}


def test_finds_the_motion_among_outliers(example):
    estimator, *_, threshold = example
    assert isinstance(estimator, Estimator)
    hypothesis = estimate(*example)
    assert isinstance(hypothesis, Hypothesis)
    assert hypothesis.found
    assert hypothesis.model.shape == (3, 4)
    assert hypothesis.threshold == threshold
    assert naive.angle_between(hypothesis.model, TRUTH) < 5.0
    assert hypothesis.num_inliers > 10
    assert hypothesis.tested > 1


def test_the_same_random_numbers_give_the_same_bits(example):
    first, second = estimate(*example), estimate(*example)
    np.testing.assert_array_equal(first.model, second.model)
    np.testing.assert_array_equal(first.residuals, second.residuals)


def test_leaves_the_rows_alone(example):
    rows = example[2].copy()
    estimate(*example)
    np.testing.assert_array_equal(example[2], rows)


def test_travels_to_another_process(example):
    estimator, *rest = example
    np.testing.assert_array_equal(
        estimate(pickle.loads(pickle.dumps(estimator)), *rest).model, estimate(*example).model
    )


def test_identical_rows_give_no_model_and_no_error(example):
    estimator, problem, rows, threshold = example
    hypothesis = estimate(estimator, problem, np.repeat(rows[:1], 50, axis=0), threshold)
    assert not hypothesis.found
    assert np.isnan(hypothesis.model).all()
    assert hypothesis.num_inliers == 0


def test_a_minimal_number_of_rows_is_no_error(example):
    estimator, problem, rows, threshold = example
    hypothesis = estimate(estimator, problem, rows[: problem.minimal_size].copy(), threshold)
    assert hypothesis.model.shape == (3, 4)


def test_a_larger_budget_is_another_estimator(example):
    estimator = example[0]
    assert estimator.with_budget(1) == estimator
    larger = estimator.with_budget(7)
    assert type(larger) is type(estimator)
    assert larger != estimator
    assert larger.with_budget(2) == estimator.with_budget(14)
    assert estimate(larger, *example[1:]).tested >= estimate(*example).tested


def test_a_problem_it_cannot_solve_is_refused_by_name(example):
    estimator, _, rows, threshold = example
    with pytest.raises(TypeError, match=rf"{type(estimator).__name__} .* got Shift"):
        estimate(estimator, naive.Shift(), rows, threshold)
