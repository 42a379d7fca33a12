"""What an argument must be: all else is refused with its name, what came and what was expected."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.values.arraylike import as_array
from nonsac.values.numeric import as_real, as_whole, shown
from nonsac.values.quiet import quiet


@quiet
def real_array(name: str, values: Any, expected: str = "real numbers") -> NDArray[np.float64]:
    """The values as an array of doubles, of any shape; what is masked is NaN.

    Raises
    ------
    TypeError, ValueError
        If they are no real numbers.
    """
    array = as_array(values, name, f"an array of {expected}")
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{name} is of type {array.dtype}; expected an array of {expected}")
    return array.astype(np.float64)


def number(name: str, value: Any, low: float, high: float, expected: str) -> float:
    """A number between two bounds, which belong to it, as a float.

    Raises
    ------
    ValueError
        If it is no number, or beyond the bounds.
    """
    found = as_real(value)
    if not low <= found <= high:
        raise ValueError(f"{name} is {shown(value)}; expected {expected}")
    return found


def whole_number(name: str, value: Any, least: int, most: int | None = None) -> int:
    """A whole number within bounds.

    Raises
    ------
    TypeError
        If it is none.
    ValueError
        If it is beyond the bounds.
    """
    expected = f"an integer of at least {least}" if most is None else f"an integer from {least} to {most:,}"
    found = as_whole(value)
    if found is None:
        raise TypeError(f"{name} is {shown(value)}; expected {expected}")
    if found < least or (most is not None and found > most):
        raise ValueError(f"{name} is {shown(value)}; expected {expected}")
    return found


def iterable(name: str, values: Any, expected: str) -> Iterable[Any]:
    """The values as they are, if one can go through them.

    Raises
    ------
    TypeError
        If not, or if they are a string.
    """
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable) or getattr(values, "ndim", 1) == 0:
        raise TypeError(f"{name} must be {expected}, got {shown(values)}")
    return values


def listed(name: str, values: Any, expected: str) -> list[Any]:
    """The values as a list; raises what `iterable` raises."""
    return list(iterable(name, values, expected))


def file_name(name: str, path: Any) -> str:
    """The path as a string.

    Raises
    ------
    TypeError
        If it is none.
    ValueError
        If it is empty.
    """
    if isinstance(path, os.PathLike):
        path = os.fspath(path)
    if not isinstance(path, str):
        raise TypeError(f"{name} is {shown(path)}; expected the name of a file, as a string or a path")
    if not path:
        raise ValueError(f"{name} is empty; expected the name of a file")
    return path


def flag(name: str, value: Any) -> bool:
    """True or False.

    Raises
    ------
    TypeError
        If it is something else.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} is {shown(value)}; expected True or False")
    return bool(value)
