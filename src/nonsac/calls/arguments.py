"""Checks of what users pass, at the door: the message names the argument, what came and what was expected."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.layouts import Array
from nonsac.result import Result
from nonsac.sources.contract import Source
from nonsac.values.arraylike import as_array, cloud_array, column_names
from nonsac.values.quiet import quiet


def check_object(name: str, value: object, kind: type) -> None:
    """Refuse what is no object of a class derived from a contract."""
    if isinstance(value, kind):
        return
    if isinstance(value, type):
        raise TypeError(f"{name} must be an object, got the class {value.__name__}: write {value.__name__}(...)")
    raise TypeError(
        f"{name} must be an object of a class derived from nonsac.{kind.__name__}, got {type(value).__name__}"
    )


def check_source(name: str, value: object) -> None:
    """Refuse what is no source."""
    if not isinstance(value, Source):
        raise TypeError(
            f"{name} must be a source of rows, got {type(value).__name__}: wrap an array in nonsac.ArraySource, "
            "open a file with nonsac.open_source, or derive a class from nonsac.Source"
        )


def points_argument(points: Any, name: str, width: int, organised: bool = False) -> NDArray[Any]:
    """Points as an (n, width) array of their own dtype, not copied, or an error that says what is wrong with them.

    If they may be `organised`, as range cameras have them, (h, w, width) is taken as well.
    """
    expected = f"an array of real numbers (n, {width})"
    chosen = _coordinates(column_names(points), width)
    if chosen and not isinstance(points, np.ndarray):
        points = points[chosen]
    array = (cloud_array if width == 3 else as_array)(points, name, expected)
    if array.dtype.names is not None:
        array = _fields(array, name, width)
    if array.dtype.kind not in "fiu":
        what = f"dtype {array.dtype}" if array.ndim or array.dtype.kind != "O" else type(points).__name__
        raise TypeError(f"{name} must be {expected}, got {what}")
    is_grid = array.ndim == 3 and array.shape[2] == width
    return _rows_of_points(array.reshape(-1, width) if organised and is_grid else array, name, width)


def _coordinates(names: Sequence[str], width: int) -> list[str]:
    """The names of the columns that are called x, y and z, or u and v, in this order; none if one is not there once."""
    plain = [column.casefold().rstrip("12") for column in names]
    for axes in ("xyz"[:width], "uv"):
        if len(axes) == width and all(plain.count(axis) == 1 for axis in axes):
            return [names[plain.index(axis)] for axis in axes]
    return []


def _fields(array: NDArray[Any], name: str, width: int) -> NDArray[Any]:
    """The coordinates of a structured array."""
    names = array.dtype.names or ()
    chosen = _coordinates(names, width)
    # The X, Y and Z of LAS files are whole numbers yet to be scaled.
    if chosen and not all(column.isupper() and array.dtype[column].kind in "iu" for column in chosen):
        return np.stack([array[column] for column in chosen], axis=-1)
    raise TypeError(
        f"{name} must be an array of real numbers (n, {width}), got the fields {', '.join(names)}: pass "
        f"numpy.stack([{name}[field] for field in ({', '.join(map(repr, 'xyz'[:width]))})], axis=-1)"
    )


def _rows_of_points(array: NDArray[Any], name: str, width: int) -> NDArray[Any]:
    """Rows of coordinates, also of homogeneous ones that end in 1."""
    if array.shape[1:] == (width,):
        return array
    expected = f"{name} must have one point in each row (n, {width})"
    if array.ndim == 2 and array.shape[0] == width:
        raise ValueError(f"{expected}, got {array.shape}: pass {name}.T")
    if array.shape[1:] == (1, width):
        raise ValueError(f"{expected}, got {array.shape}: pass {name}[:, 0]")
    if array.ndim == 3 and array.shape[2] == width:
        raise ValueError(f"{expected}, got shape {array.shape}: pass {name}.reshape(-1, {width})")
    if array.ndim == 2 and array.shape[1] == width + 1:
        last = array[:, width]
        if (np.isnan(last) | (last == 1)).all():
            return array[:, :width]
        raise ValueError(
            f"{expected}, got shape {array.shape}: pass {name}[:, :{width}] if the last column is something else, an "
            f"intensity say, or {name}[:, :{width}] / {name}[:, {width}:] if it is that of homogeneous coordinates"
        )
    raise ValueError(f"{expected}, got shape {array.shape}")


@quiet
def weights_argument(weights: ArrayLike | None, rows: int) -> Array | None:
    """Weights (n,) of matches, or None if there are none or all are equal."""
    if weights is None:
        return None
    array = as_array(weights, "weights", "real numbers (n,)")
    if array.dtype.kind not in "fiub":
        raise TypeError(f"weights must be real numbers (n,), got dtype {array.dtype}")
    if array.shape != (rows,):
        fix = ": pass weights.ravel()" if array.size == rows else ""
        raise ValueError(f"weights must have one number for each match ({rows},), got shape {array.shape}{fix}")
    array = array.astype(np.float64)
    finite = array[np.isfinite(array)]
    if (finite < 0).any():
        raise ValueError(f"weights must not be negative, got {finite.min():g}")
    if rows and not (finite > 0).any():
        raise ValueError("weights must not all be zero")
    return None if rows == 0 or (array == array[0]).all() else array


def warn_dropped(dropped: int, total: int, what: str, stacklevel: int) -> None:
    if dropped:
        warnings.warn(f"dropped {dropped} of {total} {what} with NaN or infinite coordinates", stacklevel=stacklevel)


def warn_dropped_rows(result: Result, flaw: str, stacklevel: int) -> None:
    """Say how many of the rows that were looked at are no use; nobody looks at all of them."""
    dropped = sum(h.dropped for h in result.hypotheses)
    if dropped:
        warnings.warn(f"dropped {dropped} sampled rows {flaw}", stacklevel=stacklevel + 1)
