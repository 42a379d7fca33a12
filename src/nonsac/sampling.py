"""Which rows form a sample: a function of seed and position alone, in constant memory, for any number of rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.permutation import permute_positions

Indices = NDArray[np.int64]

_ROUNDS = 8


def sample_rows(rows: int, start: int, size: int, seed: int) -> Indices:
    """Row numbers of the sample that starts at a position of the passes, sorted.

    A pass is a pseudo-random permutation of all rows, one after the other without end, of which only the piece at
    hand is computed; so the samples of a pass are disjoint. A sample that would need all rows gets all of them.

    Returns
    -------
    (min(size, rows),) int64
    """
    if size >= rows:
        return np.arange(rows, dtype=np.int64)
    turn, first = divmod(start, rows)
    return np.sort(permutation(rows, first, size, seed, stream=turn))


def sample_start(rows: int, first: int, sample: int, size: int) -> int:
    """Where a sample starts that comes after `sample` others of its size, from a position of the passes on.

    Where a pass has no full piece left, the next one begins.
    """
    if size >= rows:
        return first + sample * size
    left = (rows - first % rows) // size
    if sample < left:
        return first + sample * size
    turn, piece = divmod(sample - left, rows // size)
    return (first // rows + 1 + turn) * rows + piece * size


def union_rows(rows: int, end: int, seed: int, at_least: int = 0) -> Indices:
    """Row numbers that the samples up to a position hold together, each once, and more up to a number; sorted.

    All rows, where the samples need more than one pass, even if a few were left over at its end.
    """
    wanted = max(end, at_least)
    return np.arange(rows, dtype=np.int64) if wanted >= rows else np.sort(permutation(rows, 0, wanted, seed))


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
