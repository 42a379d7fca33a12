"""Rows of datasets in HDF5 files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.claims import check_expansion, check_width
from nonsac.files.errors import FilePath, not_held
from nonsac.files.hdf5 import Parts, nodes_of, open_hdf5
from nonsac.files.paths import changed, stamp_of
from nonsac.files.positioned import PositionedFile
from nonsac.files.records import truncated
from nonsac.sources.blocks import EvenBlockSource, block_rows
from nonsac.sources.columns import choose_columns, common_length, read_columns, real_dtype, split_columns
from nonsac.sources.records import Records, RecordSource, number_columns
from nonsac.sources.wrapped import WrappedSource

# A dataset, its name in the file, and the columns read from it.
Run = tuple[Any, str, list[int]]


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
        or columns or no real numbers, or parts of a dataset were never written, are missing or lie in files of another
        kind; on reading also if it was changed in the meantime.
    """

    def __init__(
        self, path: FilePath, dataset: str | Sequence[str], columns: Sequence[int | str] | None = None
    ) -> None:
        file = PositionedFile(path)
        wanted = (dataset,) if isinstance(dataset, str) else tuple(dataset)
        with open_hdf5(file.name) as opened:
            parts = Parts(file.name, [])
            datasets = [_find(parts, opened, name) for name in wanted]
            shapes = [each.shape for each in datasets]
            count, widths = common_length(file.name, shapes)
            check_width(file.name, sum(widths))
            held = wanted if all(len(shape) == 1 for shape in shapes) else None
            chosen = choose_columns(file.name, columns, sum(widths), held)
            runs = [(datasets[number], wanted[number], picked) for number, picked in split_columns(chosen, widths)]
            rows = _contiguous(file, opened, runs) or _Hdf5Blocks(file, count, runs, parts.others)
        names = held and tuple(held[position] for position in chosen)
        super().__init__(rows, file.name, names, columns is not None)


def _contiguous(file: PositionedFile, opened: Any, runs: Sequence[Run]) -> RecordSource | None:
    """The columns as records, if all of them lie in this file as in memory."""
    parts = []
    for dataset, name, columns in runs:
        position = _position(opened, dataset)
        if not position:
            return None
        size = dataset.dtype.itemsize * (dataset.shape[1] if dataset.ndim == 2 else 1)
        held = max(file.size - position, 0) // size
        if held < len(dataset):
            raise truncated(file.name, len(dataset), held, f"dataset {name!r}")
        parts.append(Records(file, position, size, len(dataset), number_columns(dataset.dtype, columns)))
    return RecordSource(parts)


class _Hdf5Blocks(EvenBlockSource):
    """Rows that h5py reads, perhaps also from other files that links or virtual datasets lead to."""

    def __init__(self, file: PositionedFile, count: int, runs: Sequence[Run], others: Sequence[str]) -> None:
        self.file, self.columns = file, [(name, columns) for _, name, columns in runs]
        self.others = [(path, stamp_of(path)) for path in sorted({os.path.abspath(path) for path in others})]
        width = sum(len(columns) for _, _, columns in runs)
        chunk = max(dataset.chunks[0] if dataset.chunks else 1 for dataset, _, _ in runs)
        stored = sum({name: dataset.id.get_storage_size() for dataset, name, _ in runs}.values())
        there = file.size + sum(stamp[0] for _, stamp in self.others if stamp)
        fix = "write it in smaller chunks"
        check_expansion(file.name, "a block of its chunks", min(chunk, count) * width, there, fix)
        super().__init__(count, block_rows(chunk, width), width, stored)

    def read_block(self, block: int) -> NDArray[np.float64]:
        first, last = self.bounds(block)
        self._check_unchanged()
        with open_hdf5(self.file.path) as opened:
            pieces = [read_columns(opened[name], first, last, columns) for name, columns in self.columns]
        self._check_unchanged()
        return np.hstack(pieces)

    def _check_unchanged(self) -> None:
        self.file.check()
        for path, stamp in self.others:
            if stamp_of(path) != stamp:
                raise changed(path)


def _position(opened: Any, dataset: Any) -> int:
    """Where the numbers of a dataset lie in the file as NumPy has them in memory; 0 if they do not."""
    from h5py import h5o, h5t

    # Behind a link into another file, the position is one in that file.
    here = h5o.get_info(dataset.id).fileno == h5o.get_info(opened.id).fileno
    plain = dataset.chunks is None and not dataset.is_virtual and not dataset.external
    if not here or not plain or not dataset.id.get_type().equal(h5t.py_create(dataset.dtype)):
        return 0
    return int(dataset.id.get_offset() or 0)


def _find(parts: Parts, opened: Any, name: str) -> Any:
    found = parts.find(opened, name)
    if not hasattr(found, "shape"):
        names = [key for key, node in nodes_of(opened) if hasattr(node, "shape")]
        raise not_held(parts.path, f"dataset {name!r}", names)
    real_dtype(parts.path, found.dtype, f"a dataset {name!r}")
    parts.check(found, name)
    return found
