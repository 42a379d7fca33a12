"""Rows of datasets in HDF5 files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.errors import FilePath, not_held
from nonsac.files.hdf5 import open_hdf5
from nonsac.files.positioned import PositionedFile
from nonsac.sources.blocks import EvenBlockSource, block_rows
from nonsac.sources.columns import choose_columns, common_length, read_columns, real_dtype, split_columns
from nonsac.sources.records import Records, RecordSource, number_columns
from nonsac.sources.wrapped import WrappedSource

# A dataset, and the columns read from it.
Run = tuple[Any, list[int]]


class Hdf5Source(WrappedSource):
    """Rows of one or several datasets in an HDF5 file.

    Rows of contiguous datasets are read by themselves, those of chunked or compressed ones in blocks of whole chunks.

    Parameters
    ----------
    path : path
        The file.
    dataset : str or sequence of str
        Name of a dataset (n, D), or of several (n, d) or (n,) that stand side by side.
    columns : sequence of int or str, optional
        Positions of the columns in the order wanted, or names of datasets if all are (n,); by default all.

    Raises
    ------
    InputError
        If h5py is missing, the file cannot be read, is no HDF5 file, is truncated or damaged, holds no such datasets
        or columns or no real numbers; on reading also if it was changed in the meantime.
    """

    def __init__(
        self, path: FilePath, dataset: str | Sequence[str], columns: Sequence[int | str] | None = None
    ) -> None:
        file = PositionedFile(path)
        wanted = (dataset,) if isinstance(dataset, str) else tuple(dataset)
        with open_hdf5(file.name) as opened:
            datasets = [_find(file.name, opened, name) for name in wanted]
            shapes = [each.shape for each in datasets]
            count, widths = common_length(file.name, shapes)
            held = wanted if all(len(shape) == 1 for shape in shapes) else None
            chosen = choose_columns(file.name, columns, sum(widths), held)
            runs = [(datasets[number], picked) for number, picked in split_columns(chosen, widths)]
            rows = _contiguous(file, runs) or _Hdf5Blocks(file, count, runs)
        names = held and tuple(held[position] for position in chosen)
        super().__init__(rows, file.name, names, columns is not None)


def _contiguous(file: PositionedFile, runs: Sequence[Run]) -> RecordSource | None:
    """The columns as records, if all of them lie in the file as in memory."""
    parts = []
    for dataset, columns in runs:
        position = _position(dataset)
        if not position:
            return None
        size = dataset.dtype.itemsize * (dataset.shape[1] if dataset.ndim == 2 else 1)
        parts.append(Records(file, position, size, len(dataset), number_columns(dataset.dtype, columns)))
    return RecordSource(parts)


class _Hdf5Blocks(EvenBlockSource):
    def __init__(self, file: PositionedFile, count: int, runs: Sequence[Run]) -> None:
        self.file, self.columns = file, [(dataset.name, columns) for dataset, columns in runs]
        width = sum(len(columns) for _, columns in runs)
        chunk = max(dataset.chunks[0] if dataset.chunks else 1 for dataset, _ in runs)
        stored = sum({dataset.name: dataset.id.get_storage_size() for dataset, _ in runs}.values())
        super().__init__(count, block_rows(chunk, width), width, stored)

    def read_block(self, block: int) -> NDArray[np.float64]:
        first, last = self.bounds(block)
        self.file.check()
        with open_hdf5(self.file.path) as opened:
            pieces = [read_columns(opened[name], first, last, columns) for name, columns in self.columns]
        self.file.check()
        return np.hstack(pieces)


def _position(dataset: Any) -> int:
    """Where the numbers of a dataset lie in the file as NumPy has them in memory; 0 if they do not."""
    from h5py import h5t

    plain = dataset.chunks is None and not dataset.is_virtual and not dataset.external
    if not plain or not dataset.id.get_type().equal(h5t.py_create(dataset.dtype)):
        return 0
    return int(dataset.id.get_offset() or 0)


def _find(path: str, opened: Any, name: str) -> Any:
    found = opened.get(name)
    if not hasattr(found, "shape"):
        names: list[str] = []
        opened.visititems(lambda key, node: names.append(key) if hasattr(node, "shape") else None)
        raise not_held(path, f"dataset {name!r}", names)
    real_dtype(path, found.dtype, f"a dataset {name!r}")
    return found
