"""Files whose rows lie open to any reading or come in blocks, whichever way they were written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nonsac.sources.blocks import EvenBlockSource
from nonsac.sources.contract import About, Source
from nonsac.sources.records import RecordSource


class WrappedSource(Source):
    """The rows of another source, which come in blocks or not.

    Parameters
    ----------
    rows : source
        Where they come from.
    path : str
        The file they lie in.
    names : tuple of str, optional
        What the columns are called.
    chosen : bool
        Whether the user chose them, so that they are taken in order, whatever their names.
    """

    def __init__(
        self, rows: RecordSource | EvenBlockSource, path: str, names: tuple[str, ...] | None, chosen: bool = False
    ) -> None:
        self._rows, self.path, self.names, self.chosen, self.width = rows, path, names, chosen, rows.width

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.path!r}: {len(self)} x {self.width})"

    @property
    def about(self) -> About:
        return replace(self._rows.about, names=None if self.chosen else self.names)

    def bytes_to_take(self, rows: int) -> int:
        return self._rows.bytes_to_take(rows)

    def __len__(self) -> int:
        return len(self._rows)

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        return self._rows.take(indices)

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        return self._rows.chunks(rows, start, stop)
