"""Text from standard input and pipes, which can be read only once."""

from __future__ import annotations

import os
import stat
import time
from collections.abc import Iterator
from pathlib import Path

from nonsac.files.content import check_head, not_regular, read_content, unreadable
from nonsac.files.errors import FilePath, input_error
from nonsac.values.checks import file_name

STANDARD_INPUT = "-"
TEXT_SUFFIXES = (".xyz", ".txt", ".csv", ".asc", ".pts")
_MOST_BYTES = 1 << 28
_PIECE = 1 << 20
_SECONDS_TO_WAIT = 2.0
_SECONDS_BETWEEN = 0.02
_OF_PROCESSES = ("/dev/", "/proc/")


def is_stream(path: FilePath) -> bool:
    """Whether it is read as text, once: standard input (`-`), `<(...)`, or a pipe that is named as text is."""
    name = file_name("path", path)
    if name == STANDARD_INPUT:
        return True
    try:
        is_pipe = stat.S_ISFIFO(os.stat(name).st_mode)
    except (OSError, ValueError):
        return False
    named_as_text = Path(name).suffix.lower() in TEXT_SUFFIXES
    return is_pipe and (named_as_text or os.path.abspath(name).startswith(_OF_PROCESSES))


def read_text(path: FilePath) -> bytes:
    """Read a text table whole, from a regular file or a stream, of which at most 256 MiB are taken.

    Raises
    ------
    InputError
        If it cannot be read, is empty or no text, is a device, or gives too much, or if nobody writes to the pipe.
    """
    if not is_stream(path):
        return read_content(path, "text table")
    content = bytearray()
    for piece in _pieces(path):
        if not content:
            check_head(path, piece, "text table")
        content += piece
        if len(content) > _MOST_BYTES:
            problem = f"gives more than {_MOST_BYTES >> 20} MiB, which is the most that is read from a pipe"
            raise input_error(path, problem, "save it to a file first")
    if not content:
        raise input_error(path, "nothing came", "write a table to it")
    return bytes(content)


def _pieces(path: FilePath) -> Iterator[bytes]:
    """What the stream gives, until its end."""
    try:
        if os.fspath(path) == STANDARD_INPUT:
            status = os.fstat(0)
            if stat.S_ISCHR(status.st_mode):
                raise not_regular(path, status)
            yield from iter(lambda: os.read(0, _PIECE), b"")
            return
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        try:
            yield _first_piece(path, descriptor)
            yield from iter(lambda: os.read(descriptor, _PIECE), b"")
        finally:
            os.close(descriptor)
    except OSError as error:
        raise unreadable(path, error) from error


def _first_piece(path: FilePath, descriptor: int) -> bytes:
    """The first bytes of a pipe, which is not waited for if nobody has it open to write."""
    deadline = time.monotonic() + _SECONDS_TO_WAIT
    while time.monotonic() < deadline:
        try:
            if piece := os.read(descriptor, _PIECE):
                os.set_blocking(descriptor, True)
                return piece
        except BlockingIOError:  # somebody has
            os.set_blocking(descriptor, True)
            return os.read(descriptor, _PIECE)
        time.sleep(_SECONDS_BETWEEN)
    raise input_error(path, "is a pipe that nobody writes to", "start the program that writes to it first")
