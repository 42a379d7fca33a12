"""Checks of what users pass, at the door: the message names the argument, what came and what was expected."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.layouts import Array
from nonsac.result import Result
from nonsac.sources.contract import Source


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


def points_argument(points: ArrayLike | None, name: str, width: int) -> NDArray[Any]:
    """Points as an (n, width) array of their own dtype, not copied, or an error that says what is wrong with them."""
    if np.ma.isMaskedArray(points):
        points = np.ma.filled(np.ma.asarray(points).astype(np.float64), np.nan)
    array = np.asarray(points)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name} must be an array of real numbers (n, {width}), got dtype {array.dtype}")
    if array.shape[1:] == (width,):
        return array
    expected = f"{name} must have one point in each row (n, {width})"
    if array.ndim == 2 and array.shape[0] == width:
        raise ValueError(f"{expected}, got {array.shape}: pass {name}.T")
    if array.shape[1:] == (1, width):
        raise ValueError(f"{expected}, got {array.shape}: pass {name}[:, 0]")
    raise ValueError(f"{expected}, got shape {array.shape}")


def weights_argument(weights: ArrayLike | None, rows: int) -> Array | None:
    """Weights (n,) of matches, or None if there are none or all are equal."""
    if weights is None:
        return None
    array = np.asarray(weights)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"weights must be real numbers (n,), got dtype {array.dtype}")
    if array.shape != (rows,):
        raise ValueError(f"weights must have one number for each match ({rows},), got shape {array.shape}")
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
