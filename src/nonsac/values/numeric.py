"""Numbers that users give: of any type that is one, and nothing else."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import Any

_LONGEST = 80  # characters of what came that a message shows


def as_real(value: Any) -> float:
    """A real number as a float: infinite if it is too large for one, NaN if it is no number but a truth value, say."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    try:
        return float(value) if is_number else math.nan
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def as_whole(value: Any) -> int | None:
    """A whole number of any integer type as an int; None if it is none, as truth values and floats are."""
    return int(value) if isinstance(value, Integral) and not isinstance(value, bool) else None


def shown(value: Any) -> str:
    """What came, for a message: on one line that is not too long."""
    try:
        text = repr(value)
    except ValueError:  # whole numbers of thousands of digits
        text = f"a number of {value.bit_length()} bits"
    text = " ".join(text.split())
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
