"""Write a table of numbers of any length, block by block."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from nonsac.files.atomic import check_target, write_atomically
from nonsac.files.errors import FilePath, input_error
from nonsac.files.parquet import import_parquet
from nonsac.files.paths import choose_by_suffix

Blocks = Iterable[NDArray[Any]]


def write_rows(
    path: FilePath,
    columns: Sequence[str],
    n: int,
    dtype: DTypeLike,
    blocks: Blocks,
    row_group: int = 1_000_000,
) -> None:
    """Write n rows to an NPY or Parquet file; the file appears when it is whole.

    Parameters
    ----------
    path
        A file that ends in .npy (an array of shape (n, d)) or .parquet (d columns).
    columns
        Names of the d columns, for Parquet.
    n
        Number of rows.
    dtype
        float32 or float64.
    blocks
        Arrays of shape (k, d), together n rows; one is held at a time.
    row_group
        Rows in each row group of a Parquet file: what a reader holds at a time, and so does this.

    Raises
    ------
    InputError
        If the suffix is unknown, pyarrow is missing, or the file cannot be written, for want of space say.
    """
    write = choose_by_suffix(path, _WRITERS)
    write_atomically(path, lambda temporary: write(temporary, columns, n, np.dtype(dtype), blocks, row_group))


def check_rows_target(path: FilePath, columns: int, n: int, dtype: DTypeLike) -> None:
    """Check that so many rows can be written to a file, before they are made.

    Raises
    ------
    InputError
        If the suffix is unknown, pyarrow is missing, the folder cannot be written to or has not enough space.
    """
    choose_by_suffix(path, _WRITERS)
    if Path(path).suffix.lower() == ".parquet":
        import_parquet(path)
    check_target(path)
    needed = n * columns * np.dtype(dtype).itemsize
    free = shutil.disk_usage(Path(path).resolve().parent).free
    if needed > free:
        problem = f"needs {needed / 1e9:.3g} GB, and {free / 1e9:.3g} GB are free there"
        raise input_error(path, problem, "make room, or write fewer rows")


def _write_npy(
    path: Path, columns: Sequence[str], n: int, dtype: np.dtype[Any], blocks: Blocks, row_group: int
) -> None:
    with path.open("wb") as file:
        header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": (n, len(columns))}
        np.lib.format.write_array_header_1_0(file, header)
        for block in blocks:
            file.write(np.ascontiguousarray(block, dtype).data)


def _write_parquet(
    path: Path, columns: Sequence[str], n: int, dtype: np.dtype[Any], blocks: Blocks, row_group: int
) -> None:
    import pyarrow as pa
    from pyarrow.parquet import ParquetWriter

    schema = pa.schema([(name, pa.from_numpy_dtype(dtype)) for name in columns])
    # Numbers with noise in their last digits neither repeat nor compress.
    with ParquetWriter(path, schema, compression="none", use_dictionary=False) as writer:
        for group in _regrouped(blocks, row_group):
            arrays = [pa.array(np.ascontiguousarray(column, dtype)) for column in group.T]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema), row_group_size=row_group)


def _regrouped(blocks: Blocks, size: int) -> Iterator[NDArray[Any]]:
    """The same rows in arrays of `size` rows; the last one may be shorter."""
    parts: list[NDArray[Any]] = []
    held = 0
    for block in blocks:
        while held + len(block) >= size:
            taken = size - held
            yield np.concatenate([*parts, block[:taken]])
            parts, held, block = [], 0, block[taken:]
        parts.append(block)
        held += len(block)
    if held:
        yield np.concatenate(parts)


_WRITERS = {".npy": _write_npy, ".parquet": _write_parquet}
