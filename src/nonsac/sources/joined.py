"""Rows put together from several arrays of equal length."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.sources.array import ArraySource
from nonsac.sources.contract import About, Source
from nonsac.sources.mapped import Map
from nonsac.values.checks import listed
from nonsac.values.numeric import shown
from nonsac.values.quiet import as_doubles, quiet


class JoinedSource(Source):
    """Row i is row i of each of several arrays (n, d), side by side; only sampled rows are ever joined.

    Parameters
    ----------
    arrays : sequence of (n, d) array
        Neither copied nor converted whole.
    maps : sequence of callable or None, optional
        For each array, what its sampled rows pass through, from (k, d) to (k, d'): a camera's `normalise`, say. They
        travel to workers, so they must pickle.
    """

    def __init__(self, arrays: Sequence[ArrayLike], maps: Sequence[Map | None] | None = None) -> None:
        self.parts = [ArraySource(array) for array in listed("arrays", arrays, "a sequence of arrays (n, d)")]
        self.maps = (
            [None] * len(self.parts) if maps is None else listed("maps", maps, "a sequence of functions or None")
        )
        for move in self.maps:
            if move is not None and not callable(move):
                raise TypeError(f"maps must hold functions or None, got {shown(move)}")
        if not self.parts:
            raise ValueError("arrays must hold at least one array")
        if len(self.maps) != len(self.parts):
            raise ValueError(f"maps must hold one entry for each of {len(self.parts)} arrays, got {len(self.maps)}")
        lengths = {len(part) for part in self.parts}
        if len(lengths) > 1:
            raise ValueError(f"arrays must have equally many rows, got {', '.join(str(len(p)) for p in self.parts)}")

    @property
    def about(self) -> About:
        parts = [part.about for part in self.parts]
        return About(in_memory=any(part.in_memory for part in parts), run=min(part.run for part in parts))

    def __len__(self) -> int:
        return len(self.parts[0])

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        indices = self.checked(indices)
        return self._joined([part.pick(indices) for part in self.parts])

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        stop = len(self) if stop is None else min(stop, len(self))
        for first in range(start, stop, rows):
            yield self._joined([part.pick(slice(first, min(first + rows, stop))) for part in self.parts])

    @quiet
    def _joined(self, pieces: Sequence[NDArray[Any]]) -> NDArray[np.float64]:
        """Copied once, if nothing maps them."""
        mapped = [
            rows if move is None else move(as_doubles(rows)) for rows, move in zip(pieces, self.maps, strict=True)
        ]
        joined, end = np.empty((len(mapped[0]), sum(piece.shape[1] for piece in mapped))), 0
        for piece in mapped:  # by columns: NumPy is slow at rows of two or three numbers
            for column in range(piece.shape[1]):
                joined[:, end + column] = piece[:, column]
            end += piece.shape[1]
        return joined
