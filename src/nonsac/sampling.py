"""Which rows form sample i: a function of (seed, i) alone, in constant memory, for any number of rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.permutation import permute_positions

Indices = NDArray[np.int64]

_ROUNDS = 8


def sample_rows(rows: int, sample: int, samples: int, sample_size: int, seed: int) -> Indices:
    """Row numbers of one sample, sorted.

    Samples are disjoint where the data allow it (`samples * sample_size <= rows`): sample i is then the i-th piece
    of one pseudo-random permutation of all rows, of which only this piece is computed. Otherwise each sample is
    drawn independently, without replacement. A sample that would need all rows gets all of them.

    Returns
    -------
    (min(sample_size, rows),) int64
    """
    if sample_size >= rows:
        return np.arange(rows, dtype=np.int64)
    if samples * sample_size <= rows:
        return np.sort(permutation(rows, sample * sample_size, sample_size, seed))
    return np.sort(permutation(rows, 0, sample_size, seed, stream=sample + 1))


def union_rows(rows: int, count: int, samples: int, sample_size: int, seed: int, at_least: int = 0) -> Indices:
    """Row numbers that the first `count` of the samples hold together, each once, and more up to a number; sorted.

    Where the samples overlap, `at_least` adds nothing unless it asks for all rows.
    """
    disjoint = samples * sample_size <= rows
    wanted = max(count * sample_size, at_least)
    if sample_size >= rows or at_least >= rows or (disjoint and wanted >= rows):
        return np.arange(rows, dtype=np.int64)
    if disjoint:
        return np.sort(permutation(rows, 0, wanted, seed))
    return np.unique(np.concatenate([sample_rows(rows, i, samples, sample_size, seed) for i in range(count)]))


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
