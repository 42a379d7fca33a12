import inspect

import numpy as np
import pytest

import naive
from nonsac import refine
from nonsac.problems import Registration
from nonsac.refine import AsSelected, Refiner, UnionRefit, by_name, reweighted_fit, truncated_costs
from nonsac.result import Hypothesis, Status
from nonsac.verdict import judge_rows

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


def refined(refiner, scene, winner):
    _, rows, hypotheses = scene
    return refiner.refine(Registration(), hypotheses, winner, lambda: rows, THRESHOLD)


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


def test_all_tested_models_count_in_the_verdict(scene):
    model, rows, _ = scene
    residuals = naive.residuals(model, rows)

    def confidence(tested):
        return AsSelected().refine(
            Registration(), [Hypothesis(model, residuals, THRESHOLD, tested=tested)] * 4, 0, lambda: rows[190:], 0.1
        )

    assert confidence(25).confidence == judge_rows(Registration(), model, rows[190:], 0.1, 100).confidence


def test_truncated_costs_equal_their_definition(scene):
    _, rows, hypotheses = scene
    models = np.stack([h.model for h in hypotheses])
    expected = [
        sum(min(r, THRESHOLD) ** 2 for r in naive.residuals(m, rows)) if np.isfinite(m).all() else np.inf
        for m in models
    ]
    np.testing.assert_allclose(truncated_costs(Registration(), models, rows, THRESHOLD), expected)


def test_reweighted_fit_is_a_fixed_point_of_tukeys_weights(scene):
    _, rows, hypotheses = scene
    fitted = reweighted_fit(Registration(), hypotheses[0].model, rows, THRESHOLD, 100)
    ratio = naive.residuals(fitted, rows) / THRESHOLD
    weights = np.where(ratio < 1, (1 - ratio**2) ** 2, 0)
    np.testing.assert_allclose(fitted, naive.kabsch(rows, weights), atol=1e-7)


def test_reweighted_fit_without_enough_inliers_leaves_the_model(scene):
    _, rows, hypotheses = scene
    far = hypotheses[1].model + 50.0
    np.testing.assert_array_equal(reweighted_fit(Registration(), far, rows, THRESHOLD, 20), far)


@pytest.mark.parametrize("wrong", ["icp", "Union", ""])
def test_unknown_names_are_refused_and_the_known_ones_listed(wrong):
    with pytest.raises(ValueError, match='refine must be "union", "none" or a Refiner'):
        by_name(wrong)


def test_names_find_refiners():
    assert by_name("union") == UnionRefit()
    assert by_name("none") == AsSelected()


CLASSES = [
    c
    for _, c in inspect.getmembers(refine, inspect.isclass)
    if c.__module__ == "nonsac.refine" and hasattr(c, "refine") and c is not Refiner
]


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_conformance(kind, scene):
    refiner = kind()
    assert isinstance(refiner, Refiner)
    refinement = refined(refiner, scene, 0)
    assert refinement.model.shape == (3, 4)
    assert 0 <= refinement.confidence <= 1
    assert 0 <= refinement.num_inliers <= refinement.num_rows == 400
