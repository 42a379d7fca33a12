"""A keyed pseudo-random permutation of a range, evaluated at any positions."""

from __future__ import annotations

import numpy as np

from nonsac.kernels._jit import kernel


@kernel
def _mix(x):
    """The finaliser of SplitMix64 (Steele, Lea and Flood 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@kernel
def permute_positions(first, rows, left_bits, right_bits, key, permuted):
    """Where the permutation of `range(rows)` sends the positions `first`, `first + 1`, ...: into `permuted`, int64.

    A Feistel network on `left_bits + right_bits` bits, which hold `rows`, walked along its cycles until the value
    falls into the range (Black and Rogaway, "Ciphers with arbitrary finite domains", 2002). `key` (an even number of
    rounds) is uint64.
    """
    left_mask = (np.uint64(1) << np.uint64(left_bits)) - np.uint64(1)
    right_mask = (np.uint64(1) << np.uint64(right_bits)) - np.uint64(1)
    for i in range(permuted.shape[0]):
        value = np.uint64(first + i)
        while True:
            left = value >> np.uint64(right_bits)
            right = value & right_mask
            for k in range(0, key.shape[0], 2):
                left ^= _mix(right + key[k]) & left_mask
                right ^= _mix(left + key[k + 1]) & right_mask
            value = (left << np.uint64(right_bits)) | right
            if value < np.uint64(rows):
                break
        permuted[i] = np.int64(value)
