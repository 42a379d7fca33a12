"""Read the points of LAS and LAZ files."""

from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.io.content import read_content
from nonsac.io.errors import FilePath, InputError, input_error, library_missing
from nonsac.io.records import truncated


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
    laspy = _import_laspy(path)
    content = read_content(path, "LAS file")
    try:
        las = laspy.read(BytesIO(content))
        points = np.asarray(las.xyz, dtype=np.float64)
        promised = las.header.point_count
    # laspy passes on the errors of struct, NumPy and its LAZ library, which share no type.
    except Exception as error:
        if not laspy.LazBackend.detect_available() and "Laz" in str(error):
            raise _laspy_missing(path) from error
        problem = f"is truncated or damaged ({error})"
        raise input_error(path, problem, "copy or export the file again") from error
    if len(points) < promised:
        raise truncated(path, promised, len(points))
    return points


def _import_laspy(path: FilePath) -> Any:
    try:
        import laspy  # type: ignore[import-untyped,unused-ignore]
    except ImportError as error:
        raise _laspy_missing(path) from error
    return laspy


def _laspy_missing(path: FilePath) -> InputError:
    return library_missing(path, "LAS and LAZ files", "laspy", "las")
