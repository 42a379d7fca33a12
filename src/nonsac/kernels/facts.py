"""Which rows say something new."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import reordered_kernel


@reordered_kernel
def distant_rows(rows, apart, split, distant):
    """Mark rows (N, D) that lie `apart` (D,) or more, in either half, from all marked before; returns how many.

    The halves are the columns before `split` and from it on; `distant` (N,) bool is overwritten. Single precision,
    relative to the first row.
    """
    n, size = rows.shape
    scaled = np.empty(size, np.float32)
    marked = np.empty((size, n), np.float32)
    first, second = np.empty(n, np.float32), np.empty(n, np.float32)
    count = 0
    for i in range(n):
        for c in range(size):
            scaled[c] = np.float32((rows[i, c] - rows[0, c]) / apart[c])
        for j in range(count):
            first[j] = np.float32(0.0)
            second[j] = np.float32(0.0)
        for c in range(split):
            value, column = scaled[c], marked[c]
            for j in range(count):
                difference = column[j] - value
                first[j] += difference * difference
        for c in range(split, size):
            value, column = scaled[c], marked[c]
            for j in range(count):
                difference = column[j] - value
                second[j] += difference * difference
        near = 0
        for j in range(count):
            near += np.int32((first[j] < np.float32(1.0)) & (second[j] < np.float32(1.0)))
        distant[i] = near == 0
        if near == 0:
            for c in range(size):
                marked[c, count] = scaled[c]
            count += 1
    return count
