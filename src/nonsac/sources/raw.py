"""Rows of a binary file without a header."""

from __future__ import annotations

from numpy.typing import DTypeLike

from nonsac.files.claims import check_width
from nonsac.files.errors import FilePath, input_error
from nonsac.files.positioned import PositionedFile
from nonsac.sources.columns import real_dtype
from nonsac.sources.records import Records, RecordSource, number_columns
from nonsac.values.checks import whole_number

_MOST = 2**62


class RawSource(RecordSource):
    """Rows of numbers of one dtype, one row after the other, in a binary file that is never mapped or read whole.

    Parameters
    ----------
    path : path
        The file.
    dtype : dtype
        Of every number: any real one, of either byte order.
    width : int
        Numbers in a row, D.
    offset : int
        Bytes before the first row.
    rows : int, optional
        Number of rows; by default, all to the end of the file.

    Raises
    ------
    InputError
        If the file cannot be read or does not hold so many rows, or no whole number of them; on reading also if it
        was changed in the meantime.
    """

    def __init__(
        self, path: FilePath, dtype: DTypeLike, width: int, *, offset: int = 0, rows: int | None = None
    ) -> None:
        width, offset = whole_number("width", width, -_MOST, _MOST), whole_number("offset", offset, -_MOST, _MOST)
        rows = None if rows is None else whole_number("rows", rows, -_MOST, _MOST)
        if width < 1 or offset < 0 or (rows is not None and rows < 0):
            raise ValueError(f"width must be positive, offset and rows not negative; got {width}, {offset} and {rows}")
        file = PositionedFile(path)
        check_width(file.name, width)
        kind = real_dtype(file.name, dtype)
        size = width * kind.itemsize
        held, rest = divmod(max(file.size - offset, 0), size)
        if rows is None and (rest or not held):
            problem = f"its {file.size} bytes are no whole number of rows of {size} bytes after {offset} others"
            raise input_error(file.name, problem, "check dtype, width and offset")
        if rows is not None and rows > held:
            raise input_error(
                file.name, f"the file is truncated: it holds {held} rows of {rows}", "copy or save it again"
            )
        super().__init__(
            [Records(file, offset, size, held if rows is None else rows, number_columns(kind, range(width)))]
        )
