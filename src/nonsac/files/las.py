"""Read the points of LAS and LAZ files."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import accumulate
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nonsac.files.claims import check_expansion, size_of
from nonsac.files.content import check_kind
from nonsac.files.errors import FilePath, InputError, input_error, library_missing
from nonsac.files.records import truncated
from nonsac.values.quiet import quiet

_POINTS_AT_ONCE = 500_000
_SHORTEST_HEADER, _RECORD_HEADER = 227, 54  # bytes
_LAYERED, _NO_FIXED_CHUNK, _LONGEST_CHUNK = 3, 2**32 - 1, 2 * 10**6
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_PANIC = "PanicException"


@quiet
def read_las(path: FilePath) -> NDArray[np.float64]:
    """Read the points of a LAS or LAZ file, in the units of its coordinate system.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    ndarray of float64, shape (n, 3)
        The points, scaled and moved as the file says.

    Raises
    ------
    InputError
        If laspy is missing, or the file cannot be read, is no LAS file, is truncated or damaged.
    """
    with open_las(path) as reader:
        points, found = np.empty((reader.header.point_count, 3)), 0
        for piece in reader.chunk_iterator(_POINTS_AT_ONCE):
            if not len(piece):
                break
            points[found : found + len(piece)] = stored_coordinates(piece)
            found += len(piece)
        points *= reader.header.scales
        points += reader.header.offsets
    if found < len(points):
        raise truncated(path, len(points), found)
    return points


class _Item(NamedTuple):
    """A part of a point that is compressed by itself."""

    kind: int
    size: int


class _Compression:
    """What the record of the compression says of a LAZ file."""

    def __init__(self, record: bytes) -> None:
        self.record = record
        kind, points, count = struct.unpack_from("<H10xI16xH", record)
        items = [struct.unpack_from("<HH", record, 34 + 6 * item) for item in range(count)]
        self.items, self.is_layered = [_Item(*item) for item in items], kind == _LAYERED
        self.chunk_points = 0 if points == _NO_FIXED_CHUNK else points

    @property
    def layers(self) -> int:
        """How many layers a chunk has; one for each of the bytes that are no part of the format."""
        return sum(_LAYERS.get(item.kind, item.size) for item in self.items)


@contextmanager
def open_las(path: FilePath, single_threaded: bool = False) -> Iterator[Any]:
    """Open a LAS or LAZ file as a reader of laspy.

    Parameters
    ----------
    path
        The file.
    single_threaded
        Decompress without further threads, which would not survive a fork.

    Raises
    ------
    InputError
        If laspy is missing, or the file cannot be read, is no LAS file, is truncated or damaged; within the block,
        too.
    """
    laspy = _import_laspy(path)
    _check_records(path, check_kind(path, "LAS file"))
    backends = laspy.LazBackend.detect_available()
    if single_threaded:
        backends = tuple(backend for backend in backends if backend != laspy.LazBackend.LazrsParallel)
    try:
        with laspy.open(path, laz_backend=backends, read_evlrs=False) as reader:
            _check_points(path, reader.header)
            yield reader
    except InputError:
        raise
    # laspy passes on the errors of struct, NumPy and its LAZ library, which share no type; a panic of the library is
    # not even an Exception.
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != _PANIC:
            raise
        if not backends and "Laz" in str(error):
            raise _laspy_missing(path) from error
        problem = f"is truncated or damaged ({error})"
        raise input_error(path, problem, "copy or export the file again") from error


def _check_records(path: FilePath, head: bytes) -> None:
    """Check what the header says of itself and the records behind it, of which laspy would read any number."""
    if len(head) < _SHORTEST_HEADER:
        raise _damaged(path, "its header is too short")
    header_size, offset, records = struct.unpack_from("<HII", head, 94)
    size = size_of(path)
    if not _SHORTEST_HEADER <= header_size <= offset <= size:
        raise _damaged(path, f"its points start at byte {offset} of {size}")
    if records * _RECORD_HEADER > offset - header_size:
        raise _damaged(path, f"{records} records do not fit into {offset - header_size} bytes before its points")


def _check_points(path: FilePath, header: Any) -> None:
    """Check that the points of the header can be there."""
    count, size, stored = header.point_count, header.point_format.size, size_of(path)
    if not header.are_points_compressed:
        held = (stored - header.offset_to_point_data) // size
        if held < count:
            raise truncated(path, count, held)
        return
    compression = _Compression(header.vlrs.get("LasZipVlr")[0].record_data)
    if sum(item.size for item in compression.items) != size or compression.chunk_points > max(count, _LONGEST_CHUNK):
        raise _damaged(path, f"the record of the compression does not fit its {count} points of {size} bytes")
    numbers = count * max(size, 24) // 8
    check_expansion(path, f"its {count} points", numbers, stored, "copy it again, or export it as .las")
    with open(path, "rb") as file:
        _check_chunks(path, file, header, compression)


def _check_chunks(path: FilePath, file: BinaryIO, header: Any, compression: _Compression) -> None:
    """Check the numbers and sizes of compressed chunks and their layers, for which the library would make room."""
    stored, first = file.seek(0, os.SEEK_END), header.offset_to_point_data + 8
    table = _integer(file, first - 8, 8)
    if table == -1:  # a file written without going back has the place at its end
        table = _integer(file, stored - 8, 8)
    if not header.point_count and table <= 0:
        return
    if not first <= table <= stored - 8:
        raise _damaged(path, "it has no table of chunks")
    chunks = _integer(file, table + 4, 4)
    if not 0 <= chunks <= max(header.point_count, 1):
        raise _damaged(path, f"{header.point_count} points do not make {chunks} chunks")
    sizes = _chunk_sizes(file, header, compression)
    if sum(sizes) > table - first:
        raise _damaged(path, f"chunks of {sum(sizes)} bytes do not fit into {table - first}")
    if compression.is_layered:
        for start, size in zip(accumulate(sizes, initial=first), sizes, strict=False):
            if _size_of_layers(file, start, header.point_format.size, compression.layers) > size:
                raise _damaged(path, "the layers of a chunk do not fit into it")


def _chunk_sizes(file: BinaryIO, header: Any, compression: _Compression) -> list[int]:
    """Bytes of each compressed chunk; none if another library than lazrs is there."""
    try:
        import lazrs  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        return []
    file.seek(header.offset_to_point_data)
    return [size for _, size in lazrs.read_chunk_table(file, lazrs.LazVlr(compression.record))]


def _size_of_layers(file: BinaryIO, start: int, point_size: int, layers: int) -> int:
    """Bytes of the first point of a chunk, which is not compressed, of the sizes of its layers, and of these."""
    file.seek(start + point_size + 4)
    head = file.read(4 * layers)
    sizes = struct.unpack(f"<{layers}I", head.ljust(4 * layers, b"\0"))
    return point_size + 4 + 4 * layers + sum(sizes)


def _integer(file: BinaryIO, place: int, size: int) -> int:
    file.seek(place)
    return int.from_bytes(file.read(size), "little", signed=size == 8)


def _damaged(path: FilePath, problem: str) -> InputError:
    return input_error(path, f"is truncated or damaged: {problem}", "copy or export the file again")


def stored_coordinates(points: Any) -> NDArray[np.int32]:
    """The integers (n, 3) that x, y and z are stored as, yet to be scaled and moved."""
    return np.column_stack([points.X, points.Y, points.Z])


def _import_laspy(path: FilePath) -> Any:
    try:
        import laspy  # type: ignore[import-untyped,unused-ignore]
    except ImportError as error:
        raise _laspy_missing(path) from error
    return laspy


def _laspy_missing(path: FilePath) -> InputError:
    return library_missing(path, "LAS and LAZ files", "laspy", "las")
