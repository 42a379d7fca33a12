"""What every problem must do; a new problem in `nonsac.problems` has to be added to EXAMPLES, the test says so."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import brentq

import naive
import nonsac.problems
from nonsac.clouds.problem import OrientedRegistration
from nonsac.problems import AbsolutePose, Noise, Problem, Registration, RelativePose, SpecialCase
from nonsac.problems.contract import refitted, solved
from nonsac.testing import check_problem


def oriented_rows(rng, n, model):
    a, u = rng.uniform(-1, 1, (n, 3)), rng.standard_normal((n, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    signs = rng.choice([-1.0, 1.0], (n, 1))
    return np.hstack([a, u, naive.moved(model, a), signs * (u @ model[:, :3].T)])


def shift_rows(rng, n, model):
    x = rng.standard_normal(n)
    return np.column_stack([x, x + model[0, 3]])


def line_rows(rng, n, model):
    along = rng.standard_normal((n, 1)) * [-model[1], model[0]]
    return along + model[2] * model[:2]


def add_across_line(model, rows, residuals):
    return rows + np.broadcast_to(residuals, len(rows))[:, None] * model[:2]


def add_to_column(column, focal=1.0):
    """Displace exact rows along one column, where a residual grows by as much."""

    def displaced(model, rows, residuals):
        rows = rows.copy()
        rows[:, column] += residuals / focal
        return rows

    return displaced


add_to_fourth_column = add_to_column(3)


def add_across_epipolar_line(focal1=1.0, focal2=1.0):
    """Move x2 off its epipolar line until Sampson's distance, which is not linear in the step, is the wanted one."""

    def displaced(model, rows, residuals):
        rows = rows.copy()
        for row, residual in zip(rows, np.broadcast_to(residuals, len(rows)), strict=True):
            line = (naive.fundamental(model) @ [row[0], row[1], 1])[:2]

            def error(step, row=row, line=line, residual=residual):
                there = row + step * np.r_[0, 0, line / np.linalg.norm(line)]
                return naive.sampson(model, there[None], focal1, focal2)[0] - residual

            row[2:] += brentq(error, 0, 100 * residual / focal2, xtol=1e-15, rtol=1e-14) * line / np.linalg.norm(line)
        return rows

    return displaced


@dataclass(frozen=True)
class Example:
    problem: Problem
    make_model: Callable = naive.random_model
    make_rows: Callable = naive.matching_rows  # n exact rows of a model
    displaced: Callable = add_to_fourth_column  # exact rows with other residuals than 0
    unit: float = 1.0  # a residual of which size is neither tiny nor huge
    tie: float = 1e-6  # counts may be wrong for residuals as near to the threshold as this, in those units
    start: Callable = lambda rng, model: naive.shift_model(0.0)  # for fits that iterate, near the model
    others: tuple = (naive.shift_model(0.3), naive.shift_model(-2.0))  # clearly different models


def relative(focal1, focal2, unit):
    return Example(
        RelativePose(focal1, focal2),
        naive.random_pose,
        naive.two_view_rows,
        add_across_epipolar_line(focal1, focal2),
        unit,
        tie=2e-3,
        start=lambda rng, model: naive.nudged(rng, model, 3.0, direction=True),
    )


def absolute(focal, unit):
    return Example(
        AbsolutePose(focal),
        make_rows=naive.one_view_rows,
        displaced=add_to_column(0, focal),
        unit=unit,
        tie=2e-3,
        start=lambda rng, model: naive.nudged(rng, model, 3.0),
    )


EXAMPLES = {
    "rigid": Example(Registration()),
    "scaled": Example(Registration(2.5), lambda rng: naive.random_model(rng, 2.5)),
    "free scale": Example(Registration(None), lambda rng: naive.random_model(rng, rng.uniform(0.1, 9))),
    "oriented": Example(OrientedRegistration(), make_rows=oriented_rows, displaced=add_to_column(6)),
    "relative pose": relative(1.0, 1.0, 1e-3),
    "relative pose in pixels": relative(800.0, 1200.0, 2.0),
    "absolute pose": absolute(1.0, 1e-3),
    "absolute pose in pixels": absolute(800.0, 2.0),
    "a user's own": Example(
        naive.Shift(), lambda rng: naive.shift_model(rng.normal()), shift_rows, displaced=add_to_column(1)
    ),
    "a user's own of points": Example(
        naive.Line(),
        lambda rng: naive.line_model(rng.uniform(10, 170), rng.normal()),
        line_rows,
        add_across_line,
        others=(naive.line_model(3.0, 0.5), naive.line_model(100.0, -1.0)),
    ),
}


@pytest.fixture(params=EXAMPLES)
def case(request):
    return EXAMPLES[request.param]


@pytest.fixture
def example(case, rng):
    model = case.make_model(rng)
    return case.problem, model, lambda n: case.make_rows(rng, n, model)


def test_every_problem_has_an_example():
    contracts = {"ContractBroken", "Noise", "Problem", "SpecialCase", "Streaming"}
    exported = {getattr(nonsac.problems, name) for name in set(nonsac.problems.__all__) - contracts}
    assert exported <= {type(case.problem) for case in EXAMPLES.values()}


@pytest.mark.parametrize("n", [15, 60])
def test_does_what_the_contract_says(example, n):
    problem, _, make_rows = example
    check_problem(problem, make_rows(n))


def test_is_described_as_a_problem(example):
    problem, model, make_rows = example
    assert isinstance(problem, Problem)
    assert problem.width == len(problem.layout.names)
    assert problem.layout.split is None or 0 < problem.layout.split < problem.width
    assert make_rows(3).shape == (3, problem.width)
    assert model.shape == problem.no_model.shape == tuple(problem.model_shape)
    assert np.isnan(problem.no_model).all()
    assert problem.residual_dimension in (1, 2, 3)


def test_minimal_samples_give_the_model(example):
    problem, model, make_rows = example
    samples = make_rows(problem.minimal_size * 10).reshape(10, problem.minimal_size, problem.width)
    models = problem.solve_minimal(samples)
    assert models.shape[1:] == model.shape
    assert models.dtype == np.float64
    near = np.abs(models - model).reshape(len(models), -1).max(axis=1) < 1e-6
    assert near.sum() >= 7  # some oriented pairs do not determine a motion
    np.testing.assert_array_equal(solved(problem, samples), models)


def test_no_samples_give_no_models(example):
    problem, model, _ = example
    nothing = np.empty((0, problem.minimal_size, problem.width))
    assert problem.solve_minimal(nothing).shape == (0, *model.shape)
    assert solved(problem, nothing).shape == (0, *model.shape)


def test_residuals_vanish_on_exact_rows_and_grow_with_the_error(example, case):
    problem, model, make_rows = example
    rows = make_rows(12)
    atol = 1e-12 * max(1.0, case.unit)
    np.testing.assert_allclose(problem.residuals(model[None], rows), np.zeros((1, 12)), atol=atol)
    rows = case.displaced(model, rows, 0.25 * case.unit)
    expected = np.full((1, 12), 0.25 * case.unit)
    np.testing.assert_allclose(problem.residuals(model[None], rows), expected, rtol=0, atol=atol)


def test_residuals_of_several_models_are_those_of_each(example, case):
    problem, model, make_rows = example
    rows, models = make_rows(7), np.stack([model, *case.others])
    together = problem.residuals(models, rows)
    assert together.shape == (3, 7)
    np.testing.assert_allclose(together, np.vstack([problem.residuals(m[None], rows) for m in models]))


def test_inliers_are_the_rows_with_a_residual_below_the_threshold(example, case, rng):
    problem, model, make_rows = example
    rows = case.displaced(model, make_rows(500), case.unit * rng.uniform(0, 1, 500))
    models = np.stack([model, case.others[0]])
    for threshold in (0.2 * case.unit, 0.9 * case.unit):
        tied = (np.abs(problem.residuals(models, rows) - threshold) < case.tie * case.unit).any(axis=0)
        assert tied.sum() <= 10
        clear = rows[~tied]
        counts = problem.count_inliers(models, clear, threshold)
        np.testing.assert_array_equal(counts, (problem.residuals(models, clear) < threshold).sum(axis=1))


def test_with_weights_inliers_count_for_what_they_weigh(example, case, rng):
    problem, model, make_rows = example
    rows, weights = case.displaced(model, make_rows(300), case.unit * rng.uniform(0, 1, 300)), rng.uniform(0, 3, 300)
    models = np.stack([model, case.others[0]])
    expected = [weights[r < 0.5 * case.unit].sum() for r in problem.residuals(models, rows)]
    np.testing.assert_allclose(problem.count_inliers(models, rows, 0.5 * case.unit, weights), expected)
    assert 0 < expected[0] < weights.sum()


def test_counting_inliers_changes_neither_models_nor_rows(example):
    problem, model, make_rows = example
    rows, models = make_rows(20), np.stack([model] * 2)
    rows_before, models_before = rows.copy(), models.copy()
    problem.count_inliers(models, rows, 0.1)
    problem.residuals(models, rows)
    np.testing.assert_array_equal(rows, rows_before)
    np.testing.assert_array_equal(models, models_before)


def test_refit_of_exact_rows_is_exact(example, case, rng):
    problem, model, make_rows = example
    fitted = problem.refit(case.start(rng, model), make_rows(20), rng.uniform(0.1, 1, 20))
    np.testing.assert_allclose(fitted, model, atol=1e-9)


def test_a_row_of_twice_the_weight_counts_twice_in_a_fit(example, case, rng):
    problem, model, make_rows = example
    rows, double = case.displaced(model, make_rows(20), 0.1 * case.unit * rng.uniform(0, 1, 20)), np.arange(20) % 2 == 0
    start, weights = case.start(rng, model), np.where(double, 2.0, 1.0)
    twice = np.vstack([rows, rows[double]])
    fitted = problem.refit(start, rows, weights)
    np.testing.assert_allclose(fitted, problem.refit(start, twice, np.ones(30)), atol=1e-8)
    assert np.abs(fitted - problem.refit(start, rows, np.ones(20))).max() > 1e-6


def test_a_robust_fit_of_exact_rows_is_exact_beside_outliers(example, case, rng):
    problem, model, make_rows = example
    rows = make_rows(30)
    off = case.displaced(model, rows[:20], 0.1 * case.unit * rng.uniform(0, 1, 20))
    start = problem.refit(case.start(rng, model), off, np.ones(20))
    assert np.abs(start - model).max() > 1e-6
    rows[20:] = case.displaced(model, rows[20:], 50 * case.unit)
    fitted = problem.fit_robustly(start, rows, rng.uniform(0.1, 1, 30), 5 * case.unit, 20)
    np.testing.assert_allclose(fitted, model, atol=1e-9)


def test_too_few_rows_with_a_weight_are_not_fitted(example):
    problem, model, make_rows = example
    few = problem.minimal_size - 1
    for rows, weights in ((make_rows(few), np.ones(few)), (make_rows(20), np.arange(20) < few)):
        np.testing.assert_array_equal(refitted(problem, model, rows, weights.astype(np.float64)), problem.no_model)


@pytest.mark.parametrize("name", [name for name in EXAMPLES if not name.startswith("a user's own")])
def test_refit_without_rows_is_nan(rng, name):
    """A user's own problem need not see to that: it is not asked (see `refitted`)."""
    case = EXAMPLES[name]
    fitted = case.problem.refit(case.make_model(rng), np.empty((0, case.problem.width)), np.empty(0))
    assert np.shape(fitted) == (3, 4)
    assert np.isnan(fitted).all()


def test_many_exact_rows_determine_the_model(example):
    problem, model, make_rows = example
    assert problem.determined(model, make_rows(50), Noise.within(0.01))


def test_copies_of_one_row_determine_nothing_without_a_model(example):
    problem, _, make_rows = example
    if problem.minimal_size > 1:
        assert not problem.determined(problem.no_model, np.repeat(make_rows(1), 20, axis=0), Noise.within(0.01))


def test_special_cases_say_what_they_explain(example, case, rng):
    problem, model, make_rows = example
    rows = case.displaced(model, make_rows(40), 0.1 * case.unit * rng.uniform(0, 1, 40))
    for special in problem.special_cases(model, rows, Noise.given(case.unit)):
        assert isinstance(special, SpecialCase)
        assert special.name
        assert special.explains.shape == (40,)
        assert special.explains.dtype == bool
        assert all(np.shape(other) == model.shape for other in special.others)


def test_a_covariance_is_a_symmetric_table_or_none(example, case, rng):
    problem, model, make_rows = example
    rows = case.displaced(model, make_rows(40), 0.1 * case.unit * rng.uniform(0, 1, 40))
    covariance = problem.covariance(model, rows, Noise.given(case.unit))
    assert (covariance is None) == (type(problem) in (OrientedRegistration, naive.Shift, naive.Line))
    if covariance is not None:
        np.testing.assert_allclose(covariance, covariance.T, rtol=1e-6)
        assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_background_rows_hold_no_matches(example, case, rng):
    """The right model explains all rows, but hardly any of the background; which is the same each time."""
    problem, model, make_rows = example
    rows = make_rows(200)
    first, second = (problem.background(rows, 1000, np.random.default_rng(5)) for _ in range(2))
    assert first.shape == (1000, problem.width)
    np.testing.assert_array_equal(first, second)
    assert (problem.residuals(model[None], first)[0] < 1e-6).mean() < 0.05
    if problem.layout.split is not None:
        assert (first.min(axis=0) >= rows.min(axis=0)).all()
        assert (first.max(axis=0) <= rows.max(axis=0)).all()


def test_a_motion_has_a_matrix_and_other_models_have_none(example):
    problem, model, _ = example
    if model.shape != (3, 4):
        assert problem.transform(model) is None
    else:
        np.testing.assert_array_equal(problem.transform(model), np.vstack([model, [0, 0, 0, 1]]))
        assert np.isnan(problem.transform(problem.no_model)[:3]).all()


def test_a_model_can_be_told_in_one_line(example):
    problem, model, _ = example
    told = problem.describe(model)
    assert "\n" not in told
    name, numbers = told.split("[")
    assert name == "model "
    np.testing.assert_allclose([float(x) for x in numbers.rstrip("]").split()], model.ravel(), rtol=0, atol=1e-5)


def test_distance_is_a_symmetric_table_with_a_zero_diagonal(example, case):
    problem, model, _ = example
    models = np.stack([model, *case.others])
    table = problem.distance(models[:, None], models[None, :])
    assert table.shape == (3, 3)
    np.testing.assert_array_equal(np.diag(table), 0.0)
    np.testing.assert_allclose(table, table.T)
    assert np.ndim(problem.distance(model, model)) == 0
