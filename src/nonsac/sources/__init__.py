"""Where rows come from. A source owns the data and knows nothing of geometry."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from nonsac.sources.all_pairs import AllPairsSource
from nonsac.sources.array import ArraySource
from nonsac.sources.held import HeldSource
from nonsac.sources.joined import JoinedSource
from nonsac.sources.mapped import MappedSource

if TYPE_CHECKING:
    from nonsac.sources.hdf5 import Hdf5Source
    from nonsac.sources.las import LasSource
    from nonsac.sources.npy import NpySource
    from nonsac.sources.parquet import ParquetSource
    from nonsac.sources.raw import RawSource
    from nonsac.sources.stream import StreamSource
    from nonsac.sources.zarr import ZarrSource

__all__ = [
    "AllPairsSource",
    "ArraySource",
    "Hdf5Source",
    "HeldSource",
    "JoinedSource",
    "LasSource",
    "MappedSource",
    "NpySource",
    "ParquetSource",
    "RawSource",
    "Source",
    "StreamSource",
    "ZarrSource",
]

_OF_FILES = {
    "Hdf5Source": "hdf5",
    "LasSource": "las",
    "NpySource": "npy",
    "ParquetSource": "parquet",
    "RawSource": "raw",
    "StreamSource": "stream",
    "ZarrSource": "zarr",
}


def __getattr__(name: str) -> Any:
    """Import on first use what reads files and streams."""
    if name in _OF_FILES:
        return getattr(import_module(f"nonsac.sources.{_OF_FILES[name]}"), name)
    raise AttributeError(f"module 'nonsac.sources' has no attribute {name!r}")


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
