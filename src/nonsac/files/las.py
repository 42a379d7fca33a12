"""Read the points of LAS and LAZ files."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.content import check_kind
from nonsac.files.errors import FilePath, InputError, input_error, library_missing
from nonsac.files.records import truncated

_POINTS_AT_ONCE = 500_000


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
    check_kind(path, "LAS file")
    backends = laspy.LazBackend.detect_available()
    if single_threaded:
        backends = tuple(backend for backend in backends if backend != laspy.LazBackend.LazrsParallel)
    try:
        with laspy.open(path, laz_backend=backends, read_evlrs=False) as reader:
            yield reader
    except InputError:
        raise
    # laspy passes on the errors of struct, NumPy and its LAZ library, which share no type.
    except Exception as error:
        if not backends and "Laz" in str(error):
            raise _laspy_missing(path) from error
        problem = f"is truncated or damaged ({error})"
        raise input_error(path, problem, "copy or export the file again") from error


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
