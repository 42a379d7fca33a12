"""Pick x, y and z out of records, the way PLY and PCD files store points."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.errors import FilePath, InputError, input_error


def find_axes(path: FilePath, names: Sequence[str]) -> list[int]:
    """Return the positions of x, y and z among names.

    Raises
    ------
    InputError
        If one of them is missing.
    """
    return find_columns(path, names, "xyz", "name the coordinates x, y and z")


def find_columns(path: FilePath, names: Sequence[str], wanted: Sequence[str], fix: str) -> list[int]:
    """Return the positions of the wanted names among names.

    Raises
    ------
    InputError
        If one of them is missing; `fix` ends its message.
    """
    missing = [name for name in wanted if name not in names]
    if missing:
        problem = f"the header names no {', '.join(missing)} (it names {', '.join(names) or 'nothing'})"
        raise input_error(path, problem, fix)
    return [names.index(name) for name in wanted]


def unpack_columns(
    data: bytes, count: int, formats: Sequence[np.dtype[Any]], offsets: Sequence[int], steps: Sequence[int]
) -> NDArray[np.float64]:
    """Read columns of `count` numbers, each with its own type, first byte and distance between numbers.

    Returns
    -------
    ndarray of float64, shape (count, len(formats))
        The numbers; `data` must be long enough.
    """
    if not count:
        return np.empty((0, len(formats)))
    columns = [
        np.ndarray((count,), kind, data, offset, (step,))
        for kind, offset, step in zip(formats, offsets, steps, strict=True)
    ]
    return np.column_stack(columns).astype(np.float64)


def truncated(path: FilePath, promised: int, found: int, what: str = "point") -> InputError:
    """Say that a file ends before its last point, or the last row of what comes before the points."""
    problem = f"the file is truncated: its header promises {promised} {what} rows, it holds {found}"
    return input_error(path, problem, "copy or export the file again")
