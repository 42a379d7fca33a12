"""A process with a memory and a time limit, for work that may take too much of either, or crash."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from nonsac.running.metered import process_memory
from nonsac.running.processes import CannotStart, check_may_start, end_with_parent

_PATIENCE = 1.0  # seconds, between the end of a pipe and that of its process
_TOLD = 200  # characters of what a process said last
# What libraries say that cannot be loaded, or start threads, within the limit is among it.
_OF_MEMORY = (
    "MemoryError",
    "bad_alloc",
    "ArrayMemoryError",
    "Unable to allocate",
    "Cannot allocate memory",
    "Memory allocation",
    "Could not find/load shared object",
    "failed to map segment",
)


class Reason(StrEnum):
    """Why a task gave nothing."""

    OUT_OF_MEMORY = "out of memory"
    LATE = "over the time limit"
    CRASHED = "crashed"
    FAILED = "failed"


@dataclass(frozen=True)
class Ended:
    """How a task ended: with a value, or with the reason why not, and what is known of it."""

    value: Any = None
    reason: Reason | None = None
    detail: str = ""


class Cancelled(RuntimeError):
    """Raised by a call that another thread has cancelled."""


class Confined:
    """A process that does one task after another; one that it does not survive is an outcome, and it starts anew.

    Parameters
    ----------
    prepare : callable
        Of a module, or an object with `__call__`, so that it travels: gives what each task takes first. It is called
        in each process that starts, without a limit of memory, as it may import libraries.
    max_memory : int
        Bytes of address space that a task may take beside what the process holds before it. Not enforced on systems
        that cannot (Windows, macOS).

    Attributes
    ----------
    starts : int
        How often a process was started.
    """

    def __init__(self, prepare: Callable[[], Any], max_memory: int) -> None:
        check_may_start()
        self._prepare, self._max_memory = prepare, max_memory
        self._process: Any = None
        self._pipe: Any = None
        self._cancelled = False
        descriptor, said = tempfile.mkstemp(prefix="nonsac-")
        os.close(descriptor)
        self._said = Path(said)
        self.starts = 0

    def start(self, time_limit: float) -> Ended | None:
        """Start the process, if there is none; how that failed, if it did."""
        if self._process is not None:
            return None
        self._start()
        ended = self._asked(self._prepare, (), None, time_limit)
        if ended.reason is not None:
            self.kill()
            return ended
        return None

    def call(self, task: Callable[..., Any], *arguments: Any, time_limit: float) -> Ended:
        """What comes of `task(prepared, *arguments)`; starting the process does not count.

        Parameters
        ----------
        task : callable
            Of a module, or an object with `__call__`, so that it travels.
        *arguments
            What it takes besides what was prepared.
        time_limit : float
            Seconds.

        Raises
        ------
        Cancelled
        """
        return self.start(time_limit) or self._asked(task, arguments, self._max_memory, time_limit)

    def cancel(self) -> None:
        """End the process from another thread; the call that waits for it raises `Cancelled`."""
        self._cancelled = True
        process = self._process
        if process is not None:
            process.kill()

    def _asked(
        self, task: Callable[..., Any], arguments: tuple[Any, ...], max_memory: int | None, time_limit: float
    ) -> Ended:
        message = pickle.dumps((task, arguments, max_memory))
        try:
            self._pipe.send_bytes(message)
            if not self._pipe.poll(time_limit):
                self.kill()
                return Ended(reason=Reason.LATE, detail=f"more than {time_limit:g} s")
            succeeded, answer = pickle.loads(self._pipe.recv_bytes())
        except (EOFError, OSError):
            return self._death()
        return Ended(answer) if succeeded else failure(answer)

    def kill(self) -> None:
        """End the process, whatever it is at."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            self._process = None

    def close(self) -> None:
        """End the process for good."""
        self.kill()
        self._said.unlink(missing_ok=True)

    def _start(self) -> None:
        self._check_not_cancelled()
        spawn = multiprocessing.get_context("spawn")  # a fork would copy the locks of running threads
        self._pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_serve, args=(theirs, str(self._said)), daemon=True)
        self._process.start()
        self.starts += 1
        theirs.close()  # so that its death closes the pipe
        try:
            self._pipe.recv_bytes()
        except EOFError:
            self.kill()
            self._check_not_cancelled()
            raise CannotStart("a worker process could not start, see above") from None

    def _check_not_cancelled(self) -> None:
        if self._cancelled:
            raise Cancelled("the work was cancelled")

    def _death(self) -> Ended:
        """What a process died of that nobody here ended."""
        self._check_not_cancelled()
        self._process.join(_PATIENCE)
        code = self._process.exitcode
        self.kill()
        said = self._last_words()
        if code == -signal.SIGKILL or (code != 0 and any(word in said for word in _OF_MEMORY)):
            return Ended(reason=Reason.OUT_OF_MEMORY, detail=said if code != -signal.SIGKILL else "it was killed")
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        return Ended(reason=Reason.CRASHED, detail=f"{how}: {said}" if said else how)

    def _last_words(self) -> str:
        """The last line that the process wrote."""
        with suppress(OSError):
            lines = self._said.read_text(encoding="utf-8", errors="replace").split("\n")
            return next((line.strip() for line in reversed(lines) if line.strip()), "")[:_TOLD]
        return ""


def failure(told: str) -> Ended:
    """What an exception means, from its type and message."""
    short = " ".join(told.split())[:_TOLD]
    return Ended(reason=Reason.OUT_OF_MEMORY if any(w in told for w in _OF_MEMORY) else Reason.FAILED, detail=short)


def _serve(pipe: Connection, said: str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    end_with_parent()
    pipe.send_bytes(b"ready")
    with suppress(OSError):
        _keep_words(said)
    prepared: list[Any] = []
    while True:
        try:
            message = pipe.recv_bytes()
        except EOFError:
            return
        pipe.send_bytes(_answer(message, prepared))


def _keep_words(said: str) -> None:
    """What libraries write goes to a file, from which it is known why they ended the process."""
    descriptor = os.open(said, os.O_WRONLY | os.O_TRUNC | os.O_APPEND)
    for standard in (1, 2):
        os.dup2(descriptor, standard)
    os.close(descriptor)


def _answer(message: bytes, prepared: list[Any]) -> bytes:
    """The answer to a message; to the first one, what the tasks take first is kept."""
    try:
        task, arguments, memory = pickle.loads(message)
        if not prepared:
            prepared.append(task())
            return pickle.dumps((True, None))
        _limit_memory(memory)
        try:
            return pickle.dumps((True, task(prepared[0], *arguments)))
        finally:
            _limit_memory(None)
    except Exception as error:
        return pickle.dumps((False, f"{type(error).__name__}: {error}" if str(error) else type(error).__name__))


def _limit_memory(more: int | None) -> None:
    """Let the process take so many bytes of address space more than it has now; None is no limit."""
    try:
        import resource
    except ImportError:  # Windows
        return
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    held = process_memory("VmSize")
    if more is None or held is None:
        wanted = hard
    else:
        wanted = held + more if hard == resource.RLIM_INFINITY else min(held + more, hard)
    if sys.platform != "darwin":  # which does not keep to it
        resource.setrlimit(resource.RLIMIT_AS, (wanted, hard))
