"""Executors that would wait for ever: used by one of their own tasks, or copied into a process by a fork."""

from __future__ import annotations

import os
import threading
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor

from nonsac.running import dask


def is_inside(pool: Executor) -> bool:
    """Whether this thread is one that the executor has given a task to."""
    if dask.client_of(pool) is not None:
        return dask.is_in_task_of(dask.client_of(pool))
    if not isinstance(pool, ThreadPoolExecutor):
        return False
    with pool._shutdown_lock:  # a thread begins before the pool, which holds this lock, has noted it
        return threading.current_thread() in pool._threads


def check_not_inherited(pool: Executor) -> None:
    """Refuse an executor of the process that this one was forked from: its threads were not copied.

    Raises
    ------
    ValueError
        If it is one.
    """
    if _owner(pool) != os.getpid() or _has_lost_threads(pool):
        raise ValueError(
            f"workers is a {type(pool).__name__} of the process that this one was forked from, which cannot work here; "
            "make one in this process, or give a number"
        )


def _owner(pool: Executor) -> int:
    """The process that made a pool of processes; this one for other executors."""
    queue = getattr(pool, "_call_queue", None) if isinstance(pool, ProcessPoolExecutor) else None
    return getattr(queue, "_opid", os.getpid())


def _has_lost_threads(pool: Executor) -> bool:
    """Whether threads have ended though nobody has shut it down, which only a fork can do."""
    if not isinstance(pool, ThreadPoolExecutor) or pool._shutdown:
        return False
    return not all(thread.is_alive() for thread in pool._threads)
