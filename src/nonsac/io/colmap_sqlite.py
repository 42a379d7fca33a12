"""Open the SQLite databases of COLMAP, which may come from strangers, for one transaction."""

import os
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.claims import size_of
from nonsac.files.content import check_kind
from nonsac.files.errors import FilePath, InputError, input_error

_SECONDS_TO_WAIT = 5.0
_WAL = b"\x02\x02"
_TABLES = ("cameras", "images", "keypoints", "matches", "two_view_geometries")
_MAKES_TABLE = re.compile(r"\s*CREATE\s+TABLE\b", re.IGNORECASE)
# Instructions of SQLite: a second or two.
_STEP, _MOST_STEPS = 100_000, 1000
_SHORTEST_LIMIT, _LONGEST_LIMIT = 1_000_000, 2**31 - 1


@contextmanager
def open_database(path: FilePath, write: bool = False) -> Iterator[sqlite3.Connection]:
    """Open a database, for one transaction; what is raised within is undone, and told as an InputError."""
    head = check_kind(path, "SQLite database")
    mode = "rw" if write else "ro" + _immutable(path, head)
    address = f"{Path(path).absolute().as_uri()}?mode={mode}"
    try:
        with closing(sqlite3.connect(address, _SECONDS_TO_WAIT, isolation_level=None, uri=True)) as database:
            _distrust(path, database)
            database.execute("BEGIN IMMEDIATE" if write else "BEGIN")
            _check_tables(path, database)
            yield database
            database.execute("COMMIT")
    # Numbers too large for SQLite, and names that are no text, are errors of Python's own.
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
        raise _explain(path, error) from error


def _distrust(path: FilePath, database: sqlite3.Connection) -> None:
    """Let nothing in a database call functions, make blobs that are longer than it is, or compute for ever."""
    database.execute("PRAGMA trusted_schema = OFF")
    stored = sum(size_of(f"{os.fspath(path)}{suffix}") for suffix in ("", "-wal"))
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(max(stored, _SHORTEST_LIMIT), _LONGEST_LIMIT))
    steps = count()
    database.set_progress_handler(lambda: next(steps) >= _MOST_STEPS, _STEP)


def _check_tables(path: FilePath, database: sqlite3.Connection) -> None:
    """Check that the tables are tables: views, virtual tables and generated columns are programs."""
    for name, kind, statement in database.execute("SELECT name, type, sql FROM sqlite_master"):
        if kind in ("table", "view") and str(name).lower() in _TABLES and not _MAKES_TABLE.match(str(statement)):
            raise _no_plain_table(path, name)
    for table in _TABLES:
        if any(row[-1] for row in database.execute(f"PRAGMA table_xinfo({table})")):  # hidden or generated
            raise _no_plain_table(path, table)


def _no_plain_table(path: FilePath, name: str) -> InputError:
    problem = f"{str(name)[:40]!r} is no plain table, as COLMAP makes them"
    return input_error(path, problem, "give a database that COLMAP itself has written")


def _immutable(path: FilePath, head: bytes) -> str:
    """Return the option that lets SQLite read a database without writing anything beside it, if that is safe."""
    # In WAL mode, which COLMAP uses, even a reader leaves files beside the database, unless told that nobody else
    # has it open; then the file with the suffix -wal is missing.
    alone = head[18:20] == _WAL and not Path(f"{os.fspath(path)}-wal").exists()
    return "&immutable=1" if alone else ""


def _explain(path: FilePath, error: Exception) -> InputError:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return input_error(path, "the database is locked by another program", "wait until it is done, or close it")
    if code in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
        return input_error(path, f"cannot be opened or written ({error})", "check the folder and its free space")
    if code in (sqlite3.SQLITE_INTERRUPT, sqlite3.SQLITE_TOOBIG):
        problem = f"asks for more than a database of COLMAP would ({error})"
        return input_error(path, problem, "give a database that COLMAP itself has written")
    if code == sqlite3.SQLITE_ERROR:
        return input_error(path, f"is no database of COLMAP ({error})", "give the database.db of COLMAP 3 or later")
    return damaged(path, str(error))


def damaged(path: FilePath, problem: str) -> InputError:
    return input_error(path, f"the database is truncated or damaged ({problem})", "copy it again")


def unpack(path: FilePath, row: tuple[Any, Any, Any], kind: str, what: str) -> NDArray[Any]:
    rows, columns, data = row
    if not rows:
        return np.empty((0, 2), kind)
    valid = isinstance(rows, int) and isinstance(columns, int) and isinstance(data, bytes) and columns >= 2
    if not valid or rows * columns * np.dtype(kind).itemsize != len(data):
        raise damaged(path, f"the size of {what} is wrong")
    return np.frombuffer(data, kind).reshape(rows, columns)
