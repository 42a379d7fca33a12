"""Read columns of numbers from Parquet files."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.content import check_kind
from nonsac.files.errors import FilePath, input_error, library_missing


def read_parquet(path: FilePath, choose: Callable[[Sequence[str]], Sequence[int]]) -> NDArray[Any]:
    """Read some columns of a Parquet file, and nothing of the others.

    Parameters
    ----------
    path
        The file.
    choose
        Called with the names of the columns; returns the positions of those to read.

    Returns
    -------
    ndarray, shape (n, columns chosen)
        The columns in the order chosen; what is missing among numbers is NaN.

    Raises
    ------
    InputError
        If pyarrow is missing, or the file cannot be read, is no Parquet file, is truncated or damaged.
    """
    parquet = import_parquet(path)
    check_kind(path, "Parquet file")
    # pyarrow passes on the errors of its codecs and of the system, which share no type.
    try:
        names = parquet.read_schema(path).names
    except Exception as error:
        raise _damaged(path, error) from error
    chosen = [names[position] for position in choose(names)]
    try:
        table = parquet.read_table(path, columns=chosen)
        return np.column_stack([table.column(name).to_numpy() for name in chosen])
    except Exception as error:
        raise _damaged(path, error) from error


def _damaged(path: FilePath, error: Exception) -> Exception:
    return input_error(path, f"is truncated or damaged ({error})", "copy or save the file again")


def import_parquet(path: FilePath) -> Any:
    """The module `pyarrow.parquet`, or the error that says how to install it."""
    try:
        from pyarrow import parquet  # type: ignore[import-untyped,unused-ignore]
    except ImportError as error:
        raise library_missing(path, "Parquet files", "pyarrow", "parquet") from error
    return parquet
