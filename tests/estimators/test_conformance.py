"""What every core estimator must do; a new one has to be added to EXAMPLES, the test says so."""

import numpy as np
import pytest

import naive
import nonsac.estimators
from nonsac.clouds.overlap import Overlap
from nonsac.clouds.problem import OrientedRegistration
from nonsac.clouds.search import OrientedPairs
from nonsac.clouds.surfaces import Surface
from nonsac.estimators import Estimator, External, Pcr99, Ransac
from nonsac.estimators.named import ESTIMATORS
from nonsac.estimators.pair_core import PairCore
from nonsac.layouts import Rows
from nonsac.problems import AbsolutePose, Noise, Registration, RelativePose
from nonsac.result import Hypothesis
from nonsac.sources import AllPairsSource
from nonsac.testing import check_estimator

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


def somebody_elses(values, threshold, seed):
    """A function that knows nothing of this package but its arrays."""
    found = Ransac(2000).estimate(Registration(), Rows(values), Noise.within(threshold), np.random.default_rng(seed))
    return found.model


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

# Those for matched 3D points, by the names under which users ask for them.
PAIR_EXAMPLES = {
    name: lambda rng, core=core: (core, Registration(), matched_rows(rng), THRESHOLD)
    for name, core in (
        (name, named.made_for(Registration())) for name, named in ESTIMATORS.items() if named.needs is None
    )
    if isinstance(core, PairCore)
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
    "External": lambda rng: (External(somebody_elses), Registration(), matched_rows(rng, outliers=0.6), THRESHOLD),
    **RANSAC_EXAMPLES,
    **PAIR_EXAMPLES,
}
GENERIC = set(RANSAC_EXAMPLES)  # names of estimators that take any problem
UNKNOWN = {"External"}  # names of estimators that do not say what they can solve, nor how many models they compared


@pytest.fixture(params=EXAMPLES)
def example(request, rng):
    return EXAMPLES[request.param](rng)


def truth_of(problem):
    return POSE if isinstance(problem, (AbsolutePose, RelativePose)) else TRUTH


def estimate(estimator, problem, rows, threshold, seed=0):
    return estimator.estimate(problem, Rows(rows), Noise.within(threshold), np.random.default_rng(seed))


def test_every_estimator_has_an_example():
    exported = {name for name in nonsac.estimators.__all__ if name != "Estimator"}
    assert exported <= {name.split()[0] for name in EXAMPLES}


@pytest.mark.parametrize("name", EXAMPLES)
def test_only_a_function_does_not_say_how_many_models_it_compared(rng, name):
    tested = estimate(*EXAMPLES[name](rng)).tested
    assert tested is None if name in UNKNOWN else tested > 1


def test_does_what_the_contract_says(example):
    estimator, problem, rows, threshold = example
    check_estimator(estimator, problem, rows, threshold / 5)


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
    assert hypothesis.fault == ""


def test_the_same_random_numbers_give_the_same_bits(example):
    first, second = estimate(*example), estimate(*example)
    np.testing.assert_array_equal(first.model, second.model)
    np.testing.assert_array_equal(first.residuals, second.residuals)


def test_identical_rows_give_no_model_and_no_error(example):
    estimator, problem, rows, threshold = example
    hypothesis = estimate(estimator, problem, np.repeat(rows[:1], 50, axis=0), threshold)
    assert not hypothesis.found
    assert np.isnan(hypothesis.model).all()
    assert hypothesis.num_inliers == 0


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name not in UNKNOWN])
def test_a_larger_budget_is_another_estimator(rng, name):
    example = EXAMPLES[name](rng)
    estimator = example[0]
    assert estimator.with_budget(1) == estimator
    larger = estimator.with_budget(7)
    assert type(larger) is type(estimator)
    assert larger != estimator
    assert larger.with_budget(2) == estimator.with_budget(14)
    assert estimate(larger, *example[1:]).tested >= estimate(*example).tested


def test_a_problem_it_can_solve_is_not_refused(example):
    estimator, problem, *_ = example
    assert estimator.check(problem) is None


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name not in GENERIC | UNKNOWN])
def test_a_problem_it_cannot_solve_is_refused_by_name(rng, name):
    """Before anything is read, and by the search itself."""
    estimator, _, rows, threshold = EXAMPLES[name](rng)
    for refusing in (estimator.check, lambda problem: estimate(estimator, problem, rows, threshold)):
        with pytest.raises(TypeError, match=rf"{type(estimator).__name__} .* got Shift"):
            refusing(naive.Shift())


@pytest.mark.parametrize("name", sorted(GENERIC))
def test_a_generic_one_solves_a_problem_whose_models_are_no_motions(rng, name):
    estimator, *_ = EXAMPLES[name](rng)
    line, rows = naive.line_model(60.0, 0.2), rng.uniform(-1, 1, (300, 2))
    rows[:100] += (0.2 + THRESHOLD / 5 * rng.standard_normal((100, 1)) - rows[:100] @ line[:2, None]) * line[:2]
    hypothesis = estimate(estimator, naive.Line(), rows, THRESHOLD)
    assert hypothesis.model.shape == (3,)
    assert naive.Line().distance(hypothesis.model, line) < 3.0
    assert not estimate(estimator, naive.Line(), np.ones((50, 2)), THRESHOLD).found


# --- an estimator that says no more than it has to --------------------------------------------------------------------


class Fixed(Estimator):
    def estimate(self, problem, rows, noise, rng):
        model = naive.shift_model(0.3)
        return Hypothesis(model, problem.residuals(model[None], rows.values)[0], noise.threshold)


def test_an_estimator_without_a_search_is_refused_by_name():
    class Incomplete(Estimator):
        pass

    with pytest.raises(TypeError, match=r"Incomplete.*estimate"):
        Incomplete()


def test_everything_but_the_search_has_a_default(rng):
    estimator, problem, rows = Fixed(), naive.Shift(), Rows(rng.standard_normal((20, 2)))
    assert estimator.check(problem) is None
    assert estimator.with_budget(7) is estimator
    found = estimator.estimate(problem, rows, Noise.given(0.1), rng)
    assert found.promising is None
    assert len(found.rank_scores) == 0
    assert estimator.search_jointly(problem, [found], rows, Noise.given(0.1), rng) is None
    assert estimator.search_jointly_at_any_noise(problem, [found], rng) is None


@pytest.mark.parametrize("name", sorted(GENERIC))
def test_a_generic_one_solves_any_problem(rng, name):
    estimator, *_ = EXAMPLES[name](rng)
    rows = rng.uniform(-1, 1, (300, 2))
    rows[:100, 1] = rows[:100, 0] + rng.normal(0.3, THRESHOLD / 5, 100)
    hypothesis = estimate(estimator, naive.Shift(), rows, THRESHOLD)
    assert hypothesis.model[0, 3] == pytest.approx(0.3, abs=0.03)
    assert hypothesis.num_inliers > 90
