import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.kernels.kabsch import fit_each, fit_similarity, largest_eigenvector


def fit(rows, weights=None, scale=1.0):
    """The fitted model, or None where the kernel says that the rows determine none."""
    model = np.full((3, 4), np.nan)
    weights = np.ones(len(rows)) if weights is None else weights
    free = scale is None
    return model if fit_similarity(rows, weights, free, 1.0 if free else float(scale), model) else None


@pytest.mark.parametrize("n", [3, 4, 10, 1000])
@pytest.mark.parametrize("scale", [1.0, 0.1, 30.0, None])
def test_equals_the_svd_solution(rng, n, scale):
    rows = naive.matching_rows(rng, n, naive.random_model(rng, scale or 7.0), noise=0.05)
    weights = rng.uniform(0.1, 1.0, n)
    np.testing.assert_allclose(fit(rows, weights, scale), naive.kabsch(rows, weights, scale), atol=1e-8)


def test_recovers_an_exact_motion(rng):
    for _ in range(100):
        model = naive.random_model(rng)
        np.testing.assert_allclose(fit(naive.matching_rows(rng, 5, model)), model, atol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 0.5, 3.0, 1e6])
def test_recovers_an_exact_similarity(rng, scale):
    model = naive.random_model(rng, scale)
    np.testing.assert_allclose(fit(naive.matching_rows(rng, 8, model), scale=None), model, atol=1e-11 * max(scale, 1))


@pytest.mark.parametrize(
    "axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1), (1, -2, 3)]
)
@pytest.mark.parametrize("degrees", [0.0, 1e-6, 90.0, 179.999999, 180.0])
def test_recovers_half_turns(rng, axis, degrees):
    R = Rotation.from_rotvec(np.radians(degrees) * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    model = np.column_stack([R, [1.0, 2.0, 3.0]])
    np.testing.assert_allclose(fit(naive.matching_rows(rng, 6, model)), model, atol=1e-12)


def test_never_returns_a_reflection(rng):
    rows = naive.matching_rows(rng, 20, np.column_stack([np.diag([1.0, 1.0, -1.0]), np.zeros(3)]))
    fitted = fit(rows)
    assert np.linalg.det(fitted[:, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(fitted, naive.kabsch(rows, np.ones(20)), atol=1e-9)


def test_planar_points_determine_the_motion(rng):
    model = naive.random_model(rng)
    a = rng.standard_normal((7, 3)) * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(fit(np.hstack([a, naive.moved(model, a)])), model, atol=1e-12)


def test_rows_of_weight_zero_do_not_count(rng):
    model = naive.random_model(rng)
    rows = np.vstack([naive.matching_rows(rng, 6, model), rng.uniform(-100, 100, (5, 6))])
    np.testing.assert_allclose(fit(rows, np.r_[np.ones(6), np.zeros(5)]), model, atol=1e-12)


def test_only_the_proportions_of_weights_matter(rng):
    rows = naive.matching_rows(rng, 30, naive.random_model(rng), noise=0.1)
    weights = rng.uniform(0, 1, 30)
    np.testing.assert_allclose(fit(rows, 1e-9 * weights), fit(rows, weights), atol=1e-12)


@pytest.mark.parametrize("offset", [1e6, 1e7])
def test_far_from_the_origin_the_rotation_keeps_its_digits(rng, offset):
    model = naive.random_model(rng)
    rows = naive.matching_rows(rng, 50, model)
    shifted = fit(rows + offset)
    np.testing.assert_allclose(shifted[:, :3], model[:, :3], atol=1e-15 * offset)
    np.testing.assert_allclose(naive.residuals(shifted, rows + offset), 0.0, atol=1e-14 * offset)


@pytest.mark.parametrize("n", [1, 2, 3, 10])
@pytest.mark.parametrize("scale", [1.0, None])
def test_identical_points_determine_nothing(n, scale):
    assert fit(np.ones((n, 6)), scale=scale) is None


@pytest.mark.parametrize("n", [2, 3, 10])
@pytest.mark.parametrize("scale", [1.0, None])
def test_collinear_points_determine_nothing(n, scale):
    a = np.linspace(0, 1, n)[:, None] * [1.0, 2.0, 3.0] + [4.0, 5.0, 6.0]
    assert fit(np.hstack([a, a[:, [1, 2, 0]]]), scale=scale) is None


def test_points_collinear_in_one_cloud_determine_nothing(rng):
    assert fit(np.hstack([rng.standard_normal((5, 3)), np.linspace(0, 1, 5)[:, None] * [1.0, 0.0, 0.0]])) is None


@pytest.mark.parametrize("weights", [[0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0]])
def test_too_little_weight_determines_nothing(rng, weights):
    assert fit(naive.matching_rows(rng, 4, naive.random_model(rng)), np.array(weights)) is None


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_rows_that_are_not_finite_determine_nothing(rng, bad):
    rows = naive.matching_rows(rng, 4, naive.random_model(rng))
    rows[2, 4] = bad
    assert fit(rows) is None


def test_fit_each_leaves_out_degenerate_samples_and_keeps_the_order(rng):
    truth = np.stack([naive.random_model(rng) for _ in range(5)])
    samples = np.stack([naive.matching_rows(rng, 3, model) for model in truth])
    samples[1] = 1.0
    samples[3, 2] = samples[3, 0]
    models = np.empty((5, 3, 4))
    assert fit_each(samples, False, 1.0, models) == 3
    np.testing.assert_allclose(models[:3], truth[[0, 2, 4]], atol=1e-9)


def test_eigenvector_and_gap_equal_those_of_numpy(rng):
    for _ in range(50):
        root = rng.standard_normal((4, 4))
        matrix = root + root.T
        values, vectors = np.linalg.eigh(matrix)
        vector = np.empty(4)
        gap = largest_eigenvector(matrix.copy(), vector)
        assert gap == pytest.approx((values[3] - values[2]) / (values[3] - values[0]), abs=1e-12)
        assert abs(vector @ vectors[:, 3]) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("diagonal", [(0, 0, 0, 0), (1, 1, 1, 1), (2, 2, 1, 0)])
def test_a_tie_for_the_largest_eigenvalue_leaves_no_gap(diagonal):
    assert largest_eigenvector(np.diag(np.array(diagonal, float)), np.empty(4)) == 0.0
