"""Eigenvectors of small symmetric matrices."""

from __future__ import annotations

from nonsac.kernels._jit import kernel


@kernel
def diagonalise(matrix, basis):
    """Diagonalise a small symmetric `matrix` in place by cyclic Jacobi rotations (Golub and Van Loan, Sec. 8.5).

    The columns of `basis`, of the same shape, receive the eigenvectors; the eigenvalues, in no order, stand on the
    matrix' diagonal.
    """
    n = matrix.shape[0]
    scale = 0.0
    for i in range(n):
        for j in range(n):
            basis[i, j] = 1.0 if i == j else 0.0
            scale = max(scale, abs(matrix[i, j]))
    for _ in range(24):
        off_diagonal = 0.0
        for i in range(n - 1):
            for j in range(i + 1, n):
                off_diagonal = max(off_diagonal, abs(matrix[i, j]))
        if off_diagonal <= 1e-16 * scale:
            break
        for p in range(n - 1):
            for q in range(p + 1, n):
                if matrix[p, q] == 0.0:
                    continue
                ratio = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                tangent = 1.0 / (abs(ratio) + (ratio * ratio + 1.0) ** 0.5)
                if ratio < 0.0:
                    tangent = -tangent
                cosine = 1.0 / (tangent * tangent + 1.0) ** 0.5
                sine = tangent * cosine
                for k in range(n):
                    left, right = matrix[k, p], matrix[k, q]
                    matrix[k, p] = cosine * left - sine * right
                    matrix[k, q] = sine * left + cosine * right
                for k in range(n):
                    left, right = matrix[p, k], matrix[q, k]
                    matrix[p, k] = cosine * left - sine * right
                    matrix[q, k] = sine * left + cosine * right
                for k in range(n):
                    left, right = basis[k, p], basis[k, q]
                    basis[k, p] = cosine * left - sine * right
                    basis[k, q] = sine * left + cosine * right
