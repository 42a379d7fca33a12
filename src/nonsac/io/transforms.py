"""Read and write 4x4 transforms as text."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.files.arrays import open_npz
from nonsac.files.atomic import write_atomically
from nonsac.files.content import check_regular
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


def read_truth(path: FilePath) -> NDArray[np.float64]:
    """Read a true transform, as text (`read_transform`), or from where data keep it.

    Parameters
    ----------
    path
        Text; a .json file that holds `T` (as `nonsac simulate --truth` writes it, or a result); or an .npz archive
        that holds `T`, or `R` and `t`, or one array (4, 4) among others.

    Returns
    -------
    ndarray of float64, shape (4, 4)

    Raises
    ------
    InputError
        If the file cannot be read or holds no transform.
    """
    suffix = Path(file_name("path", path)).suffix.lower()
    if suffix == ".npz":
        return _check(path, _transform_in(path))
    if suffix != ".json":
        return read_transform(path)
    check_regular(path)
    try:
        matrix = real_array("T", json.loads(Path(path).read_text(encoding="utf-8"))["T"])
    except (ValueError, KeyError, TypeError, RecursionError):  # no text, no JSON, or no numbers
        raise input_error(
            path, "the file holds no JSON with the matrix T", "write what nonsac simulate prints"
        ) from None
    return _check(path, matrix)


def _transform_in(path: FilePath) -> NDArray[np.float64]:
    with open_npz(path) as archive:
        names = set(archive.names)
        if "T" in names:
            return real_array("T", archive.load("T"))
        if {"R", "t"} <= names:
            R, t = real_array("R", archive.load("R")), real_array("t", archive.load("t"))
            if R.shape != (3, 3) or t.size != 3:
                raise input_error(path, f"R has the shape {R.shape} and t {t.shape}", "save R (3, 3) and t (3,)")
            return np.vstack([np.column_stack([R, t.ravel()]), [0.0, 0.0, 0.0, 1.0]])
        matrices = [name for name in archive.names if archive.shape(name) == _SHAPE]
        if len(matrices) == 1:
            return real_array(matrices[0], archive.load(matrices[0]))
    raise input_error(path, "the archive holds no transform", "save it as T (4, 4), or as R (3, 3) and t (3,)")


def _check(path: FilePath, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    if matrix.shape != _SHAPE:
        problem = f"a transform has four rows and columns, this array has the shape {matrix.shape}"
        raise input_error(path, problem, "give four lines of four numbers")
    if not np.isfinite(matrix).all():
        raise input_error(path, "the transform holds values that are not finite", "compute it again")
    return matrix
