import numpy as np
import pytest

import naive
from nonsac import Estimator, Noise, SpecialCase, register_pairs
from nonsac.layouts import Rows
from nonsac.method import judgement
from nonsac.method.full_pass import FullFit
from nonsac.method.refine import AsSelected, Refinement, Refiner
from nonsac.method.refiners import REFINERS, by_name
from nonsac.method.search import SampleTask, Search
from nonsac.method.union_refit import UnionRefit
from nonsac.method.verdict import Effort, judge_rows
from nonsac.problems import Registration
from nonsac.problems.contract import ContractBroken
from nonsac.problems.fits import biweight_costs, cheapest, reweighted_fit
from nonsac.result import Hypothesis, Status
from nonsac.sources import ArraySource
from nonsac.testing import check_refiner

THRESHOLD = 0.1


@pytest.fixture
def scene(rng):
    """A motion, 400 rows of which half are right, and four hypotheses: off by little, far off, none, further off."""
    model = naive.random_model(rng)
    rows = naive.matching_rows(rng, 400, model, noise=0.02)
    rows[200:, 3:] = rng.uniform(-3, 3, (200, 3))
    shifts = [0.05, 2.0, np.nan, 0.08]
    hypotheses = []
    for i, shift in enumerate(shifts):
        found = np.isfinite(shift)
        off = model + shift * np.array([[0, 0, 0, 1.0]] * 3)
        residuals = naive.residuals(off, rows) if found else np.full(400, np.inf)
        hypotheses.append(Hypothesis(off, residuals, THRESHOLD, sample=i, tested=10))
    return model, rows, hypotheses


class Joint(Estimator):
    """Has searched, and gives this hypothesis, or none, for a joint search."""

    def __init__(self, found=None):
        self.found = found

    def estimate(self, problem, rows, noise, rng):
        raise AssertionError

    def search_jointly(self, problem, hypotheses, rows, noise, rng):
        self.given = list(hypotheses), len(rows), noise.threshold, rng.random()
        return self.found


class Ended(Search):
    """A search that has come to these hypotheses, and whose samples hold these rows; `more` if more are asked for."""

    def __init__(self, problem, hypotheses, rows, threshold=THRESHOLD, more=None, estimator=None):
        task = SampleTask(
            ArraySource(rows), problem, estimator or Joint(), Noise.within(threshold), len(rows), seed=0, number=5
        )
        super().__init__(task, len(hypotheses), 1, None, None, None, hypotheses=list(hypotheses))
        self.rows, self.more, self.asked = rows, more, []

    def union(self, at_least=0):
        self.asked.append(at_least)
        return Rows(self.more if at_least and self.more is not None else self.rows)


def refined(refiner, scene, winner):
    _, rows, hypotheses = scene
    return refiner.refine(Ended(Registration(), hypotheses, rows), winner)


def test_union_refit_is_the_robust_fit_to_all_rows(scene):
    model, rows, _ = scene
    refinement = refined(UnionRefit(), scene, 0)
    best = naive.kabsch(rows[:200], np.ones(200))
    assert refinement.status is Status.OK
    assert np.abs(refinement.model - best).max() < 0.005
    assert np.abs(refinement.model - model).max() < 0.01
    assert (refinement.num_inliers, refinement.num_rows) == (
        (naive.residuals(refinement.model, rows) < THRESHOLD).sum(),
        400,
    )


def test_union_refit_does_not_depend_on_a_wrong_winner(scene):
    np.testing.assert_array_equal(refined(UnionRefit(), scene, 1).model, refined(UnionRefit(), scene, 0).model)


@pytest.mark.parametrize("candidates", [1, 2, 10])
@pytest.mark.parametrize("iterations", [0, 1, 20])
def test_union_refit_is_never_worse_than_any_hypothesis(scene, candidates, iterations):
    _, rows, hypotheses = scene
    model = refined(UnionRefit(candidates, iterations), scene, 0).model
    costs = [(np.minimum(naive.residuals(m, rows), THRESHOLD) ** 2).sum()
             for m in (model, *(h.model for h in hypotheses if h.found))]  # fmt: skip
    assert costs[0] <= min(costs[1:]) + 1e-12


def test_as_selected_returns_the_winner_judged(scene):
    _, rows, hypotheses = scene
    refinement = refined(AsSelected(), scene, 1)
    np.testing.assert_array_equal(refinement.model, hypotheses[1].model)
    assert refinement.status is Status.LOW_SUPPORT
    assert refinement.num_inliers == (naive.residuals(hypotheses[1].model, rows) < THRESHOLD).sum()


@pytest.mark.parametrize("refiner", [AsSelected(), UnionRefit()], ids=["none", "union"])
def test_all_models_that_were_compared_count_in_the_verdict(refiner, scene, monkeypatch):
    told = []

    def spy(candidate, effort):
        told.append(effort)
        return judge_rows(candidate, effort)

    monkeypatch.setattr(judgement, "judge_rows", spy)
    refined(refiner, scene, 0)
    assert set(told) == {Effort(compared=40, searched=40)}


class WithRefit(naive.Shift):
    """Shifts, with a refit of the test's own."""

    def __init__(self, fitted):
        self.fitted = fitted

    def refit(self, model, rows, weights):
        return naive.shift_model(self.fitted(model[0, 3]))


def shifts(*places):
    """Rows whose true shift is 0, of unequal support near other places, and hypotheses at the given places."""
    rows = np.column_stack([np.zeros(60), np.r_[np.linspace(-0.02, 0.02, 40), np.full(20, 5.0)]])
    models = [naive.shift_model(place) for place in places]
    residuals = [naive.Shift().residuals(model[None], rows)[0] for model in models]
    return rows, [Hypothesis(m, r, THRESHOLD) for m, r in zip(models, residuals, strict=True)]


def test_a_fit_that_makes_things_worse_is_not_taken():
    rows, hypotheses = shifts(0.01, 0.05)
    problem = WithRefit(lambda start: 1000.0)
    assert UnionRefit().refine(Ended(problem, hypotheses, rows), 0).model[0, 3] == 0.01


def test_several_hypotheses_are_fitted_and_the_best_fit_is_taken():
    rows, hypotheses = shifts(0.02, 0.05, 5.0)
    problem = WithRefit(lambda start: 0.0 if start == 0.05 else start)
    search = Ended(problem, hypotheses, rows)
    assert UnionRefit().refine(search, 2).model[0, 3] == 0.0
    assert UnionRefit(candidates=1).refine(search, 2).model[0, 3] == 0.02


def test_what_a_joint_search_finds_is_one_more_hypothesis(scene):
    model, rows, hypotheses = scene
    far = [hypotheses[1], hypotheses[2]]
    found = Joint(Hypothesis(model, naive.residuals(model, rows), THRESHOLD, tested=1000))
    search = Ended(Registration(), far, rows, estimator=found)
    refinement = UnionRefit().refine(search, 0)
    assert refinement.status is Status.OK
    assert np.abs(refinement.model - model).max() < 0.01
    assert found.given == (far, 400, THRESHOLD, np.random.default_rng([0, 5, 1]).random())
    assert search.hypotheses == far
    assert UnionRefit().refine(Ended(Registration(), far, rows), 0).status is Status.LOW_SUPPORT


class Raising(Joint):
    def search_jointly(self, problem, hypotheses, rows, noise, rng):
        raise ZeroDivisionError


def test_a_joint_search_that_fails_leaves_what_the_samples_found(scene):
    _, rows, hypotheses = scene
    failed = UnionRefit().refine(Ended(Registration(), hypotheses, rows, estimator=Raising()), 0)
    expected = UnionRefit().refine(Ended(Registration(), hypotheses, rows), 0)
    assert failed.status is Status.OK
    np.testing.assert_array_equal(failed.model, expected.model)


@pytest.mark.parametrize(
    ("found", "message"),
    [
        (naive.shift_model(1.0), r"Joint.search_jointly must give a nonsac.Hypothesis, got ndarray"),
        (
            Hypothesis(np.zeros(3), np.zeros(400), 1.0),
            r"Joint.search_jointly gave a model of the shape \(3,\); Registration has",
        ),
    ],
)
def test_a_joint_search_that_gives_something_else_is_refused(scene, found, message):
    _, rows, hypotheses = scene
    with pytest.raises(ContractBroken, match=message):
        UnionRefit().refine(Ended(Registration(), hypotheses, rows, estimator=Joint(found)), 0)


class Mirrored(naive.Shift):
    """Shifts, of which a special case allows the opposite one, too."""

    def special_cases(self, model, inliers, noise):
        nothing = np.zeros(len(inliers), bool)
        return [
            SpecialCase("none", nothing, True),
            SpecialCase("mirrored", nothing, True, naive.shift_model(-model[0, 3])[None]),
        ]


@pytest.mark.parametrize("start", [2.0, -2.0])
def test_of_two_models_that_a_special_case_allows_the_better_one_is_taken(start):
    rows = np.column_stack([np.zeros(80), np.r_[np.linspace(1.98, 2.02, 50), np.linspace(-2.02, -1.98, 30)]])
    hypotheses = [Hypothesis(naive.shift_model(start), np.zeros(80), THRESHOLD)]
    model = UnionRefit().refine(Ended(Mirrored(), hypotheses, rows), 0).model
    np.testing.assert_allclose(model[0, 3], 2.0, atol=1e-4)


def test_polishing_fits_the_winner_to_more_rows_than_the_union():
    rows, hypotheses = shifts(0.01)
    more = np.vstack([rows, rows + np.array([0.0, 0.01])])
    search = Ended(naive.Shift(), hypotheses, rows, more=more)
    refinement = UnionRefit(polish_rows=120).refine(search, 0)
    assert search.asked[0] == 0
    assert set(search.asked) == {0, 120}
    assert refinement.num_rows == len(more)
    np.testing.assert_allclose(refinement.model[0, 3], 0.005, atol=1e-4)
    np.testing.assert_allclose(UnionRefit().refine(search, 0).model[0, 3], 0, atol=1e-4)


@pytest.mark.parametrize("weighted", [False, True])
def test_of_many_rows_some_rank_the_models(rng, weighted):
    """The order on all rows, of those that some rows rank high; the first ones of equal ones."""

    class Counting(naive.Shift):
        def residuals(self, models, rows):
            looked_at.append(len(models) * len(rows))
            return super().residuals(models, rows)

    x = rng.uniform(-1, 1, 30_000)
    weights = rng.uniform(0.1, 2.0, 30_000) if weighted else None
    rows = Rows(np.column_stack([x, x + 0.01 * rng.standard_normal(30_000)]), weights)
    models = np.stack([naive.shift_model(shift) for shift in rng.permutation(np.repeat(np.arange(30) / 100, 2))])
    problem, looked_at = Counting(), []
    costs = biweight_costs(problem, models, rows, 0.05)
    on_all = sum(looked_at)
    looked_at.clear()
    np.testing.assert_array_equal(cheapest(problem, models, rows, 0.05, 4), np.argsort(costs, kind="stable")[:4])
    assert sum(looked_at) == 60 * 10_000 + 20 * 30_000 < on_all
    for some, few in ((models, rows[:10_000]), (models[:20], rows)):
        looked_at.clear()
        cheapest(problem, some, few, 0.05, 4)
        assert sum(looked_at) == len(some) * len(few)


def test_biweight_costs_equal_their_definition(scene):
    _, rows, hypotheses = scene
    models = np.stack([h.model for h in hypotheses])
    expected = [
        sum(1 - (1 - min(r / THRESHOLD, 1) ** 2) ** 3 for r in naive.residuals(m, rows))
        if np.isfinite(m).all()
        else np.inf
        for m in models
    ]
    np.testing.assert_allclose(biweight_costs(Registration(), models, Rows(rows), THRESHOLD), expected)


def test_reweighted_fit_is_a_fixed_point_of_tukeys_weights(scene):
    _, rows, hypotheses = scene
    fitted = reweighted_fit(Registration(), hypotheses[0].model, Rows(rows), THRESHOLD, 100)
    ratio = naive.residuals(fitted, rows) / THRESHOLD
    weights = np.where(ratio < 1, (1 - ratio**2) ** 2, 0)
    np.testing.assert_allclose(fitted, naive.kabsch(rows, weights), atol=1e-7)


def test_reweighted_fit_without_enough_inliers_leaves_the_model(scene):
    _, rows, hypotheses = scene
    far = hypotheses[1].model + 50.0
    np.testing.assert_array_equal(reweighted_fit(Registration(), far, Rows(rows), THRESHOLD, 20), far)


@pytest.mark.parametrize("wrong", ["icp", "Union", ""])
def test_unknown_names_are_refused_and_the_known_ones_listed(wrong):
    with pytest.raises(ValueError, match='refine must be "union", "polish", "full", "none", "average" or a Refiner'):
        by_name(wrong)


def test_names_find_refiners():
    assert by_name("union") == UnionRefit()
    assert by_name("polish") == UnionRefit(polish_rows=100_000)
    assert by_name("full") == FullFit(polish_rows=30_000)
    assert by_name("none") == AsSelected()


def test_there_is_a_name_for_every_refiner():
    kinds = [*Refiner.__subclasses__(), *UnionRefit.__subclasses__()]
    assert {kind for kind in kinds if kind.__module__.startswith("nonsac.method")} == set(map(type, REFINERS.values()))


@pytest.mark.parametrize("name", REFINERS)
def test_conformance(name, scene):
    _, rows, hypotheses = scene
    search = Ended(Registration(), hypotheses, rows)
    refiner = by_name(name)
    check_refiner(refiner, Registration(), rows, 0.02)
    refinement = refiner.refine(search, 0)
    for outcome in (refinement, refiner.finish(search, refinement)):
        assert isinstance(outcome, Refinement)
        assert outcome.model.shape == (3, 4)
        assert 0 <= outcome.confidence <= 1
        assert 0 <= outcome.num_inliers <= outcome.num_rows == 400


@pytest.mark.parametrize("name", ["none", "union", "polish"])
def test_a_problem_of_any_shape_and_without_extras_is_refined(name, rng):
    rows = rng.uniform(-5, 5, (300, 2))
    line = naive.line_model(30.0, 1.0)
    rows[:150] += ((1.0 - rows[:150] @ line[:2]) + 0.01 * rng.standard_normal(150))[:, None] * line[:2]
    start = naive.line_model(30.3, 1.01)
    hypotheses = [Hypothesis(start, naive.Line().residuals(start[None], rows)[0], THRESHOLD, tested=100)]
    refinement = by_name(name).refine(Ended(naive.Line(), hypotheses, rows), 0)
    assert refinement.status is Status.OK
    assert refinement.covariance is None
    np.testing.assert_allclose(refinement.model, line, atol=0.02 if name == "none" else 0.004)


# --- other answers ----------------------------------------------------------------------------------------------------


def two_motions(rng, second):
    """Pairs of which 400 follow one motion and so many another."""
    models = [naive.random_model(rng, spread=0.0) for _ in range(2)]
    a = rng.uniform(-1, 1, (4000, 3))
    b = rng.uniform(-1, 1, (4000, 3))
    for model, part in zip(models, (slice(0, 400), slice(400, 400 + second)), strict=True):
        b[part] = naive.moved(model, a[part])
    rows = np.hstack([a, b + 0.01 * rng.standard_normal(b.shape)])
    return models, rows[rng.permutation(4000)]


@pytest.mark.parametrize(("second", "status"), [(0, Status.OK), (100, Status.OK), (390, Status.AMBIGUOUS)])
def test_a_second_motion_is_an_alternative_and_one_as_frequent_makes_the_answer_ambiguous(rng, second, status):
    models, rows = two_motions(rng, second)
    problem = Registration()
    hypotheses = [Hypothesis(m, problem.residuals(m[None], rows)[0], 0.05, tested=50) for m in models]
    refinement = UnionRefit().refine(Ended(problem, hypotheses, rows, 0.05), 0)
    assert refinement.status is status
    assert naive.angle_between(refinement.model, models[0]) < 1.0
    assert [naive.angle_between(a.T, models[1]) < 2.0 for a in refinement.alternatives] == [True] * bool(second)
    assert all((a.T[:3] == a.model).all() for a in refinement.alternatives)
    assert [a.support for a in refinement.alternatives] == pytest.approx([second / 4000] * bool(second), rel=0.15)
    assert refinement.confidence == 0.5 if status is Status.AMBIGUOUS else refinement.confidence > 0.99


def test_two_motions_in_one_call_are_ambiguous(rng):
    models, rows = two_motions(rng, 390)
    result = register_pairs(rows[:, :3], rows[:, 3:], noise=0.01, samples=6, sample_size=600)
    assert result.status is Status.AMBIGUOUS
    found = [result.model, result.alternatives[0].model]
    assert {int(np.argmin([naive.angle_between(model, m) for m in models])) for model in found} == {0, 1}


def test_inliers_beyond_a_threshold_that_is_too_small_are_no_second_motion(rng):
    _, rows = two_motions(rng, 0)
    assert register_pairs(rows[:, :3], rows[:, 3:], noise=0.002).alternatives == ()
