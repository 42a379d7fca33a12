"""How much memory an estimate takes, and how many rows fit into a given one."""

from __future__ import annotations

import re
import sys
from typing import Any

from nonsac.values.numeric import as_real, shown

_FACTORS = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12, "KI": 2**10, "MI": 2**20, "GI": 2**30, "TI": 2**40}
_PATTERN = re.compile(r"\s*([0-9.]+(?:e[+]?[0-9]+)?)\s*([KMGT]I?)?B?\s*", re.IGNORECASE)

_FIXED = 6 * 10**6
_TIMES = 10  # numbers that are held, at the peak, for each number of the sampled rows: measured, 7 to 9
_BLOCKS = 3  # what is read, what is decoded from it, and the rows as they are wanted


def bytes_of(text: object, name: str = "max_memory") -> int:
    """A number of bytes, from a number or from words such as "500 MB" and "2GiB".

    Raises
    ------
    ValueError
        If it is neither; the message has `name`.
    """
    match = _PATTERN.fullmatch(text) if isinstance(text, str) else None
    try:
        if match:
            text = float(match[1]) * _FACTORS[(match[2] or "").upper()]
        if 0.0 < as_real(text) < 2.0**62:
            return int(as_real(text))
    except ValueError:  # 1.2.3
        pass
    raise ValueError(f'{name} must be a positive number of bytes, or words such as "500 MB", got {shown(text)}')


def rows_within(max_memory: int, source: Any) -> int:
    """How many sampled rows of a source fit into so many bytes, beside what this process holds already."""
    return max(0, max_memory - bytes_for(0, source)) // (_TIMES * 8 * source.width)


def bytes_for(rows: int, source: Any) -> int:
    """How many bytes an estimate from so many sampled rows takes at its peak, about."""
    return _FIXED + bytes_of_block(source) + 8 * source.width * _TIMES * rows


def bytes_of_block(source: Any) -> int:
    """How many bytes the reading of a block takes at its peak, for each worker; 0 if rows are read one by one."""
    return int(_BLOCKS * 8 * source.width * source.about.largest_block)


def peak_memory() -> int | None:
    """The most bytes that this process has held so far, libraries included; None if the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
