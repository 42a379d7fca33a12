import numpy as np
import pytest

import naive
from nonsac.kernels.residuals import count_registration_inliers, registration_residuals


def residuals(models, rows):
    result = np.full((len(models), len(rows)), -1.0)
    registration_residuals(models, np.ascontiguousarray(rows.T), result)
    return result


def counts(models, rows, threshold):
    result = np.full(len(models), -1, np.int64)
    columns = np.ascontiguousarray(rows.T, np.float32)
    count_registration_inliers(models.astype(np.float32), columns, np.float32(threshold**2), result)
    return result


@pytest.fixture
def models(rng):
    return np.stack([naive.random_model(rng, scale) for scale in (1.0, 1.0, 0.3, 5.0)])


@pytest.mark.parametrize("n", [0, 1, 7, 64, 1001])
def test_residuals_equal_the_definition(rng, models, n):
    rows = rng.standard_normal((n, 6))
    expected = np.stack([naive.residuals(model, rows) for model in models])
    np.testing.assert_allclose(residuals(models, rows), expected, rtol=1e-12)


@pytest.mark.parametrize("n", [0, 1, 7, 64, 1001])
def test_counts_equal_the_definition_away_from_ties(rng, models, n):
    rows = rng.standard_normal((n, 6))
    truth = np.stack([naive.residuals(model, rows) for model in models])
    threshold = 2.0
    assert not (np.abs(truth - threshold) < 1e-5).any()
    np.testing.assert_array_equal(counts(models, rows, threshold), (truth < threshold).sum(axis=1))


def test_a_residual_equal_to_the_threshold_is_no_inlier():
    identity = np.eye(4)[None, :3]
    rows = np.array([[0, 0, 0, 2.0, 0, 0], [0, 0, 0, 1.5, 0, 0]])
    assert counts(identity, rows, 2.0)[0] == 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", range(6))
def test_rows_that_are_not_finite_never_count(rng, bad, column):
    model = naive.random_model(rng)
    rows = naive.matching_rows(rng, 20, model)
    rows[[3, 17], column] = bad
    assert counts(model[None], rows, 1.0)[0] == 18
    assert (residuals(model[None], rows)[0] < 1.0).sum() == 18


def test_a_model_of_nan_has_no_inliers(rng):
    nothing = np.full((1, 3, 4), np.nan)
    rows = rng.standard_normal((20, 6))
    assert counts(nothing, rows, 1e6)[0] == 0
    assert np.isnan(residuals(nothing, rows)).all()
