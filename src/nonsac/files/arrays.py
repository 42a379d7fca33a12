"""Read NumPy files, and check the shape and type of arrays."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.content import read_content
from nonsac.files.errors import FilePath, input_error


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


@dataclass(frozen=True)
class Archive:
    """An open NPZ file, whose arrays are loaded one by one, never unpickling anything.

    Attributes
    ----------
    path
        The file.
    names
        The keys of its arrays.
    members
        What NumPy made of the file.
    """

    path: FilePath
    names: tuple[str, ...]
    members: Mapping[str, Any]

    def load(self, name: str) -> NDArray[Any]:
        """Load an array by its key."""
        # What is no NPY file within the archive comes as bytes.
        return np.asarray(_load(self.path, lambda: self.members[name]))

    def load_only(self, widths: Sequence[int], fix: str) -> NDArray[np.float64]:
        """Load the only array of shape (n, width) for one of the widths; `fix` ends the message if it is not one."""
        arrays = [self.load(name) for name in self.names]
        fitting = [array for array in arrays if array.ndim == 2 and array.shape[1] in widths]
        if len(fitting) != 1:
            problem = f"cannot tell which array to use (its keys are: {', '.join(self.names) or 'none'})"
            raise input_error(self.path, problem, fix)
        return as_rows(self.path, fitting[0], fitting[0].shape[1])


@contextmanager
def open_npz(path: FilePath) -> Iterator[Archive]:
    """Open an NPZ file, to load arrays from it.

    Raises
    ------
    InputError
        If the file cannot be read, is no NPZ file or is damaged; on loading, also if it holds pickled objects.
    """
    content = read_content(path, "NumPy archive")
    with _load(path, lambda: np.load(BytesIO(content), allow_pickle=False)) as members:
        yield Archive(path, tuple(members), members)


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
    with open_npz(path) as archive:
        for group in wanted:
            if all(name in archive.names for name in group):
                return [as_rows(path, archive.load(name), 3) for name in group]
        groups = " or ".join("/".join(group) for group in wanted)
        return [archive.load_only([width], f"save it under {groups}")]


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
