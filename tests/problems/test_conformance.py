"""What every problem must do; a new problem in `nonsac.problems` has to be added to EXAMPLES, the test says so."""

import pickle
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import brentq

import naive
import nonsac.problems
from nonsac.clouds.problem import OrientedRegistration
from nonsac.problems import AbsolutePose, Registration, RelativePose, Weighted
from nonsac.problems.contract import Problem


def oriented_rows(rng, n, model):
    a, u = rng.uniform(-1, 1, (n, 3)), rng.standard_normal((n, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    signs = rng.choice([-1.0, 1.0], (n, 1))
    return np.hstack([a, u, naive.moved(model, a), signs * (u @ model[:, :3].T)])


def shift_rows(rng, n, model):
    x = rng.standard_normal(n)
    return np.column_stack([x, x + model[0, 3]])


def rows_with_weights(make_rows, weight):
    return lambda rng, n, model: np.column_stack([make_rows(rng, n, model), np.full(n, weight)])


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
    "weighted": Example(Weighted(Registration()), make_rows=rows_with_weights(naive.matching_rows, 1.0)),
    "weighted pose": Example(
        Weighted(RelativePose(800.0, 1200.0)),
        naive.random_pose,
        rows_with_weights(naive.two_view_rows, 3.0),
        lambda model, rows, residuals: np.column_stack(
            [add_across_epipolar_line(800.0, 1200.0)(model, rows[:, :4], residuals), rows[:, 4]]
        ),
        start=lambda rng, model: naive.nudged(rng, model, 3.0, direction=True),
    ),
    "a user's own": Example(
        naive.Shift(), lambda rng: naive.shift_model(rng.normal()), shift_rows, displaced=add_to_column(1)
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
    contracts = {"Problem", "Simpler", "residual_dimension"}
    exported = {getattr(nonsac.problems, name) for name in set(nonsac.problems.__all__) - contracts}
    assert exported <= {type(case.problem) for case in EXAMPLES.values()}


def test_follows_the_protocol(example):
    problem, _, make_rows = example
    assert isinstance(problem, Problem)
    assert 0 < problem.split < problem.width
    assert make_rows(3).shape == (3, problem.width)


def test_minimal_samples_give_the_model(example):
    problem, model, make_rows = example
    samples = make_rows(problem.minimal_size * 10).reshape(10, problem.minimal_size, problem.width)
    models = problem.solve_minimal(samples)
    assert models.shape[1:] == (3, 4)
    assert models.dtype == np.float64
    near = np.abs(models - model).max(axis=(1, 2)) < 1e-6
    assert near.sum() >= 7  # some oriented pairs do not determine a motion


def test_no_samples_give_no_models(example):
    problem = example[0]
    if not isinstance(problem, naive.Shift):
        assert problem.solve_minimal(np.empty((0, problem.minimal_size, problem.width))).shape == (0, 3, 4)


def test_residuals_vanish_on_exact_rows_and_grow_with_the_error(example, case):
    problem, model, make_rows = example
    rows = make_rows(12)
    atol = 1e-12 * max(1.0, case.unit)
    np.testing.assert_allclose(problem.residuals(model[None], rows), np.zeros((1, 12)), atol=atol)
    rows = case.displaced(model, rows, 0.25 * case.unit)
    expected = np.full((1, 12), 0.25 * case.unit)
    np.testing.assert_allclose(problem.residuals(model[None], rows), expected, rtol=0, atol=atol)


def test_residuals_of_several_models_are_those_of_each(example):
    problem, model, make_rows = example
    rows, models = make_rows(7), np.stack([model, naive.shift_model(0.3), naive.shift_model(-2.0)])
    together = problem.residuals(models, rows)
    assert together.shape == (3, 7)
    np.testing.assert_allclose(together, np.vstack([problem.residuals(m[None], rows) for m in models]))


def test_inliers_are_the_rows_with_a_residual_below_the_threshold(example, case, rng):
    problem, model, make_rows = example
    rows = case.displaced(model, make_rows(500), case.unit * rng.uniform(0, 1, 500))
    models = np.stack([model, naive.shift_model(0.3)])
    for threshold in (0.2 * case.unit, 0.9 * case.unit):
        tied = (np.abs(problem.residuals(models, rows) - threshold) < case.tie * case.unit).any(axis=0)
        assert tied.sum() <= 10
        clear = rows[~tied]
        counts = problem.count_inliers(models, clear, threshold)
        np.testing.assert_array_equal(counts, (problem.residuals(models, clear) < threshold).sum(axis=1))


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


def test_refit_without_rows_is_nan(example):
    problem, model, _ = example
    fitted = problem.refit(model, np.empty((0, problem.width)), np.empty(0))
    assert np.shape(fitted) == (3, 4)
    assert np.isnan(fitted).all()


def test_many_exact_rows_determine_the_model(example):
    problem, model, make_rows = example
    assert problem.determined(model, make_rows(50), 0.01)


def test_distance_is_a_symmetric_table_with_a_zero_diagonal(example, rng):
    problem, model, _ = example
    models = np.stack([model, naive.shift_model(0.5), naive.shift_model(2.0)])
    table = problem.distance(models[:, None], models[None, :])
    assert table.shape == (3, 3)
    np.testing.assert_array_equal(np.diag(table), 0.0)
    np.testing.assert_allclose(table, table.T)
    assert np.ndim(problem.distance(model, model)) == 0


def test_distance_to_no_model_is_nan_without_a_warning(example):
    problem, model, _ = example
    assert np.isnan(problem.distance(model, np.full((3, 4), np.nan)))


def test_travels_to_another_process(example):
    problem, model, make_rows = example
    rows = make_rows(4)
    copy = pickle.loads(pickle.dumps(problem))
    np.testing.assert_array_equal(copy.residuals(model[None], rows), problem.residuals(model[None], rows))
