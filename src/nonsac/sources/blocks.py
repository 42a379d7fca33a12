"""Rows that come in blocks of which each can only be read whole: row groups of Parquet, compressed chunks."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.sources.contract import About, Source

_BLOCK_BYTES = 2 << 20


class BlockSource(Source):
    """What a source of blocks has in common with the others of its kind; it reads each block once for a call.

    Parameters
    ----------
    block_starts : (k + 1,) int64
        The first row of each of k blocks, from 0, and then the number of rows.
    width : int
        Number of columns, D.
    """

    def __init__(self, block_starts: NDArray[np.int64], width: int) -> None:
        self.block_starts = block_starts
        self.width = width

    @property
    def about(self) -> About:
        return About(blocks=self.block_starts)

    @abstractmethod
    def read_block(self, block: int) -> NDArray[np.float64]:
        """All rows of a block (k, D)."""

    def read_some(self, block: int, places: NDArray[np.int64] | slice) -> NDArray[np.float64]:
        """The rows at these places in a block (k, D); for kinds of data of which less than a block can be kept."""
        return self.read_block(block)[places]

    def __len__(self) -> int:
        return int(self.block_starts[-1])

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        indices = self.checked(indices)
        taken = np.empty((len(indices), self.width))
        order = np.argsort(indices, kind="stable")
        bounds = np.searchsorted(indices[order], self.block_starts)
        for block in np.flatnonzero(np.diff(bounds)):
            places = order[bounds[block] : bounds[block + 1]]
            taken[places] = self.read_some(int(block), indices[places] - self.block_starts[block])
        return taken

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        stop = len(self) if stop is None else min(stop, len(self))
        chunk, filled = np.empty((rows, self.width)), 0
        for piece in self._pieces(start, stop):
            while len(piece):
                count = min(rows - filled, len(piece))
                chunk[filled : filled + count] = piece[:count]
                piece, filled = piece[count:], filled + count
                if filled == rows:
                    yield chunk
                    chunk, filled = np.empty((rows, self.width)), 0
        if filled:
            yield chunk[:filled].copy()

    def _pieces(self, start: int, stop: int) -> Iterator[NDArray[np.float64]]:
        """What each block holds of a range of rows."""
        for block, (first, last) in enumerate(zip(self.block_starts[:-1], self.block_starts[1:], strict=True)):
            if max(start, first) < min(stop, last):
                yield self.read_some(block, slice(max(start - first, 0), stop - first))


class EvenBlockSource(BlockSource):
    """Blocks of equally many rows but for the last one; the block starts do not travel.

    Parameters
    ----------
    rows : int
        Number of rows in all.
    block_rows : int
        Rows in a block.
    width : int
        Number of columns, D.
    stored : int
        Bytes of all blocks, about.
    """

    def __init__(self, rows: int, block_rows: int, width: int, stored: int) -> None:
        self.rows, self.block_rows, self.stored = rows, block_rows, stored
        super().__init__(self._starts(), width)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "block_starts"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.block_starts = self._starts()

    def bounds(self, block: int) -> tuple[int, int]:
        """The first row of a block, and the first one after it."""
        return int(self.block_starts[block]), int(self.block_starts[block + 1])

    def bytes_to_take(self, rows: int) -> int:
        """What has to be read for so many random rows: all of the blocks that are likely to hold one."""
        missed = (1 - self.block_rows / max(self.rows, self.block_rows)) ** rows
        return round(self.stored * (1 - missed))

    def _starts(self) -> NDArray[np.int64]:
        return np.append(np.arange(0, self.rows, self.block_rows, dtype=np.int64), self.rows)


def block_rows(chunk_rows: int, width: int) -> int:
    """Rows of a block made of whole chunks: one, or as many as make 2 MiB of float64.

    Opening a file and finding a chunk takes about a millisecond, as long as decoding so much.
    """
    return chunk_rows * max(1, _BLOCK_BYTES // (8 * width) // chunk_rows)
