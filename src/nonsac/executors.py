"""Runs one task per sample, in order, on threads, processes or any `concurrent.futures.Executor`."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import TypeVar

Outcome = TypeVar("Outcome")
Workers = int | Executor | None


def ordered_map(task: Callable[[int], Outcome], count: int, workers: Workers = None) -> Iterator[Outcome]:
    """`task(0)`, `task(1)`, ... in this order, computed ahead by the workers.

    What is yielded does not depend on the workers: a caller that stops after k outcomes has seen the same k for any
    number and kind of them. Tasks that were computed ahead in vain are dropped.

    Parameters
    ----------
    task : callable
        Must be picklable where `workers` is a pool of processes.
    workers : None (one thread for each core), a number of threads, or an executor, which is left running
    """
    if isinstance(workers, Executor):
        yield from _ahead(task, count, workers, getattr(workers, "_max_workers", None) or cores())
        return
    threads = _thread_count(workers)
    if threads == 1 or count == 1:
        yield from map(task, range(count))
        return
    with ThreadPoolExecutor(threads, thread_name_prefix="nonsac") as pool:
        yield from _ahead(task, count, pool, threads)


def _ahead(task: Callable[[int], Outcome], count: int, pool: Executor, width: int) -> Iterator[Outcome]:
    pending: deque[Future[Outcome]] = deque()
    submitted = 0
    try:
        while submitted < count or pending:
            while submitted < count and len(pending) < 2 * width:
                pending.append(pool.submit(task, submitted))
                submitted += 1
            yield pending.popleft().result()
    finally:
        for future in pending:
            future.cancel()


def _thread_count(workers: int | None) -> int:
    if workers is None:
        return cores()
    if isinstance(workers, int) and not isinstance(workers, bool) and workers >= 1:
        return workers
    raise ValueError(f"workers must be None, a positive integer or an Executor, got {workers!r}")


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
