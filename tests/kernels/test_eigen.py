import numpy as np
import pytest

from nonsac.kernels.eigen import diagonalise


def diagonalised(matrix):
    work, basis = matrix.copy(), np.full_like(matrix, np.nan)
    diagonalise(work, basis)
    return np.diag(work), basis


@pytest.mark.parametrize("n", [3, 4])
@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_equals_numpy_on_random_matrices(rng, n, scale):
    for _ in range(50):
        root = rng.standard_normal((n, n))
        matrix = scale * (root + root.T)
        values, basis = diagonalised(matrix)
        np.testing.assert_allclose(np.sort(values), np.linalg.eigvalsh(matrix), atol=1e-13 * scale * n)
        np.testing.assert_allclose(basis @ np.diag(values) @ basis.T, matrix, atol=1e-13 * scale * n)
        np.testing.assert_allclose(basis.T @ basis, np.eye(n), atol=1e-13)


@pytest.mark.parametrize(
    "matrix", [np.zeros((3, 3)), np.eye(3), np.ones((4, 4)), np.diag([1.0, 1e-300, 0.0]), np.diag([3.0, -3.0, 0, 0])]
)
def test_special_matrices_are_no_problem(matrix):
    values, basis = diagonalised(matrix)
    np.testing.assert_allclose(basis @ np.diag(values) @ basis.T, matrix, atol=1e-14)
    np.testing.assert_allclose(basis.T @ basis, np.eye(len(matrix)), atol=1e-14)
