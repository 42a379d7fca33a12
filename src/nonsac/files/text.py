"""Read tables of numbers from text."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nonsac.files.content import read_content
from nonsac.files.errors import FilePath, InputError, input_error

# Seventeen significant digits are enough to get every double back bit by bit.
EXACT = "%.17g"
_COMMENT = re.compile(r"(?:#|//).*")
# A row of numbers in a wrong form, such as 1,5 or "1.5", must not pass for a header.
_LIKE_A_NUMBER = re.compile(r"[\"']?[-+]?[.,]?\d")


@dataclass(frozen=True)
class Table:
    """Rows of a text file that are still to be turned into numbers.

    Attributes
    ----------
    path
        The file.
    lines
        The lines of the data; blank ones stand for comments and blank lines.
    first_number
        Line number in the file of the first of `lines`.
    names
        Lower-case column names of the header line, or None if there is none.
    """

    path: FilePath
    lines: Sequence[str]
    first_number: int = 1
    names: tuple[str, ...] | None = None

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Go through the rows as pairs of line number and values, skipping blank lines."""
        separator = self._separator()
        for number, line in enumerate(self.lines, self.first_number):
            if line:
                yield number, [value.strip() for value in line.split(separator)]

    def first_row(self) -> list[str]:
        """Return the values of the first row as text; an empty list if there is no row."""
        return next(self.rows(), (0, []))[1]

    def after_first_row(self, names: tuple[str, ...] | None = None) -> "Table":
        """Return the rest of the table, with these column names."""
        number = next(self.rows())[0]
        return Table(self.path, self.lines[number - self.first_number + 1 :], number + 1, names)

    def numbers(self, columns: Sequence[int]) -> NDArray[np.float64]:
        """Turn the given columns into an array.

        Parameters
        ----------
        columns
            Indices of the columns, in the order wanted.

        Returns
        -------
        ndarray of float64, shape (n, len(columns))
            The values; n is 0 if there are no rows.

        Raises
        ------
        InputError
            If a row is too short or holds something that is no number, with its line number.
        """
        if not any(self.lines):
            return np.empty((0, len(columns)))
        try:
            return np.loadtxt(
                self.lines, np.float64, comments=None, delimiter=self._separator(), usecols=columns, ndmin=2
            )
        except ValueError:
            raise self._first_fault(columns) from None

    def _separator(self) -> str | None:
        first = next(filter(None, self.lines), "")
        return next((mark for mark in ";," if mark in first), None)

    def _first_fault(self, columns: Sequence[int]) -> InputError:
        needed = max(columns) + 1
        for number, row in self.rows():
            if len(row) < needed:
                problem = f"line {number} has {len(row)} columns where {needed} are needed"
                return input_error(self.path, problem, "complete or remove this line")
            wrong = [row[column] for column in columns if not is_number(row[column])]
            if wrong:
                problem = f"line {number}: {wrong[0][:40]!r} is not a number"
                return input_error(self.path, problem, "correct this line (decimals take a point, no comma)")
        return input_error(self.path, "some numbers cannot be read", "write them as plain decimals")


def read_table(path: FilePath) -> Table:
    """Read a text file of rows separated by white space, commas or semicolons.

    Parameters
    ----------
    path
        The file. Blank lines and what follows ``#`` or ``//`` are skipped. The first line is a header if
        none of its values starts like a number.

    Returns
    -------
    Table
        The rows and the names of their columns.

    Raises
    ------
    InputError
        If the file cannot be read or is not text.
    """
    table = Table(path, split_lines(read_content(path, "text table")))
    header = table.first_row()
    if not header or any(is_number(value) or _LIKE_A_NUMBER.match(value) for value in header):
        return table
    return table.after_first_row(tuple(name.strip("\"'").lower() for name in header))


def split_lines(content: bytes) -> list[str]:
    """Split text into lines, emptied of comments and outer white space."""
    # Only numbers matter: a byte that is not UTF-8 can do no harm in a comment, and elsewhere is reported.
    text = content.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    if "#" in text or "//" in text:
        return [_COMMENT.sub("", line).strip() for line in text.split("\n")]
    return [line.strip() for line in text.split("\n")]


def is_number(text: str) -> bool:
    """Tell whether text can be read as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
