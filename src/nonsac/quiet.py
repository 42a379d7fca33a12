"""Arithmetic without warnings: what overflows or has no value is infinite or NaN, and fits nothing."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np

Arguments = ParamSpec("Arguments")
Value = TypeVar("Value")


def quiet(function: Callable[Arguments, Value]) -> Callable[Arguments, Value]:
    """Keep NumPy's warnings in a function to itself; threads that it starts do not inherit this."""

    @wraps(function)
    def quietly(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Value:
        with np.errstate(all="ignore"):
            return function(*args, **kwargs)

    return quietly
