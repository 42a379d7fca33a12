"""Which rows form a sample: a function of seed and position alone, in constant memory, for any number of rows."""

from __future__ import annotations

import numpy as np

from nonsac.seeds import Indices, permutation


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

    If a pass has no full piece left, the next one begins.
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

    All rows if the samples need more than one pass, even if a few were left over at its end.
    """
    wanted = max(end, at_least)
    return np.arange(rows, dtype=np.int64) if wanted >= rows else np.sort(permutation(rows, 0, wanted, seed))
