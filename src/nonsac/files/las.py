"""Read the points of LAS and LAZ files."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.claims import check_expansion, size_of
from nonsac.files.content import check_kind
from nonsac.files.errors import FilePath, InputError, input_error, library_missing
from nonsac.files.records import truncated

_POINTS_AT_ONCE = 500_000
_SHORTEST_HEADER, _RECORD_HEADER = 227, 54  # bytes
_ITEMS = 32  # where the record of the compression has the number of parts of a point
_PANIC = "PanicException"


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
        raise input_error(path, "is truncated", "copy or export the file again")
    header_size, offset, records = struct.unpack_from("<HII", head, 94)
    size = size_of(path)
    if not _SHORTEST_HEADER <= header_size <= offset <= size:
        problem = f"is truncated or damaged: its points start at byte {offset} of {size}"
        raise input_error(path, problem, "copy or export the file again")
    if records * _RECORD_HEADER > offset - header_size:
        problem = f"is damaged: {records} records do not fit into the {offset - header_size} bytes before its points"
        raise input_error(path, problem, "copy or export the file again")


def _check_points(path: FilePath, header: Any) -> None:
    """Check that the points of the header can be there."""
    count, size, stored = header.point_count, header.point_format.size, size_of(path)
    if not header.are_points_compressed:
        held = (stored - header.offset_to_point_data) // size
        if held < count:
            raise truncated(path, count, held)
        return
    record = header.vlrs.get("LasZipVlr")[0].record_data
    (items,) = struct.unpack_from("<H", record, _ITEMS)
    item_sizes = [struct.unpack_from("<H", record, _ITEMS + 4 + 6 * item)[0] for item in range(items)]
    if sum(item_sizes) != size:
        problem = f"is damaged: its points have {size} bytes, when they are compressed {sum(item_sizes)}"
        raise input_error(path, problem, "copy or export the file again")
    _check_chunk_table(path, header, stored)
    numbers = count * max(size, 24) // 8
    check_expansion(path, f"its {count} points", numbers, stored, "copy it again, or export it as .las")


def _check_chunk_table(path: FilePath, header: Any, stored: int) -> None:
    """Check the number of compressed chunks, for which the library would make room before it reads one."""
    first = header.offset_to_point_data + 8
    with open(path, "rb") as file:
        file.seek(header.offset_to_point_data)
        place = int.from_bytes(file.read(8), "little", signed=True)
        if place == -1:  # a file written without going back has the place at its end
            file.seek(stored - 8)
            place = int.from_bytes(file.read(8), "little", signed=True)
        if not header.point_count and place <= 0:
            return
        if not first <= place <= stored - 8:
            raise input_error(path, "is truncated or damaged: it has no table of chunks", "copy or export it again")
        file.seek(place + 4)
        chunks = int.from_bytes(file.read(4), "little")
    if chunks > max(header.point_count, 1):
        problem = f"is damaged: {header.point_count} points do not make {chunks} chunks"
        raise input_error(path, problem, "copy or export the file again")


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
