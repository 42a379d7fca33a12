"""What every core estimator must do; a new one has to be added to EXAMPLES, the test says so."""

import pickle

import numpy as np
import pytest

import naive
import nonsac.estimators
from nonsac.clouds.overlap import Overlap
from nonsac.clouds.problem import OrientedRegistration
from nonsac.clouds.search import OrientedPairs
from nonsac.clouds.surfaces import Surface
from nonsac.estimators import Pcr99, Ransac
from nonsac.estimators.contract import Estimator
from nonsac.problems import AbsolutePose, Registration, RelativePose
from nonsac.result import Hypothesis
from nonsac.sources import AllPairsSource

THRESHOLD = 0.05
TRUTH = naive.random_model(np.random.default_rng(8), spread=0.5)
POSE = naive.random_pose(np.random.default_rng(8))


def matched_rows(rng, n=600, outliers=0.9):
    rows = naive.matching_rows(rng, n, TRUTH, noise=THRESHOLD / 5)
    wrong = rng.permutation(n)[: int(outliers * n)]
    rows[wrong, 3:] = rng.standard_normal((len(wrong), 3)) + TRUTH[:, 3]
    return rows


def image_rows(make_rows, focal=1.0):
    """A maker of rows with half of them wrong, and noise of a fifth of the threshold in pixels."""

    def make(rng, n=400):
        rows = make_rows(rng, n, POSE, THRESHOLD / 5 / focal)
        wrong = rng.permutation(n)[: n // 2]
        rows[wrong, :2] = rng.uniform(-1, 1, (len(wrong), 2))
        return rows

    return make


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


def ransac_example(problem, make_rows, **settings):
    return lambda rng: (Ransac(2000, **settings), problem, make_rows(rng), THRESHOLD)


# Every problem with every combination of options.
RANSAC_EXAMPLES = {
    f"Ransac {problem_name}{options_name}": ransac_example(problem, make_rows, **settings)
    for problem_name, problem, make_rows in (
        ("relative pose", RelativePose(10.0, 15.0), image_rows(naive.two_view_rows, 10.0)),
        ("absolute pose", AbsolutePose(10.0), image_rows(naive.one_view_rows, 10.0)),
        ("registration", Registration(), lambda rng: matched_rows(rng, outliers=0.6)),
    )
    for options_name, settings in (
        ("", {}),
        (", confident", {"confidence": 0.999}),
        (", optimised", {"local_optimisation": True}),
        (", both", {"confidence": 0.999, "local_optimisation": True}),
    )
}

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
    **RANSAC_EXAMPLES,
}
GENERIC = set(RANSAC_EXAMPLES)  # names of estimators that take any problem


@pytest.fixture(params=EXAMPLES)
def example(request, rng):
    return EXAMPLES[request.param](rng)


def truth_of(problem):
    return POSE if isinstance(problem, (AbsolutePose, RelativePose)) else TRUTH


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
    assert naive.angle_between(hypothesis.model, truth_of(example[1])) < 5.0
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


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name not in GENERIC])
def test_a_problem_it_cannot_solve_is_refused_by_name(rng, name):
    estimator, _, rows, threshold = EXAMPLES[name](rng)
    with pytest.raises(TypeError, match=rf"{type(estimator).__name__} .* got Shift"):
        estimate(estimator, naive.Shift(), rows, threshold)


@pytest.mark.parametrize("name", sorted(GENERIC))
def test_a_generic_one_solves_any_problem(rng, name):
    estimator, *_ = EXAMPLES[name](rng)
    rows = rng.uniform(-1, 1, (300, 2))
    rows[:100, 1] = rows[:100, 0] + rng.normal(0.3, THRESHOLD / 5, 100)
    hypothesis = estimate(estimator, naive.Shift(), rows, THRESHOLD)
    assert hypothesis.model[0, 3] == pytest.approx(0.3, abs=0.03)
    assert hypothesis.num_inliers > 90
