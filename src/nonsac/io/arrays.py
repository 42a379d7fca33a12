"""Read NumPy files, and check the shape and type of arrays."""

from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.io.content import read_content
from nonsac.io.errors import FilePath, input_error


def load_npy(path: FilePath) -> NDArray[Any]:
    """Load the array of an NPY file, never unpickling anything.

    Raises
    ------
    InputError
        If the file cannot be read, is no NPY file, is truncated, or holds pickled objects.
    """
    content = read_content(path, "NumPy array")
    array: NDArray[Any] = _load(path, lambda: np.load(BytesIO(content), allow_pickle=False))
    return array


def load_npz(path: FilePath, wanted: Sequence[tuple[str, ...]], width: int) -> list[NDArray[np.float64]]:
    """Load arrays of an NPZ file by name or, failing that, by shape.

    Parameters
    ----------
    path
        The file.
    wanted
        Groups of names; the arrays of the first group that the file holds are loaded.
    width
        If it holds no group, the only array of shape (n, width) is loaded.

    Returns
    -------
    list of ndarray of float64
        The arrays of the group, each of shape (n, 3), or the one of shape (n, width).

    Raises
    ------
    InputError
        If the file cannot be read, is no NPZ file, is damaged, holds pickled objects under these names, or
        nothing fits.
    """
    content = read_content(path, "NumPy archive")
    with _load(path, lambda: np.load(BytesIO(content), allow_pickle=False)) as archive:
        for group in wanted:
            if all(name in archive for name in group):
                return [as_rows(path, _load_member(path, archive, name), 3) for name in group]
        arrays = [_load_member(path, archive, name) for name in archive]
        names = ", ".join(archive) or "none"
    fitting = [array for array in arrays if array.shape[1:] == (width,)]
    if len(fitting) != 1:
        problem = f"cannot tell which array to use (its keys are: {names})"
        groups = " or ".join("/".join(group) for group in wanted)
        raise input_error(path, problem, f"save it under {groups}")
    return [as_rows(path, fitting[0], width)]


def as_rows(path: FilePath, array: NDArray[Any], width: int) -> NDArray[np.float64]:
    """Check that an array has the shape (n, width), and turn it into doubles.

    Parameters
    ----------
    path
        The file the array comes from or goes to, for the message.
    array
        Integers or floating-point numbers.
    width
        Number of columns wanted.

    Returns
    -------
    ndarray of float64, shape (n, width)
        The array, C-contiguous.

    Raises
    ------
    InputError
        If shape or type do not fit.
    """
    if array.dtype.kind not in "iuf":
        raise input_error(path, f"holds an array of type {array.dtype}", "save plain numbers")
    if array.shape[1:] == (width,):
        return np.ascontiguousarray(array, dtype=np.float64)
    problem = f"holds an array of shape {array.shape} instead of (n, {width})"
    if array.T.shape[1:] == (width,):
        raise input_error(path, problem, "transpose it before saving, one point per row: points.T")
    raise input_error(path, problem, f"save one point per row, in {width} columns")


def _load_member(path: FilePath, archive: Mapping[str, Any], name: str) -> NDArray[Any]:
    # What is no NPY file within the archive comes as bytes.
    return np.asarray(_load(path, lambda: archive[name]))


def _load(path: FilePath, load: Callable[[], Any]) -> Any:
    try:
        return load()
    # NumPy passes on the errors of zipfile, zlib and tokenize, which share no type.
    except Exception as error:
        if "allow_pickle" in str(error):
            problem = "holds pickled objects, which are never loaded"
            raise input_error(path, problem, "save plain numbers") from None
        problem = f"is truncated or damaged ({error})"
        raise input_error(path, problem, "copy or save the file again") from error
