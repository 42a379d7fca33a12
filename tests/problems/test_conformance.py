"""What every problem must do; a new problem in `nonsac.problems` has to be added to EXAMPLES, the test says so."""

import pickle

import numpy as np
import pytest

import naive
import nonsac.problems
from nonsac.problems import OrientedRegistration, Problem, Registration


def oriented_rows(rng, n, model):
    a, u = rng.uniform(-1, 1, (n, 3)), rng.standard_normal((n, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    signs = rng.choice([-1.0, 1.0], (n, 1))
    return np.hstack([a, u, naive.moved(model, a), signs * (u @ model[:, :3].T)])


# Name -> a problem, a maker of random models, and a maker of n exact rows of a model.
EXAMPLES = {
    "rigid": (Registration(), naive.random_model, naive.matching_rows),
    "scaled": (Registration(2.5), lambda rng: naive.random_model(rng, 2.5), naive.matching_rows),
    "free scale": (Registration(None), lambda rng: naive.random_model(rng, rng.uniform(0.1, 9)), naive.matching_rows),
    "oriented": (OrientedRegistration(), naive.random_model, oriented_rows),
    "a user's own": (naive.Shift(), lambda rng: naive.shift_model(rng.normal()), None),
}


def shift_rows(rng, n, model):
    x = rng.standard_normal(n)
    return np.column_stack([x, x + model[0, 3]])


@pytest.fixture(params=EXAMPLES)
def example(request, rng):
    problem, make_model, make_rows = EXAMPLES[request.param]
    model = make_model(rng)
    return problem, model, lambda n: (make_rows or shift_rows)(rng, n, model)


def test_every_problem_has_an_example():
    exported = {getattr(nonsac.problems, name) for name in nonsac.problems.__all__ if name != "Problem"}
    assert exported <= {type(problem) for problem, *_ in EXAMPLES.values()}


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


def test_residuals_vanish_on_exact_rows_and_grow_with_the_error(example):
    problem, model, make_rows = example
    rows = make_rows(12)
    np.testing.assert_allclose(problem.residuals(model[None], rows), np.zeros((1, 12)), atol=1e-12)
    column = problem.split
    rows[:, column] += 0.25
    np.testing.assert_allclose(problem.residuals(model[None], rows), np.full((1, 12), 0.25), atol=1e-12)


def test_residuals_of_several_models_are_those_of_each(example):
    problem, model, make_rows = example
    rows, models = make_rows(7), np.stack([model, naive.shift_model(0.3), naive.shift_model(-2.0)])
    together = problem.residuals(models, rows)
    assert together.shape == (3, 7)
    np.testing.assert_allclose(together, np.vstack([problem.residuals(m[None], rows) for m in models]))


def test_inliers_are_the_rows_with_a_residual_below_the_threshold(example, rng):
    problem, model, make_rows = example
    rows = make_rows(500)
    rows[:, problem.split] += rng.uniform(0, 1, 500)
    models = np.stack([model, naive.shift_model(0.3)])
    for threshold in (0.2, 0.9):
        residuals = problem.residuals(models, rows)
        assert np.abs(residuals - threshold).min() > 1e-6
        counts = problem.count_inliers(models, rows, threshold)
        np.testing.assert_array_equal(counts, (residuals < threshold).sum(axis=1))


def test_counting_inliers_changes_neither_models_nor_rows(example):
    problem, model, make_rows = example
    rows, models = make_rows(20), np.stack([model] * 2)
    rows_before, models_before = rows.copy(), models.copy()
    problem.count_inliers(models, rows, 0.1)
    problem.residuals(models, rows)
    np.testing.assert_array_equal(rows, rows_before)
    np.testing.assert_array_equal(models, models_before)


def test_refit_of_exact_rows_is_exact(example, rng):
    problem, model, make_rows = example
    fitted = problem.refit(naive.shift_model(0.0), make_rows(20), rng.uniform(0.1, 1, 20))
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
