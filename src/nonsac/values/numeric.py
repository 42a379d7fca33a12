"""Numbers that users give: of any type that is one, and nothing else."""

from __future__ import annotations

import math
import re
from numbers import Integral, Real
from typing import Any

LEAST, MOST = 1e-100, 1e100  # of lengths and scales: squares and cubes of them are numbers, too
_LONGEST = 80  # characters of what came that a message shows


# Controls, line separators, and what turns the direction of writing.
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
_LONGEST_LINE = 2000


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


def printable(text: str) -> str:
    """The text in one line without control characters, which a terminal would obey, and not too long.

    What messages quote of a file is written by others.
    """
    line = _CONTROL.sub(lambda found: ascii(found[0])[1:-1], " ".join(text.split()))
    if len(line) <= _LONGEST_LINE:
        return line
    return f"{line[: _LONGEST_LINE // 2]} [...] {line[-_LONGEST_LINE // 2 :]}"
