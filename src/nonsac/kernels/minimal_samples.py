"""Minimal samples of rows: compiled, because NumPy would hold the interpreter's lock, and threads wait for it."""

from __future__ import annotations

from nonsac.kernels._jit import kernel


@kernel
def distinct_rows(uniform, rows, drawn):
    """Turn numbers uniform in [0, 1) into distinct row numbers `drawn`, both (B, k): Floyd's algorithm (Bentley 1987).

    All k-subsets of the rows are equally likely.
    """
    size = uniform.shape[1]
    for b in range(uniform.shape[0]):
        for j in range(size):
            highest = rows - size + j
            row = min(int(uniform[b, j] * (highest + 1)), highest)
            for i in range(j):
                if drawn[b, i] == row:
                    row = highest
                    break
            drawn[b, j] = row


@kernel
def gather_rows(rows, numbers, samples):
    """Copy rows (N, D) with the given numbers (B, k) to `samples` (B, k, D)."""
    for b in range(numbers.shape[0]):
        for i in range(numbers.shape[1]):
            for c in range(rows.shape[1]):
                samples[b, i, c] = rows[numbers[b, i], c]
