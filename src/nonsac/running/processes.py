"""Worker processes that may die: only the task at hand is lost, and that only if it kills twice."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

__all__ = [
    "CannotStart",
    "WorkerDied",
    "WorkerProcesses",
    "can_spawn",
    "check_may_start",
    "end_with_parent",
    "portable",
]

_ATTEMPTS = 2
_PATIENCE = 1.0  # seconds, between the end of a pipe and that of its process
_NEEDS_GUARD = "a script that uses several processes has to do so under `if __name__ == '__main__':`"
_IS_DAEMON = "this process is a daemon, as those of multiprocessing.Pool are, and may start none; set workers=1 here"


class WorkerDied(RuntimeError):
    """The process that worked on a task was killed, or crashed, twice."""


class CannotStart(RuntimeError):
    """Worker processes do not come up, so that there is no use in going on."""


def check_may_start() -> None:
    """Raise CannotStart if this process may start no others."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise CannotStart(_NEEDS_GUARD)
    if multiprocessing.current_process().daemon:
        raise CannotStart(_IS_DAEMON)


def can_spawn(task: object) -> bool:
    """Whether a process can be started for a task although nobody has asked for processes.

    Not if the task does not travel, or the main script has no guard, so that it would run anew there.
    """
    main = sys.modules["__main__"]
    script = None if getattr(main, "__spec__", None) is not None else getattr(main, "__file__", None)
    try:
        told = pickle.dumps(task)
        guarded = script is None or b"__name__" in Path(script).read_bytes()
    except Exception:  # what is pickled may raise anything
        return False
    is_alone = hasattr(main, "__file__") or b"__main__" not in told  # what is defined at a prompt is nowhere else
    return guarded and is_alone and not multiprocessing.current_process().daemon


class WorkerProcesses(Executor):
    """Threads of this process, each with a process of its own that is replaced if it dies.

    A pool of `concurrent.futures` breaks as a whole, and does not tell which task killed it. The processes are spawned,
    because a fork would copy the locks of running threads.
    """

    def __init__(self, count: int) -> None:
        check_may_start()
        self._max_workers = count
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="nonsac")
        self._own = threading.local()
        self._lock = threading.Lock()
        self._workers: set[_Worker] = set()
        self._closed = False

    def submit(self, task: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """As for any executor; what the task raises, or `WorkerDied`, is in the future."""
        return self._threads.submit(self._run, task, arguments, named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes: whatever they are at, unless `wait` is set and nothing is to be cancelled."""
        if cancel_futures or not wait:
            with self._lock:
                self._closed = True
                for worker in self._workers:
                    worker.kill()
        self._threads.shutdown(cancel_futures=cancel_futures)
        for worker in self._workers:
            worker.kill()
            worker.bury()
        self._workers.clear()

    def _run(self, *request: Any) -> Any:
        message = pickle.dumps(request)
        for _ in range(_ATTEMPTS):
            worker = self._worker()
            try:
                succeeded, answer = worker.ask(message)
            except (EOFError, OSError):
                death = self._replace(worker)
                continue
            if succeeded:
                return answer
            raise answer
        raise WorkerDied(f"its worker process {death}, twice")

    def _worker(self) -> _Worker:
        """That of this thread."""
        if not hasattr(self._own, "worker"):
            with self._lock:
                if self._closed:
                    raise RuntimeError("the workers are shut down")
                self._own.worker = _Worker()
                self._workers.add(self._own.worker)
        worker: _Worker = self._own.worker
        return worker

    def _replace(self, worker: _Worker) -> str:
        """Forget a dead worker; returns what it died of."""
        with self._lock:
            self._workers.remove(worker)
        del self._own.worker
        return worker.bury()


class _Worker:
    """One process, and the pipe to it."""

    def __init__(self) -> None:
        spawn = multiprocessing.get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        self._ready = False
        theirs.close()  # so that its death closes the pipe

    def ask(self, message: bytes) -> tuple[bool, Any]:
        """The answer to a request; EOFError or OSError if the process dies."""
        self._wait_until_ready()
        self._pipe.send_bytes(message)
        answer: tuple[bool, Any] = pickle.loads(self._pipe.recv_bytes())
        return answer

    def _wait_until_ready(self) -> None:
        if self._ready:
            return
        try:
            self._pipe.recv_bytes()
        except EOFError:
            self._process.join(_PATIENCE)
            if (self._process.exitcode or 0) > 0:
                raise CannotStart(f"a worker process could not start, see above; {_NEEDS_GUARD}") from None
            raise
        self._ready = True

    def kill(self) -> None:
        self._process.kill()

    def bury(self) -> str:
        """Wait for its end, and say how it was."""
        self._process.join(_PATIENCE)
        self._process.kill()
        self._process.join()
        self._pipe.close()
        code = self._process.exitcode or 0
        if code == -9:
            return "was killed, perhaps for want of memory"
        return f"died of signal {-code}" if code < 0 else f"ended with exit code {code}"


def _serve(pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    end_with_parent()
    pipe.send_bytes(b"ready")
    while True:
        try:
            message = pipe.recv_bytes()
        except EOFError:
            return
        pipe.send_bytes(_answer(message))


def _answer(message: bytes) -> bytes:
    try:
        task, arguments, named = pickle.loads(message)
        return pickle.dumps((True, task(*arguments, **named)))
    except Exception as error:
        return pickle.dumps((False, portable(error)))


def portable(error: Exception) -> Exception:
    """The error itself, if it survives the journey."""
    try:
        return pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")


def end_with_parent() -> None:
    """End this process when its parent does. Without this, processes whose parent was killed may wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_outlive, args=(parent,), daemon=True).start()


def _outlive(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)
