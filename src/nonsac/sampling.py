"""Which rows form sample i: a function of (seed, i) alone, in constant memory, for any number of rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]

_ROUNDS = 6


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
        positions = np.arange(sample * sample_size, (sample + 1) * sample_size)
        return np.sort(permute(positions, rows, _key(seed, 0)))
    return np.sort(permute(np.arange(sample_size), rows, _key(seed, sample + 1)))


def permute(positions: NDArray[np.integer], rows: int, key: NDArray[np.uint64]) -> Indices:
    """Where a keyed pseudo-random permutation of `range(rows)` sends `positions`.

    A balanced Feistel network on the smallest even number of bits that holds `rows`, walked along its cycles until
    the value falls into the range (Black and Rogaway, "Ciphers with arbitrary finite domains", 2002).
    """
    half_bits = np.uint64(max(1, ((rows - 1).bit_length() + 1) // 2))
    values = _feistel(np.asarray(positions, np.uint64), half_bits, key)
    outside = np.flatnonzero(values >= rows)
    while outside.size:
        values[outside] = _feistel(values[outside], half_bits, key)
        outside = outside[values[outside] >= rows]
    return values.astype(np.int64)


def _feistel(values: NDArray[np.uint64], half_bits: np.uint64, key: NDArray[np.uint64]) -> NDArray[np.uint64]:
    mask = (np.uint64(1) << half_bits) - np.uint64(1)
    left, right = values >> half_bits, values & mask
    for round_key in key:
        left, right = right, left ^ (_mix(right + round_key) & mask)
    return (left << half_bits) | right


def _mix(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The finaliser of SplitMix64 (Steele, Lea and Flood 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def _key(seed: int, stream: int) -> NDArray[np.uint64]:
    return np.random.SeedSequence([seed, stream]).generate_state(_ROUNDS, np.uint64)


def canonical_seed(rng: int | np.random.Generator | None) -> int:
    """The integer seed behind an `rng` argument: the integer itself, a draw from the generator, or fresh entropy."""
    if rng is None:
        return int(np.random.SeedSequence().generate_state(1, np.uint64)[0] >> np.uint64(1))
    if isinstance(rng, np.random.Generator):
        return int(rng.integers(2**63))
    if isinstance(rng, (int, np.integer)) and not isinstance(rng, bool) and rng >= 0:
        return int(rng)
    raise ValueError(f"rng must be a non-negative integer, a numpy Generator or None, got {rng!r}")
