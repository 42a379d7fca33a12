"""What is done of a long run, on disk line by line, so that a run that was stopped can go on from there."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

from nonsac.files.content import check_regular
from nonsac.files.errors import input_error

__all__ = ["Journal"]


class Journal:
    """A file of JSON lines, of which the first holds the settings of the run; a context manager that closes it.

    Parameters
    ----------
    path : path-like
        Of the file, which may exist from a run that was stopped.
    settings : dict
        What the records depend on, ready for JSON; must be the same when a run goes on.
    resume : bool
        Whether to go on where the file ends. Without it, a file that is there is refused rather than lost.
    what : str
        What the records are called in messages.
    check : callable, optional
        Called with every record that is there; raises ValueError, TypeError, KeyError or AttributeError if it is none.

    Attributes
    ----------
    count : int
        How many records it holds.

    Raises
    ------
    ValueError
        If the file is there and `resume` is not set, or it comes from other settings, or is no journal, or another
        run writes to it.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        settings: Mapping[str, Any],
        resume: bool = False,
        what: str = "records",
        check: Callable[[Any], object] = lambda record: None,
    ) -> None:
        self.path = Path(path)
        self.count = 0
        header = _line({"settings": settings})
        self._file = _opened(self.path)
        try:
            if _starts(self.path, header):  # nothing there, or killed while it wrote the first line
                os.truncate(self.path, 0)
                self._write(header)
                return
            before, self.count, end = _parsed(self.path, check)
            if not resume:
                raise ValueError(
                    f"{self.path} is left from a run that was stopped, with {self.count} {what} done; "
                    "go on there with resume (--resume), or remove it"
                )
            _check_settings(self.path, before, json.loads(header)["settings"])
            os.truncate(self.path, end)  # the last line is torn if the run was killed
        except BaseException:
            self._file.close()
            raise

    def add(self, record: Any) -> None:
        """Keep a record, in the file when this returns.

        Raises
        ------
        InputError
            If the system refuses to write: on a full disk, say.
        """
        self._write(_line(record))
        self.count += 1

    def records(self) -> Iterator[Any]:
        """All records, read from the file one by one."""
        with self.path.open("rb") as file:
            next(file)
            yield from map(json.loads, file)

    def _write(self, line: bytes) -> None:
        try:
            while line:  # what is not buffered may be written in part
                line = line[self._file.write(line) :]
        except OSError as error:
            problem = f"cannot be written ({error.strerror or error})"
            raise input_error(self.path, problem, "make room, then go on with resume (--resume)") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


def _line(content: Any) -> bytes:
    return (json.dumps(content) + "\n").encode()


def _opened(path: Path) -> BinaryIO:
    """The file, locked if the system can: the records of two runs would be mixed up."""
    if os.path.lexists(path):  # a device or a pipe has no end
        check_regular(path)
    file: BinaryIO = path.open("ab", buffering=0)
    try:
        _lock(file, path)
    except BaseException:
        file.close()
        raise
    return file


def _lock(file: BinaryIO, path: Path) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ValueError(f"{path} is in use by another run; let it end, or choose another name") from error
    except OSError:  # not every file system can
        return


def _starts(path: Path, header: bytes) -> bool:
    """Whether the file is the header, or the beginning of it."""
    with path.open("rb") as file:
        return header.startswith(file.read(len(header) + 1))


def _parsed(path: Path, check: Callable[[Any], object]) -> tuple[Mapping[str, Any], int, int]:
    """The settings, the number of records, and where the last whole line ends."""
    try:
        with path.open("rb") as file:
            header = file.readline()
            settings, count, end = json.loads(header)["settings"], 0, len(header)
            if not isinstance(settings, dict) or not header.endswith(b"\n"):
                raise TypeError("settings")
            for line in file:
                if line.endswith(b"\n"):
                    check(json.loads(line))
                    count, end = count + 1, end + len(line)
            return settings, count, end
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"{path} is not a record of a run; remove it, or choose another name") from error


def _check_settings(path: Path, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    for key in {**before, **now}:
        if before.get(key) != now.get(key):
            raise ValueError(
                f"{path} is of a run with {key} {before.get(key)!r}, not {now.get(key)!r}; "
                "resume with the settings of that run, or remove the file"
            )
