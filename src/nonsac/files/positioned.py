"""A file on disk that is read at positions, never mapped: one that shrinks ends in an error, not in a signal."""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from nonsac.files.content import check_regular, unreadable
from nonsac.files.errors import FilePath, InputError, input_error

# Two reads cost more than one that takes along so many bytes between them.
_NEAR = 4096
_SCRATCH = 4 << 20
_LARGEST_READ = 1 << 30
_PROBED = 64
_BINARY = getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
_seeking = threading.Lock()


class PositionedFile:
    """A regular file as it is now; a reading that finds another one there raises InputError.

    It pickles as its path, size and time of change, and opens where it is first read. Positioned reads share a
    descriptor safely among threads and after a fork. Messages call it by the `name` that the user gave.
    """

    def __init__(self, path: FilePath) -> None:
        self.name, self.path = os.fspath(path), os.path.abspath(path)
        status = check_regular(self.name)
        if not status.st_size:
            raise input_error(self.name, "the file is empty", "write or copy it again")
        self.size, self.changed = status.st_size, status.st_mtime_ns
        self._descriptor: int | None = None

    def __getstate__(self) -> tuple[str, str, int, int]:
        return self.name, self.path, self.size, self.changed

    def __setstate__(self, state: tuple[str, str, int, int]) -> None:
        self.name, self.path, self.size, self.changed = state
        self._descriptor = None

    def check(self) -> int:
        """Raise InputError unless the file is the one that was there at first; an open descriptor of it."""
        try:
            descriptor = self._open() if self._descriptor is None else self._descriptor
            status = os.fstat(descriptor)
        except OSError as error:
            raise unreadable(self.name, error) from error
        if (status.st_size, status.st_mtime_ns) != (self.size, self.changed):
            raise self._was_changed()
        return descriptor

    def read_into(self, start: int, array: NDArray[np.generic]) -> None:
        """Fill a C-order array with the bytes from a position on."""
        view = array.reshape(-1).view(np.uint8).data
        descriptor, done = self.check(), 0
        while done < len(view):
            count = self._read(descriptor, start + done, view[done : done + _LARGEST_READ])
            if not count:
                raise self._was_changed()
            done += count
        self.check()

    def gather(self, starts: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
        """So many bytes from each of these positions on, which must be sorted: (len(starts), size)."""
        gathered = np.empty((len(starts), size), np.uint8)
        step = max(1, _SCRATCH // (size + _NEAR))
        self.check()
        for first in range(0, len(starts), step):
            gathered[first : first + step] = self._gather(starts[first : first + step], size)
        self.check()
        return gathered

    def _gather(self, starts: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
        cuts = np.flatnonzero(np.diff(starts) > size + _NEAR) + 1
        firsts = starts[np.concatenate([[0], cuts])]
        lengths = starts[np.concatenate([cuts - 1, [len(starts) - 1]])] + size - firsts
        content = np.frombuffer(self._read_runs(firsts.tolist(), lengths.tolist()), np.uint8)
        if len(firsts) == len(starts):
            return content.reshape(-1, size)
        shifts = firsts - np.cumsum(lengths) + lengths
        places = starts - np.repeat(shifts, np.diff(np.concatenate([[0], cuts, [len(starts)]])))
        return np.lib.stride_tricks.sliding_window_view(content, size)[places]

    def _read_runs(self, firsts: list[int], lengths: list[int]) -> bytes:
        """The bytes of several runs, joined."""
        descriptor = self.check()
        try:
            if any(_must_come_from_disk(descriptor, first) for first in firsts[::_PROBED]):
                _announce(descriptor, firsts, lengths)
            content = b"".join(_read_each(descriptor, firsts, lengths))
        except OSError as error:
            raise unreadable(self.name, error) from error
        if len(content) != sum(lengths):
            raise self._was_changed()
        return content

    def _read(self, descriptor: int, start: int, view: memoryview) -> int:
        """Read into a view once; how many bytes came."""
        try:
            if hasattr(os, "preadv"):
                return os.preadv(descriptor, [view], start)
            content = next(iter(_read_each(descriptor, [start], [len(view)])))
        except OSError as error:
            raise unreadable(self.name, error) from error
        view[: len(content)] = content
        return len(content)

    def _open(self) -> int:
        # Threads may race here: then each opens its own, and all are closed with this object.
        descriptor = os.open(self.path, os.O_RDONLY | _BINARY)
        weakref.finalize(self, os.close, descriptor).atexit = False
        self._descriptor = descriptor
        return descriptor

    def _was_changed(self) -> InputError:
        return input_error(
            self.name, "the file was changed while it was read", "let it be written first, then start again"
        )


def _must_come_from_disk(descriptor: int, position: int) -> bool:
    """Whether a byte is known not to be in the system's cache."""
    if not hasattr(os, "RWF_NOWAIT"):
        return False
    try:
        os.preadv(descriptor, [bytearray(1)], position, os.RWF_NOWAIT)
    except BlockingIOError:
        return True
    except OSError:  # not every file system can tell
        return False
    return False


def _announce(descriptor: int, firsts: Iterable[int], lengths: Iterable[int]) -> None:
    """Let the disk fetch all runs at once rather than one after the other."""
    for first, length in zip(firsts, lengths, strict=True):
        os.posix_fadvise(descriptor, first, length, os.POSIX_FADV_WILLNEED)


def _read_each(descriptor: int, firsts: Iterable[int], lengths: Iterable[int]) -> list[bytes]:
    if hasattr(os, "pread"):
        read = os.pread
        return [read(descriptor, length, first) for first, length in zip(firsts, lengths, strict=True)]
    return [_seek_and_read(descriptor, first, length) for first, length in zip(firsts, lengths, strict=True)]


def _seek_and_read(descriptor: int, first: int, length: int) -> bytes:
    with _seeking:
        os.lseek(descriptor, first, os.SEEK_SET)
        return os.read(descriptor, length)
