"""Headers are claims: they are compared with the bytes that are there before anything is made of what they promise."""

import os
from collections.abc import Sequence

from nonsac.files.errors import FilePath, input_error

# No table of rows has more columns; an array of more lies on its side.
WIDEST = 100_000
# What any file may expand to, however small it is; and beyond, how many bytes one byte of a file may become.
_ALWAYS = 32 << 20
_FOLD = 100
_LARGEST_COUNT = 2**62
_NUMBER = 8  # bytes: whatever is stored is read as float64


def check_shape(path: FilePath, shape: Sequence[object]) -> tuple[int, ...]:
    """The shape of an array, if there can be such an array.

    Raises
    ------
    InputError
        If a dimension is no integer or negative, or it has more numbers than can be counted.
    """
    lengths = tuple(length for length in shape if type(length) is int and length >= 0)
    if len(lengths) < len(shape):
        shown = f"({', '.join(map(str, shape))})"[:80]
        raise input_error(path, f"names the shape {shown}, which no array has", "copy or save the file again")
    numbers = 1
    for length in lengths:
        numbers *= max(length, 1)
    if numbers >= _LARGEST_COUNT:
        problem = f"promises an array of {min(numbers, 10**300):.3g} numbers, more than any file holds"
        raise input_error(path, problem, "copy or save the file again")
    return lengths


def check_width(path: FilePath, width: int) -> None:
    """Refuse a table that has more columns than any table of rows.

    Raises
    ------
    InputError
        If it does.
    """
    if width > WIDEST:
        problem = f"holds {width} columns, more than {WIDEST} of any table of rows"
        raise input_error(path, problem, "transpose it, one row per match or point")


def check_expansion(path: FilePath, what: str, numbers: int, stored: int, fix: str) -> None:
    """Refuse what would take up far more memory than the bytes that it is made from.

    Parameters
    ----------
    path
        The file.
    what
        What would: an array, a chunk, a row group.
    numbers
        How many numbers it promises.
    stored
        Bytes that are there: those of the whole file, if it is not known which of them belong to it.
    fix
        Ends the message.

    Raises
    ------
    InputError
        If it would.
    """
    needed = numbers * _NUMBER
    if needed > max(_ALWAYS, _FOLD * stored):
        problem = f"{what} would take up {_size(needed)} of memory, from {_size(stored)} that are there"
        raise input_error(path, problem, fix)


def size_of(path: FilePath) -> int:
    """The bytes of a file, 0 if the system does not tell."""
    try:
        return os.stat(path).st_size
    except OSError:
        return 0


def _size(count: int) -> str:
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if count < 1000 or unit == "TB":
            return f"{count:.3g} {unit}"
        count /= 1000  # type: ignore[assignment]
    raise AssertionError
