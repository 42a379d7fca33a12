"""Arithmetic without warnings: what overflows or has no value is infinite or NaN, and fits nothing."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Arguments = ParamSpec("Arguments")
Value = TypeVar("Value")


def quiet(function: Callable[Arguments, Value]) -> Callable[Arguments, Value]:
    """Keep NumPy's warnings in a function to itself; threads that it starts do not inherit this."""

    @wraps(function)
    def quietly(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Value:
        with np.errstate(all="ignore"):
            return function(*args, **kwargs)

    return quietly


@quiet
def as_doubles(numbers: ArrayLike) -> NDArray[np.float64]:
    """A fresh, writable, C-order float64 array; files hold any bits, some of which are numbers that NumPy warns of."""
    return np.array(numbers, np.float64, order="C")
