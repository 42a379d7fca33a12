"""What a source has to do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray


@runtime_checkable
class Source(Protocol):
    """A table of rows, read a few at a time.

    Sources travel to workers, so a source pickles as a cheap description and opens what it needs where it runs.

    A source may have, besides:

    - `block_starts`, (k + 1,) int64 from 0 to `len(source)`: where its rows come in k blocks that can only be read
      whole (row groups, compressed chunks). Rows are then asked for in as few calls as possible.
    - `in_memory`: true where its rows travel with it; workers elsewhere are then sent those of their sample only.
    - `bytes_to_take(rows)`: how many bytes are read for so many random rows, about.
    """

    @property
    def width(self) -> int:
        """Number of columns, D."""
        ...

    def __len__(self) -> int: ...

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        """The rows with these numbers: a fresh, writable, C-order float64 array (len(indices), D)."""
        ...

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        """The rows `start` to `stop - 1`, by default all, in order, at most `rows` of them at a time."""
        ...
