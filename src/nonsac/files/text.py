"""Read tables of numbers from text."""

import re
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, repeat

import numpy as np
from numpy.typing import NDArray

from nonsac.files.column_names import is_usual, unquoted
from nonsac.files.errors import FilePath, InputError, input_error
from nonsac.files.pipes import read_text
from nonsac.files.records import truncated

# Seventeen significant digits are enough to get every double back bit by bit.
EXACT = "%.17g"
# MATLAB's and others' comments; not the # of -1.#IND, by which some systems write what is no number.
_COMMENT = re.compile(r"(?:(?<!\d\.)#|//|^\s*%).*")
_SIGNS = re.compile(r"^(?:#|%|//|;)+\s*")
_LEAD = re.compile(r"^(?:columns|fields|format|header|names)\s*[:=]\s*", re.IGNORECASE)
_BEFORE_UNIT = re.compile(r"\s+(?=[\[(])")  # x [m] is one name
_NO_NUMBER = re.compile(r"\d\.#(?:IND|QNAN|SNAN)\d*|nan\([\w-]*\)", re.IGNORECASE)
_INFINITE = re.compile(r"\d\.#INF\d*", re.IGNORECASE)
_HOLDS_NUMBER = re.compile(r"[\s;,][\"']?[-+]?[.,]?\d")
_MOST_DIGITS = 18
_LONGEST_LINE = 1 << 18
_COMMENTS_LOOKED_AT = 100
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
        Column names of the header line, in lower case if that leaves them different; None if there is none.
    promised
        How many rows the file says that it has; 0 if it does not.
    """

    path: FilePath
    lines: Sequence[str]
    first_number: int = 1
    names: tuple[str, ...] | None = None
    promised: int = 0

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Go through the rows as pairs of line number and values, skipping blank lines."""
        separator = self._separator()
        for number, line in enumerate(self.lines, self.first_number):
            if line:
                yield number, [value.strip() for value in line.split(separator)]

    def first_row(self) -> list[str]:
        """Return the values of the first row as text; an empty list if there is no row."""
        return next(self.rows(), (0, []))[1]

    def after_first_row(self, names: tuple[str, ...] | None = None, promised: int = 0) -> "Table":
        """Return the rest of the table, with these column names."""
        number = next(self.rows())[0]
        return Table(self.path, self.lines[number - self.first_number + 1 :], number + 1, names, promised)

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
            If a row is too short or holds something that is no number, with its line number, or rows are missing.
        """
        rows = self._numbers(columns)
        if len(rows) < self.promised:
            raise truncated(self.path, self.promised, len(rows))
        return rows

    def _numbers(self, columns: Sequence[int]) -> NDArray[np.float64]:
        if not any(self.lines):
            return np.empty((0, len(columns)))
        self._check_widths(columns)
        try:
            return np.loadtxt(
                self.lines, np.float64, comments=None, delimiter=self._separator(), usecols=columns, ndmin=2
            )
        except ValueError:
            raise self._first_fault(columns) from None

    def _separator(self) -> str | None:
        return separator_of(next(filter(None, self.lines), ""))

    def _check_widths(self, columns: Sequence[int]) -> None:
        """Refuse rows whose words before a wanted column may be one more or less than in the header."""
        if self.names is None or all(map(is_number, self.first_row()[: max(columns)])):
            return
        for number, row in self.rows():
            if len(row) != len(self.names):
                problem = f"line {number} has {len(row)} columns, its header names {len(self.names)}"
                raise input_error(self.path, problem, "correct this line (names must not hold what separates columns)")

    def _first_fault(self, columns: Sequence[int]) -> InputError:
        needed = max(columns) + 1
        for number, row in self.rows():
            if len(row) < needed:
                problem = f"line {number} has {len(row)} columns where {needed} are needed"
                return input_error(self.path, problem, "complete or remove this line")
            wrong = [row[column] for column in columns if not is_number(row[column])]
            if wrong:
                problem = f"line {number}: {wrong[0][:40]!r} is not a number"
                hint = "decimals take a point, no comma" if wrong[0] else "write nan for what is missing"
                return input_error(self.path, problem, f"correct this line ({hint})")
        return input_error(self.path, "some numbers cannot be read", "write them as plain decimals")


def read_table(path: FilePath) -> Table:
    """Read a text file of rows separated by white space, commas, semicolons or tabulators.

    Parameters
    ----------
    path
        The file, or a stream (`nonsac.files.pipes`). Blank lines, what follows ``#`` or ``//``, and lines that begin
        with ``%`` or, before the first row, with ``;`` are skipped. The first line is a header if none of its values
        starts like a number. Else one of the comments before it is, if it holds as many words as there are columns,
        and they are usual names of columns. A number by itself before the rows says how many there are.

    Returns
    -------
    Table
        The rows and the names of their columns.

    Raises
    ------
    InputError
        If the file cannot be read or is not text, or its header names more or fewer columns than there are.
    """
    text = _decoded(read_text(path))
    lines = _split(text)
    _check_lengths(path, lines)
    comments = _comments_before(text, lines)
    header, table = _split_header(Table(path, lines))
    table = _without_count(table)
    width = len(table.first_row())
    names = _names_in_comments(comments, width) if header is None else _names(_words_of(header, width))
    if width and names is not None and len(names) != width:
        problem = f"its header names {len(names)} columns, its rows have {width}"
        raise input_error(path, problem, "name every column, or remove the header line")
    return replace(table, names=names)


def split_lines(content: bytes) -> list[str]:
    """Split text into lines, emptied of comments and outer white space."""
    return _split(_decoded(content))


def separator_of(line: str) -> str | None:
    """What stands between the values of a line; None for white space of any kind."""
    if mark := next((mark for mark in ";," if mark in line), None):
        return mark
    cells = [cell.split() for cell in line.split("\t")]
    # Tabulators may also be mixed with other white space: then several numbers stand between two of them, or nothing.
    are_values = all(len(words) == 1 or not all(map(is_number, words)) for words in cells)
    return "\t" if len(cells) > 1 and are_values else None


def is_number(text: str) -> bool:
    """Tell whether text can be read as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _decoded(content: bytes) -> str:
    # Only numbers matter: a byte that is not UTF-8 can do no harm in a comment, and elsewhere is reported.
    return content.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")


def _split(text: str) -> list[str]:
    lines = text.split("\n")
    for sign in ("#", "//", "%"):
        if sign in text:
            lines = [_COMMENT.sub("", line) if sign in line else line for line in lines]
    if any(start in text for start in (".#", "nan(", "NaN(", "NAN(")):
        lines = [_INFINITE.sub("inf", _NO_NUMBER.sub("nan", line)) for line in lines]
    return [line.strip() for line in lines]


def _check_lengths(path: FilePath, lines: Sequence[str]) -> None:
    longest = max(map(len, lines))
    if longest > _LONGEST_LINE:
        number = next(number for number, line in enumerate(lines, 1) if len(line) == longest)
        raise input_error(path, f"line {number} is {longest:,} characters long", "write one row in each line")


def _comments_before(text: str, lines: list[str]) -> Iterable[str]:
    """The last comments before the first row; those that begin with a semicolon are taken out of the lines."""
    first = next((line for line in lines if line and not line.startswith(";")), "")
    semicolons = first.count(";")
    comments: deque[str] = deque(maxlen=_COMMENTS_LOOKED_AT)
    for place, raw in enumerate(_each_line(text)):
        line = lines[place]
        # If semicolons separate values, one at the beginning may follow an empty value.
        is_remark = line.startswith(";") and (not semicolons or line.count(";") == 1 < semicolons)
        if is_remark and not _HOLDS_NUMBER.search(line):
            lines[place] = ""
        if lines[place]:
            break
        if raw.strip():
            comments.append(raw.strip())
    return comments


def _each_line(text: str) -> Iterator[str]:
    start = 0
    while start <= len(text):
        end = text.find("\n", start)
        end = len(text) if end < 0 else end
        yield text[start:end]
        start = end + 1


def _split_header(table: Table) -> tuple[str | None, Table]:
    """The first line, if no value in it starts like a number, and the rest."""
    header = table.first_row()
    if not header or any(map(_may_be_number, header)):
        return None, table
    return next(filter(None, table.lines)), table.after_first_row()


def _without_count(table: Table) -> Table:
    """The table without the number of its rows, with which a PTS file starts."""
    first, second = (row for _, row in islice(chain(table.rows(), repeat((0, list[str]()))), 2))
    is_count = len(first) == 1 and first[0].isdecimal() and len(first[0]) <= _MOST_DIGITS
    if is_count and len(second) != 1:
        return table.after_first_row(promised=int(first[0]))
    return table


def _words_of(header: str, width: int) -> list[str]:
    """The names in a line, by the separator that gives as many as there are columns, if one does."""
    marks = [mark for mark in (separator_of(header), "\t", ",", ";", None) if mark is None or mark in header]
    lines = [_BEFORE_UNIT.sub("", header) if mark is None else header for mark in marks]
    splits = [[word.strip() for word in line.split(mark)] for line, mark in zip(lines, marks, strict=True)]
    return next((words for words in splits if len(words) == width), splits[0])


def _names_in_comments(comments: Iterable[str], width: int) -> tuple[str, ...] | None:
    """The names in the last comment that holds as many as there are columns, and usual ones; None if none does."""
    for comment in reversed(list(comments)):
        words = _words_of(_LEAD.sub("", _SIGNS.sub("", comment)), width)
        if len(words) == width and is_usual(words) and not any(map(_may_be_number, words)):
            return _names(words)
    return None


def _names(words: Sequence[str]) -> tuple[str, ...]:
    names = tuple(map(unquoted, words))
    folded = tuple(name.lower() for name in names)
    return folded if len(set(folded)) == len(set(names)) else names


def _may_be_number(word: str) -> bool:
    return is_number(word) or bool(_LIKE_A_NUMBER.match(word))
