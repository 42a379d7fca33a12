"""Rows of a .npy file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from nonsac.files.claims import check_width
from nonsac.files.content import check_kind, unreadable
from nonsac.files.errors import FilePath, input_error
from nonsac.files.npy import NpyHeader, parse_npy_header, read_npy_head
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
        # Before anything is made for every row or column.
        held = header.rows_in(file.size)
        if held < header.rows:
            raise truncated(file.name, header.rows, held, "array")
        if header.dtype.names and len(header.shape) == 1:
            part, names = _fields(file, header, columns)
            super().__init__([part], names, columns is not None)
        else:
            super().__init__(_arrays(file, header, columns))


def _read_header(path: str) -> NpyHeader:
    try:
        with open(path, "rb") as file:
            head = read_npy_head(file)
    except OSError as error:
        raise unreadable(path, error) from error
    return parse_npy_header(path, head)


def _arrays(file: PositionedFile, header: NpyHeader, columns: Sequence[int | str] | None) -> list[Records]:
    kind = real_dtype(file.name, header.dtype, "an array")
    if len(header.shape) != 2 or not header.shape[1]:
        problem = f"holds an array of shape {header.shape} instead of (n, D)"
        raise input_error(file.name, problem, "save one row per line of the array")
    count, width = header.shape
    check_width(file.name, width)
    chosen = choose_columns(file.name, columns, width)
    if not header.fortran:
        return [Records(file, header.offset, header.row_size, count, number_columns(kind, chosen))]
    starts = [header.offset + position * count * kind.itemsize for position in chosen]
    return [Records(file, start, kind.itemsize, count, ((0, kind),)) for start in starts]


def _fields(
    file: PositionedFile, header: NpyHeader, columns: Sequence[int | str] | None
) -> tuple[Records, tuple[str, ...]]:
    names = header.dtype.names or ()
    fields: Mapping[str, Any] = header.dtype.fields or {}
    chosen = tuple(names[position] for position in choose_columns(file.name, columns, len(names), names))
    formats = tuple((fields[name][1], real_dtype(file.name, fields[name][0], f"a field {name!r}")) for name in chosen)
    return Records(file, header.offset, header.row_size, header.shape[0], formats), chosen
