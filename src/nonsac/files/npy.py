"""The header of an array in NumPy's format, in a file of its own or in an archive."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from io import BytesIO
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

from nonsac.files.claims import check_shape
from nonsac.files.errors import FilePath, input_error

# NumPy itself refuses headers of more than 10,000 bytes.
HEAD_LENGTH = 16384


@dataclass(frozen=True)
class NpyHeader:
    """Where the numbers of an array start, and how they lie."""

    offset: int
    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]

    @property
    def row_size(self) -> int:
        """Bytes of the numbers that have the same first index."""
        return self.dtype.itemsize * math.prod(self.shape[1:])

    @property
    def rows(self) -> int:
        """Number of rows, 1 for a single number."""
        return self.shape[0] if self.shape else 1

    def rows_in(self, size: int) -> int:
        """How many of its rows lie whole in a file of so many bytes."""
        return min(self.rows, (size - self.offset) // self.row_size) if self.row_size else self.rows


def read_npy_head(file: IO[bytes]) -> bytes:
    """Read as many bytes as the header has, and no more than it may have."""
    head = file.read(12)
    size = int.from_bytes(head[8:10] if head[6:7] == b"\1" else head[8:12], "little")
    return head + file.read(min(size, HEAD_LENGTH))


def parse_npy_header(path: FilePath, head: bytes) -> NpyHeader:
    """Read the header of an array from the first bytes of its file, at least those of `read_npy_head`.

    Raises
    ------
    InputError
        If it is damaged, names a shape that no array has, or says that the array holds objects.
    """
    file = BytesIO(head)
    try:
        # NumPy warns if Python 2 has written the header.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            version = npy.read_magic(file)
            read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, fortran, dtype = read(file)
    # NumPy passes on the errors of tokenize and of ast, which share no type.
    except Exception as error:
        raise input_error(path, f"is truncated or damaged ({error})", "copy or save the file again") from error
    if dtype.hasobject:
        raise input_error(path, "holds pickled objects, which are never loaded", "save plain numbers")
    if version >= (3, 0) and dtype.names:  # differs from version 2 in the encoding of the names alone
        dtype.names = tuple(name.encode("latin1").decode() for name in dtype.names)
    return NpyHeader(file.tell(), check_shape(path, shape), fortran, dtype)
