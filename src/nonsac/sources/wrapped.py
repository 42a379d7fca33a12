"""Files whose rows lie open to any reading or come in blocks, whichever way they were written."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.sources.blocks import EvenBlockSource
from nonsac.sources.records import RecordSource


class WrappedSource:
    """The rows of another source, which has block starts or not.

    Parameters
    ----------
    rows : source
        Where they come from.
    path : str
        The file they lie in.
    names : tuple of str, optional
        What the columns are called.
    """

    def __init__(self, rows: RecordSource | EvenBlockSource, path: str, names: tuple[str, ...] | None) -> None:
        self._rows, self.path, self.names = rows, path, names

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.path!r}: {len(self)} x {self.width})"

    def __getattr__(self, name: str) -> Any:
        if name in ("block_starts", "bytes_to_take"):
            return getattr(self._rows, name)
        raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")

    @property
    def width(self) -> int:
        return self._rows.width

    def __len__(self) -> int:
        return len(self._rows)

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        return self._rows.take(indices)

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        return self._rows.chunks(rows, start, stop)
