"""Rows of a .npy file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib import format as npy

from nonsac.files.content import check_kind
from nonsac.files.errors import FilePath, input_error
from nonsac.files.positioned import PositionedFile
from nonsac.files.records import truncated
from nonsac.sources.columns import choose_columns, real_dtype
from nonsac.sources.records import Records, RecordSource, number_columns


class NpySource(RecordSource):
    """Rows of the array (n, D) in a .npy file, which is neither mapped nor read whole.

    Parameters
    ----------
    path : path
        The file, of any real dtype, in C or Fortran order; or of a structured dtype (n,) whose fields are the columns.
    columns : sequence of int or str, optional
        Positions of the columns, or names of fields, in the order wanted; by default all.

    Raises
    ------
    InputError
        If the file cannot be read, is no .npy file, is truncated, holds no such columns or no real numbers; on
        reading also if it was changed in the meantime.
    """

    def __init__(self, path: FilePath, columns: Sequence[int | str] | None = None) -> None:
        file = PositionedFile(path)
        check_kind(file.name, "NumPy array")
        header = _read_header(file.name)
        if header.dtype.names and len(header.shape) == 1:
            part, names = _fields(file, header, columns)
            super().__init__([part], names, columns is not None)
        else:
            super().__init__(_arrays(file, header, columns))
        held = (file.size - header.offset) // max(1, header.row_size)
        if held < len(self):
            raise truncated(file.name, len(self), held, "array")


@dataclass(frozen=True)
class _Header:
    offset: int
    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]

    @property
    def row_size(self) -> int:
        return self.dtype.itemsize * math.prod(self.shape[1:])


def _read_header(path: str) -> _Header:
    try:
        with open(path, "rb") as file:
            version = npy.read_magic(file)
            read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, fortran, dtype = read(file)
            header = _Header(file.tell(), shape, fortran, dtype)
    # NumPy passes on the errors of tokenize and of ast, which share no type.
    except Exception as error:
        raise input_error(path, f"is truncated or damaged ({error})", "copy or save the file again") from error
    if dtype.hasobject:
        raise input_error(path, "holds pickled objects, which are never loaded", "save plain numbers")
    if version >= (3, 0) and dtype.names:  # differs from version 2 in the encoding of the names alone
        dtype.names = tuple(name.encode("latin1").decode() for name in dtype.names)
    return header


def _arrays(file: PositionedFile, header: _Header, columns: Sequence[int | str] | None) -> list[Records]:
    kind = real_dtype(file.name, header.dtype, "an array")
    if len(header.shape) != 2 or not header.shape[1]:
        problem = f"holds an array of shape {header.shape} instead of (n, D)"
        raise input_error(file.name, problem, "save one row per line of the array")
    count, width = header.shape
    chosen = choose_columns(file.name, columns, width)
    if not header.fortran:
        return [Records(file, header.offset, header.row_size, count, number_columns(kind, chosen))]
    starts = [header.offset + position * count * kind.itemsize for position in chosen]
    return [Records(file, start, kind.itemsize, count, ((0, kind),)) for start in starts]


def _fields(
    file: PositionedFile, header: _Header, columns: Sequence[int | str] | None
) -> tuple[Records, tuple[str, ...]]:
    names = header.dtype.names or ()
    fields: Mapping[str, Any] = header.dtype.fields or {}
    chosen = tuple(names[position] for position in choose_columns(file.name, columns, len(names), names))
    formats = tuple((fields[name][1], real_dtype(file.name, fields[name][0], f"a field {name!r}")) for name in chosen)
    return Records(file, header.offset, header.row_size, header.shape[0], formats), chosen
