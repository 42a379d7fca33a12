"""Pick x, y and z out of records, the way PLY and PCD files store points."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.column_names import find_places, listing
from nonsac.files.errors import FilePath, InputError, input_error

_NAME_THEM = "name the coordinates x, y and z"


def find_axes(path: FilePath, names: Sequence[str]) -> list[int]:
    """Return the positions of x, y and z among names, or of what else these are usually called.

    Raises
    ------
    InputError
        If one of them is missing, or several could be meant.
    """
    try:
        places = find_places(names, ("x", "y", "z"))
    except ValueError as error:
        raise input_error(path, f"the header is not clear: {error}", _NAME_THEM) from None
    found = [place for place in places if place is not None]
    if len(found) < len(places):
        missing = ", ".join(axis for axis, place in zip("xyz", places, strict=True) if place is None)
        held = listing(names, ", ") or "nothing"
        raise input_error(path, f"the header names no {missing} (it names {held})", _NAME_THEM)
    return found


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
