"""A uniform random subset of the rows of a stream, kept while it passes by."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.seeds import canonical_seed
from nonsac.sources.array import ArraySource
from nonsac.values.checks import iterable
from nonsac.values.numeric import as_whole, shown

_MOST_ROWS = 10**8
_LARGEST_KEY = np.iinfo(np.uint64).max


class StreamSource(ArraySource):
    """At most `rows` rows of a stream of unknown length, drawn uniformly without replacement, in random order.

    The stream is read once, to its end, when the source is made: only then is the number of rows known, and what is
    wrong with the stream is reported where it was passed. Every row gets a random key, and those with the smallest
    keys are kept, ordered by key. So any disjoint samples of this source are disjoint uniform samples of the stream,
    and the cuts between the chunks make no difference. While the stream passes by, memory is that of five times `rows`
    rows and a chunk; then that of `rows` rows.

    It pickles as the rows that it kept.

    Parameters
    ----------
    chunks : iterable of (k, D) array
        Real numbers; k may differ, D not, nor the names of columns, if the chunks are tables of pandas, polars or
        Arrow. A stream without a chunk gives a source of 0 rows and 0 columns.
    rows : int
        How many rows are kept: all, if the stream has no more.
    rng : int, numpy Generator or None
        The seed of the keys; None takes fresh entropy.

    Attributes
    ----------
    rows_seen : int
        The number of rows of the stream.

    Raises
    ------
    ValueError, TypeError
        If a chunk is not a (k, D) array of real numbers, or of another width than the first, or has other names; the
        message counts chunks from 0.
    """

    def __init__(
        self, chunks: Iterable[ArrayLike], rows: int = 200_000, rng: int | np.random.Generator | None = 0
    ) -> None:
        if not 1 <= (as_whole(rows) or 0) <= _MOST_ROWS:
            raise ValueError(f"rows must be a positive integer of at most {_MOST_ROWS:,}, got {shown(rows)}")
        reservoir, names, self.rows_seen = None, None, 0
        keys = np.random.default_rng(canonical_seed(rng))
        for chunk in _checked(chunks):
            reservoir, names = reservoir or _Reservoir(int(rows), chunk.width), chunk.names
            for piece in chunk.chunks(int(rows)):
                reservoir.add(piece, keys.integers(_LARGEST_KEY, size=len(piece), dtype=np.uint64, endpoint=True))
            self.rows_seen += len(chunk)
        super().__init__(np.empty((0, 0)) if reservoir is None else reservoir.in_order(), names)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)


class _Reservoir:
    """The rows with the smallest keys so far, among others, in a buffer of twice their number."""

    def __init__(self, most: int, width: int) -> None:
        self.most, self.filled, self.bound = most, 0, np.uint64(_LARGEST_KEY)
        self.rows, self.keys = np.empty((2 * most, width)), np.empty(2 * most, np.uint64)

    def add(self, rows: NDArray[np.float64], keys: NDArray[np.uint64]) -> None:
        """Take in at most `most` rows, without those that are known to have too large keys."""
        near = np.flatnonzero(keys <= self.bound)
        if self.filled + len(near) > len(self.keys):
            self._compact()
        end = self.filled + len(near)
        self.rows[self.filled : end], self.keys[self.filled : end] = rows[near], keys[near]
        self.filled = end

    def in_order(self) -> NDArray[np.float64]:
        """The rows kept, ordered by their keys."""
        return self.rows[np.argsort(self.keys[: self.filled], kind="stable")[: self.most]]

    def _compact(self) -> None:
        kept = np.argpartition(self.keys[: self.filled], self.most - 1)[: self.most]
        self.rows[: self.most], self.keys[: self.most] = self.rows[kept], self.keys[kept]
        self.filled, self.bound = self.most, self.keys[: self.most].max()


def _checked(chunks: Iterable[ArrayLike]) -> Iterator[ArraySource]:
    width, names = None, None
    for number, chunk in enumerate(iterable("chunks", chunks, "an iterable of arrays (k, D)")):
        try:
            checked = ArraySource(chunk)
        except (TypeError, ValueError) as error:
            raise type(error)(f"chunks[{number}]: {error}") from None
        if width is None:
            width, names = checked.width, checked.names
        if checked.width != width:
            raise ValueError(f"chunks[{number}] has {checked.width} columns where chunks[0] has {width}")
        if checked.names != names:
            raise ValueError(f"chunks[{number}] names its columns {checked.names}, chunks[0] {names}")
        yield checked
