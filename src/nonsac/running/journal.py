"""What is done of a long run, on disk line by line, so that a run that was stopped can go on from there."""

from __future__ import annotations

import json
import os
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

from nonsac.files.content import check_regular
from nonsac.files.errors import input_error
from nonsac.values.numeric import printable

__all__ = ["Journal"]


class Journal:
    """A file of JSON lines: first the settings of the run, then the records; a context manager that closes it.

    A record is a line `[position, record, checksum]`. One that is damaged is dropped with a warning, as if it had not
    been done; a file of records without checksums, as older versions wrote, is refused.

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
        Called with the position and the content of every record that is there; raises ValueError, TypeError, KeyError
        or AttributeError if it is none.

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
        check: Check = lambda position, record: None,
    ) -> None:
        self.path = Path(path)
        header = _line({"settings": settings})
        self._file = _opened(self.path)
        try:
            if _starts(self.path, header):  # nothing there, or killed while it wrote the first line
                os.truncate(self.path, 0)
                self._content = _Content({}, len(header))
                self._write(header)
                return
            self._content = _parsed(self.path, check)
            if not resume:
                raise ValueError(
                    f"{self.path} is left from a run that was stopped, with {self.count} {what} done; "
                    "go on there with resume (--resume), or remove it"
                )
            _check_settings(self.path, self._content.settings, json.loads(header)["settings"])
            os.truncate(self.path, self._content.end)  # the last line is torn if the run was killed
            if self._content.damaged:
                damaged = f"{self._content.damaged} of the {what} in {self.path} are damaged"
                warnings.warn(f"{damaged}; what is missing is done again", stacklevel=2)
        except BaseException:
            self._file.close()
            raise

    @property
    def count(self) -> int:
        """How many records it holds."""
        return len(self._content.places)

    def __contains__(self, position: int) -> bool:
        """Whether it holds the record of a position."""
        return position in self._content.places

    def add(self, position: int, record: Any) -> None:
        """Keep the record of a position, in the file when this returns.

        Raises
        ------
        InputError
            If the system refuses to write: on a full disk, say.
        """
        line = _checked_line(position, record)
        self._write(line)
        self._content.add(position, line)

    def records(self, positions: Iterable[int] | None = None) -> Iterator[Any]:
        """The records of some positions, or all by their positions, read from the file one by one."""
        with self.path.open("rb") as file:
            for position in sorted(self._content.places) if positions is None else positions:
                file.seek(self._content.places[position])
                yield json.loads(file.readline())[1]

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


Check = Callable[[int, Any], object]


@dataclass
class _Content:
    """What is in the file: where records begin, by their positions; where the last whole line ends; damaged lines."""

    settings: Mapping[str, Any]
    end: int
    places: dict[int, int] = field(default_factory=dict)
    damaged: int = 0

    def add(self, position: int | None, line: bytes) -> None:
        """A line that follows; without a position if it is damaged."""
        if position is None:
            self.damaged += 1
        else:
            self.places[position] = self.end
        self.end += len(line)


def _line(content: Any) -> bytes:
    return (json.dumps(content) + "\n").encode()


_CHECKSUM = 14  # bytes of `, "0123abcd"]` and the end of the line


def _checked_line(position: int, record: Any) -> bytes:
    body = _line([position, record])[: -len(b"]\n")]
    return body + b', "%08x"]\n' % zlib.crc32(body)


def _record(line: bytes) -> tuple[int, Any] | None:
    """The position and the record in a line; None if it is damaged; TypeError if it is something else."""
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        return None
    position, record, checksum = content if isinstance(content, list) and len(content) == 3 else (None, None, None)
    if not isinstance(checksum, str):
        raise TypeError("a record without a checksum")
    if line != line[:-_CHECKSUM] + b', "%08x"]\n' % zlib.crc32(line[:-_CHECKSUM]) or type(position) is not int:
        return None
    return position, record


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


def _parsed(path: Path, check: Check) -> _Content:
    try:
        with path.open("rb") as file:
            header = file.readline()
            content = _Content(json.loads(header)["settings"], len(header))
            if not isinstance(content.settings, dict) or not header.endswith(b"\n"):
                raise TypeError("settings")
            for line in file:
                if line.endswith(b"\n"):
                    found = _record(line)
                    if found is not None:
                        check(*found)
                    content.add(found and found[0], line)
            return content
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        problem = f"{path} is not a record of a run, or one of an older version"
        raise ValueError(f"{problem}; remove it, or choose another name") from error


def _check_settings(path: Path, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    for key in {**before, **now}:
        if before.get(key) != now.get(key):
            told = f"{path} is of a run with {key} {before.get(key)!r}, not {now.get(key)!r}"
            raise ValueError(printable(f"{told}; resume with the settings of that run, or remove the file"))
