"""Where rows come from. A source owns the data and knows nothing of geometry."""

from nonsac.sources.all_pairs import AllPairsSource
from nonsac.sources.array import ArraySource
from nonsac.sources.contract import About, Source
from nonsac.sources.hdf5 import Hdf5Source
from nonsac.sources.held import HeldSource
from nonsac.sources.joined import JoinedSource
from nonsac.sources.las import LasSource
from nonsac.sources.mapped import MappedSource
from nonsac.sources.npy import NpySource
from nonsac.sources.parquet import ParquetSource
from nonsac.sources.raw import RawSource
from nonsac.sources.some_blocks import SomeBlocksSource
from nonsac.sources.stream import StreamSource
from nonsac.sources.without import WithoutRows
from nonsac.sources.zarr import ZarrSource

__all__ = [
    "About",
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
    "SomeBlocksSource",
    "Source",
    "StreamSource",
    "WithoutRows",
    "ZarrSource",
]
