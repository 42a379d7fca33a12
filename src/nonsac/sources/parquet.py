"""Rows of Parquet and Arrow files, of which a block, a row group or a record batch, is read at a time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.claims import check_expansion
from nonsac.files.errors import FilePath, input_error, library_missing, not_held
from nonsac.files.paths import Stamp, changed, file_errors, is_url, listed_files, open_file, stamp_of
from nonsac.sources.blocks import BlockSource
from nonsac.sources.contract import About

SUFFIXES = (".parquet", ".pq", ".parq", ".arrow", ".feather", ".ipc")
_MARK_OF_ARROW = b"ARROW1"
_NAMES_SHOWN = 20
_AT_ONCE = 8  # footers, which are far away if there are many


class ParquetSource(BlockSource):
    """Rows of one or many Parquet or Arrow (Feather) files; only the wanted columns of the blocks needed are read.

    Opening reads the footers of the files, and taking rows the row groups (Parquet) or record batches (Arrow) that
    hold them, one after the other: memory is that of one of these, with the columns wanted. It pickles as the names of
    the files and the numbers of rows of their blocks, and opens the files where it is used.

    Parameters
    ----------
    paths : path, URL or sequence of them
        A file, a folder (of its files at any depth those that end in .parquet, .arrow, .feather and the like; or all,
        if none does), a pattern with `*`, or several of these, here or at any URL that fsspec knows (`s3://...`).
        Rows are numbered through the files in this order, within a folder or pattern by name.
    columns : sequence of str or int, optional
        Names of columns, or their positions in the first file, in the order of the rows wanted; by default all columns
        of numbers that the first file has, without the index that pandas adds. All files must have them. Integers and
        floating-point numbers of any size are read as float64; what is missing is NaN.

    Attributes
    ----------
    names : tuple of str
        Of the columns, in the order of the rows.
    other_columns : dict of str to str
        Of the first file: the columns that are not read by default, and what is wrong with them.

    Raises
    ------
    InputError
        If a file cannot be read, is of another kind, truncated or damaged, or lacks a column; also while rows are
        taken, if a file was changed since. The message names the file.
    """

    def __init__(self, paths: FilePath | Sequence[FilePath], columns: Sequence[str | int] | None = None) -> None:
        files = listed_files(paths, SUFFIXES)
        self.paths = [path if is_url(path) else os.path.abspath(path) for path in files]  # workers may be elsewhere
        _import_pyarrow(files[0])
        first = _read_footer(files[0], lambda schema: _chosen(files[0], schema, columns))
        self.names, self.chosen, self.other_columns = first.names, columns is not None, first.others
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            others = pool.map(lambda path: _read_footer(path, lambda _: self.names), files[1:])
            footers = [first, *others]
        rows = [count for footer in footers for count in footer.block_rows]
        super().__init__(np.array([0, *accumulate(rows)], np.int64), len(self.names))
        self._first_blocks = np.array([0, *accumulate(len(footer.block_rows) for footer in footers)], np.int64)
        self._stamps = [footer.stamp for footer in footers]
        self._bytes = {name: sum(footer.bytes[name] for footer in footers) for name in self.names}

    @property
    def about(self) -> About:
        return About(None if self.chosen else self.names, self.block_starts)

    def narrowed(self, columns: Sequence[int]) -> ParquetSource:
        """The same rows with only these columns, of which no others are read."""
        narrowed = copy(self)
        narrowed.names, narrowed.width = tuple(self.names[column] for column in columns), len(columns)
        narrowed.other_columns, narrowed._bytes = {}, {name: self._bytes[name] for name in narrowed.names}
        return narrowed

    def bytes_to_take(self, rows: int) -> int:
        """How many bytes are read for so many random rows, about: those of the blocks that hold one of them."""
        sizes = np.diff(self.block_starts)
        missed = (1.0 - sizes / max(len(self), 1)) ** rows
        bytes_per_row = sum(self._bytes[name] for name in self.names) / max(len(self), 1)
        return round(bytes_per_row * float(sizes @ (1.0 - missed)))

    def read_block(self, block: int) -> NDArray[np.float64]:
        return self.read_some(block, slice(None))

    def read_some(self, block: int, places: NDArray[np.int64] | slice) -> NDArray[np.float64]:
        file = int(np.searchsorted(self._first_blocks, block, side="right")) - 1
        path = self.paths[file]
        self._check_unchanged(file)
        expected = int(self.block_starts[block + 1] - self.block_starts[block])
        count = len(range(expected)[places]) if isinstance(places, slice) else len(places)
        rows = np.empty((count, self.width))
        with _opened(path) as opened:
            for place, name in enumerate(self.names):  # one at a time: Arrow holds what it reads and what it decodes
                column = opened.read_column(block - int(self._first_blocks[file]), name, expected)
                if len(column) != expected:
                    raise changed(path)
                rows[:, place] = column[places]
        self._check_unchanged(file)
        return rows

    def _check_unchanged(self, file: int) -> None:
        if stamp_of(self.paths[file]) != self._stamps[file]:
            raise changed(self.paths[file])


@dataclass(frozen=True)
class _Footer:
    """What is known of a file without reading any row, of the wanted columns and of those that hold no numbers."""

    names: tuple[str, ...]
    others: dict[str, str]
    block_rows: list[int]
    bytes: dict[str, float]
    stamp: Stamp | None


class _ParquetFile:
    """An open Parquet file; its blocks are row groups."""

    def __init__(self, file: Any) -> None:
        from pyarrow import parquet  # type: ignore[import-untyped,unused-ignore]

        self._file, self.size = parquet.ParquetFile(file), file.size()
        self.schema = self._file.schema_arrow

    def block_rows(self) -> list[int]:
        return [self._file.metadata.row_group(block).num_rows for block in range(self._file.num_row_groups)]

    def read_column(self, block: int, name: str, rows: int) -> Any:
        # Columns are read batch by batch, as one may go on for ever; a row more than there should be is enough.
        # Threads of Arrow that call into Python, to read a URL, would abort a process that ends meanwhile.
        batches = self._file.iter_batches(max(rows, 1) + 1, [block], [name], use_threads=False)
        read, found = [], 0
        for batch in batches:
            read.append(batch.column(0).to_numpy(zero_copy_only=False))
            found += len(batch)
            if found > rows:
                break
        return read[0] if len(read) == 1 else np.concatenate([np.empty(0), *read])


class _ArrowFile:
    """An open Arrow file (Feather, version 2); its blocks are record batches."""

    def __init__(self, file: Any) -> None:
        from pyarrow import ipc  # type: ignore[import-untyped,unused-ignore]

        self._file, self._ipc, self.size = file, ipc, file.size()
        self.schema = self._reader().schema

    def block_rows(self) -> list[int]:
        reader = self._reader([0])  # lengths are not in the footer: the least that tells them
        return [reader.get_batch(block).num_rows for block in range(reader.num_record_batches)]

    def read_column(self, block: int, name: str, rows: int) -> Any:
        batch = self._reader([self.schema.get_field_index(name)]).get_batch(block)
        batch.validate()  # lengths are claims: it looks whether the bytes are there
        return batch.column(0).to_numpy(zero_copy_only=False)

    def _reader(self, fields: Sequence[int] = ()) -> Any:
        return self._ipc.open_file(
            self._file, options=self._ipc.IpcReadOptions(included_fields=list(fields), use_threads=False)
        )


@contextmanager
def _opened(path: str) -> Iterator[Any]:
    """The file, of the kind that its first bytes say."""
    from pyarrow import OSFile, PythonFile

    with file_errors(path), PythonFile(open_file(path), "r") if is_url(path) else OSFile(path) as file:
        head = file.read(len(_MARK_OF_ARROW))
        if not head:
            raise input_error(path, "the file is empty", "write or copy it again")
        if head != _MARK_OF_ARROW and not head.startswith(b"PAR1"):
            raise input_error(
                path, "is neither a Parquet nor an Arrow file", "give Parquet, Arrow or Feather files only"
            )
        file.seek(0)
        kind = _ArrowFile if head == _MARK_OF_ARROW else _ParquetFile
        yield kind(file)


def _read_footer(path: str, choose: Callable[[Any], tuple[str, ...]]) -> _Footer:
    """What is known of a file, from one opening; `choose` says which columns of a schema are wanted."""
    stamp = stamp_of(path)
    with _opened(path) as file:
        names = choose(file.schema)
        _check_columns(path, file.schema, names)
        rows, size = file.block_rows(), file.size
        if min(rows, default=0) < 0:
            raise input_error(path, "is damaged: it promises a negative number of rows", "copy or save it again")
        fix = "save it with smaller row groups"
        check_expansion(path, "its largest block of rows", max(rows, default=0) * len(names), size, fix)
        return _Footer(names, _faults(file.schema), rows, _bytes_of(file.schema, names, sum(rows), size), stamp)


def _bytes_of(schema: Any, names: Sequence[str], rows: int, size: int) -> dict[str, float]:
    """About what each column takes up in a file.

    Footers of Parquet tell it exactly; but if they are damaged, to ask for it ends the process.
    """
    sizes = {field.name: _bytes_in(field.type) for field in schema}
    shares = {name: size * sizes[name] / sum(sizes.values()) for name in names}
    return {name: min(share, 1.25 * rows * sizes[name]) for name, share in shares.items()}


def _bytes_in(kind: Any) -> float:
    """Bytes of a value; sixteen of one that may have any number."""
    try:
        return float(kind.bit_width / 8)
    except ValueError:
        return 16.0


def _faults(schema: Any) -> dict[str, str]:
    """What is wrong with the columns that do not hold numbers."""
    others = [field for field in schema if not _is_number(schema, field.name)]
    twice = {field.name: len(schema.get_all_field_indices(field.name)) > 1 for field in others}
    return {f.name: "is there several times" if twice[f.name] else f"holds {f.type}, not numbers" for f in others}


def _chosen(path: str, schema: Any, columns: Sequence[str | int] | None) -> tuple[str, ...]:
    """The names of the columns wanted, of which some may be given by their positions in the first file."""
    if columns is None:
        numbers = [name for name in schema.names if _is_number(schema, name) and not name.startswith("__index_level_")]
        if not numbers:
            raise input_error(path, "holds no columns of numbers", "save integers or floating-point numbers")
        return tuple(numbers)
    if isinstance(columns, str) or not columns:
        raise ValueError(f"columns must be a sequence of names or positions, got {columns!r}")
    names = tuple(_name_of(path, schema.names, column) for column in columns)
    if len(set(names)) < len(names):
        raise ValueError(f"columns must be different ones, got {', '.join(names)}")
    return names


def _name_of(path: str, names: Sequence[str], column: str | int) -> str:
    if isinstance(column, str):
        return column
    if not 0 <= column < len(names):
        raise not_held(path, f"column {column}, counted from 0", names, _NAMES_SHOWN)
    return names[column]


def _check_columns(path: str, schema: Any, columns: Sequence[str]) -> None:
    for name in columns:
        count = len(schema.get_all_field_indices(name))
        if count == 0:
            raise not_held(path, f"column {name!r}", schema.names, _NAMES_SHOWN)
        if count > 1:
            raise input_error(path, f"holds {count} columns {name!r}", "give each its own name")
        if not _is_number(schema, name):
            problem = f"column {name!r} holds {schema.field(name).type}, not numbers"
            fix = "save integers or floating-point numbers, or choose other columns"
            raise input_error(path, f"{problem} (it holds {', '.join(schema.names[:_NAMES_SHOWN])})", fix)


def _is_number(schema: Any, name: str) -> bool:
    from pyarrow import types

    index = schema.get_field_index(name)  # -1 if there are several, too
    if index < 0:
        return False
    kind = schema.field(index).type
    return bool(types.is_integer(kind) or types.is_floating(kind))


def _import_pyarrow(path: FilePath) -> Any:
    try:
        import pyarrow  # type: ignore[import-untyped,unused-ignore]
    except ImportError as error:
        raise library_missing(path, "Parquet and Arrow files", "pyarrow", "parquet") from error
    return pyarrow
