"""Read and write 4x4 transforms as text."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.files.atomic import write_atomically
from nonsac.files.errors import FilePath, input_error
from nonsac.files.text import EXACT, read_table
from nonsac.values.checks import file_name, real_array

_SHAPE = (4, 4)


def write_transform(path: FilePath, transform: ArrayLike) -> None:
    """Write a transform as four lines of four numbers, the form CloudCompare takes.

    Parameters
    ----------
    path
        The file, with any suffix. It is replaced as a whole or not at all.
    transform
        Shape (4, 4), finite; every bit of it is kept.

    Raises
    ------
    InputError
        If shape or values do not fit, or the file cannot be written.
    """
    file_name("path", path)
    matrix = _check(path, real_array("transform", transform))
    write_atomically(path, lambda temporary: np.savetxt(temporary, matrix, fmt=EXACT))


def read_transform(path: FilePath) -> NDArray[np.float64]:
    """Read a transform of four lines of four numbers.

    Parameters
    ----------
    path
        The file, with any suffix; white space, commas or semicolons stand between the numbers.

    Returns
    -------
    ndarray of float64, shape (4, 4)
        The matrix.

    Raises
    ------
    InputError
        If the file cannot be read or does not hold four rows of four finite numbers.
    """
    table = read_table(path)
    if table.names is not None:
        raise input_error(path, "its first line holds no numbers", "write four lines of four numbers")
    return _check(path, table.numbers(range(max(len(table.first_row()), 1))))


def _check(path: FilePath, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    if matrix.shape != _SHAPE:
        problem = f"a transform has four rows and columns, this array has the shape {matrix.shape}"
        raise input_error(path, problem, "give four lines of four numbers")
    if not np.isfinite(matrix).all():
        raise input_error(path, "the transform holds values that are not finite", "compute it again")
    return matrix
