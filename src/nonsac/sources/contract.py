"""What a source has to do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nonsac.layouts import Array

_NUMBER = 8  # bytes


@dataclass(frozen=True, eq=False)
class About:
    """What a source says of itself without reading a row.

    Attributes
    ----------
    names : tuple of str or None
        What the columns are called, if calls are to find theirs by name. None if they have no names, and if the user
        chose them: then they are taken in order.
    blocks : (k + 1,) int64 or None
        If rows come in k blocks that can only be read whole (row groups, compressed chunks): the first row of each,
        from 0, and then the number of rows. They are then asked for in as few calls as possible.
    in_memory : bool
        Whether its rows travel with it; workers elsewhere are then sent those of their sample only.
    keeps_rows : bool
        Whether it keeps what it reads, so that rows that will be asked for are better read at once (`Source.hold`).
    run : int
        If rows can be read one by one: how many neighbours are read about as fast as one, from a disk say; 1 if that
        makes no difference. Rows are drawn from runs of so many with draw="blocks".
    """

    names: tuple[str, ...] | None = None
    blocks: NDArray[np.int64] | None = None
    in_memory: bool = False
    keeps_rows: bool = False
    run: int = 1

    @property
    def largest_block(self) -> int:
        """Rows of the largest block; 0 if rows can be read one by one."""
        return 0 if self.blocks is None else int(np.diff(self.blocks).max(initial=0))


class Source(ABC):
    """A table of rows, read a few at a time; derive a class from it to add a kind of data.

    `take` and the length are needed; everything else has a default. Sources travel to workers, so a source pickles as
    a cheap description, and opens what it needs where it runs.
    """

    @cached_property
    def width(self) -> int:
        """Number of columns, D; may be set as an attribute. By default that of `take` of no rows."""
        rows = self.take(np.empty(0, np.int64))
        if np.ndim(rows) != 2:
            name = type(self).__name__
            raise TypeError(
                f"{name}.take gave an array of shape {np.shape(rows)}; a source gives (k, D) for k row numbers"
            )
        return int(rows.shape[1])

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def take(self, indices: NDArray[np.int64]) -> Array:
        """The rows with these numbers: a fresh, writable, C-order float64 array (len(indices), D).

        Raises
        ------
        IndexError
            If there is no such row; `checked` does that.
        """

    # --- what has a default ----------------------------------------------------------------

    @property
    def about(self) -> About:
        """What is known of the source without reading it."""
        return About()

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[Array]:
        """The rows `start` to `stop - 1`, by default all, in order, at most `rows` of them at a time."""
        stop = len(self) if stop is None else min(stop, len(self))
        for first in range(start, stop, rows):
            yield self.take(np.arange(first, min(first + rows, stop), dtype=np.int64))

    def narrowed(self, columns: Sequence[int]) -> Source:
        """The same rows with only these columns, by position, in this order."""
        from nonsac.sources.mapped import ColumnMap, MappedSource

        return MappedSource(self, ColumnMap(tuple(columns)))

    def bytes_to_take(self, rows: int) -> int:
        """How many bytes are read for so many random rows, about; 0 if they are in memory."""
        return 0 if self.about.in_memory else _NUMBER * self.width * rows

    def hold(self, indices: NDArray[np.int64]) -> None:
        """Read rows that will be asked for, if the source keeps what it reads; by default nothing."""
        return None

    # --- what follows from the above -------------------------------------------------------

    def checked(self, indices: NDArray[np.int64]) -> NDArray[np.int64]:
        """The row numbers, if there are such rows; else an IndexError."""
        indices, count = np.asarray(indices, np.int64), len(self)
        if len(indices) and not 0 <= indices.min() <= indices.max() < count:
            worst = indices.min() if indices.min() < 0 else indices.max()
            raise IndexError(f"there is no row {worst}: rows are numbered from 0 to {count - 1}")
        return indices
