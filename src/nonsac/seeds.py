"""Seeds, and the pseudo-random permutations that they stand for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.permutation import permute_positions

Indices = NDArray[np.int64]
_ROUNDS = 8


def permutation(rows: int, first: int, count: int, seed: int, stream: int = 0) -> Indices:
    """A piece of a pseudo-random permutation of `range(rows)`: its values at `first` to `first + count - 1`.

    Each (seed, stream) gives another permutation.
    """
    key = np.random.SeedSequence([seed, stream]).generate_state(_ROUNDS, np.uint64)
    bits = max(2, (rows - 1).bit_length())
    permuted = np.empty(count, np.int64)
    permute_positions(first, rows, bits - bits // 2, bits // 2, key, permuted)
    return permuted


def canonical_seed(rng: int | np.random.Generator | None) -> int:
    """The integer seed behind an `rng` argument: the integer itself, a draw from the generator, or fresh entropy."""
    if rng is None:
        return int(np.random.SeedSequence().generate_state(1, np.uint64)[0] >> np.uint64(1))
    if isinstance(rng, np.random.Generator):
        return int(rng.integers(2**63))
    if isinstance(rng, (int, np.integer)) and not isinstance(rng, bool) and rng >= 0:
        return int(rng)
    raise ValueError(f"rng must be a non-negative integer, a numpy Generator or None, got {rng!r}")
