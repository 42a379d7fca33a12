"""Runs numbered tasks, in order, on threads, processes, a Dask cluster or any `concurrent.futures.Executor`."""

from __future__ import annotations

import os
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

from nonsac.running import dask
from nonsac.running.reentry import check_not_inherited, is_inside

Outcome = TypeVar("Outcome")
Workers = int | str | Executor | None


def ordered_map(
    task: Callable[[int], Outcome],
    count: int,
    workers: Workers = None,
    pack: Callable[[int], Callable[[int], Outcome]] | None = None,
    together: int = 1,
) -> Iterator[Outcome]:
    """`task(0)`, `task(1)`, ... in this order, computed ahead by the workers.

    The first k results are the same for any workers, and a caller may stop after any k: tasks that were computed ahead
    in vain are dropped. If workers die, what they have not done is done by others, or in this process.

    Parameters
    ----------
    task : callable
        Must be picklable if `workers` is a pool of processes or a cluster.
    workers : None (one thread for each core), a number of threads, or an executor, which is left running
        See `parsed` for Dask.
    pack : callable, optional
        From a number to what is sent to an executor in place of the task: the same, with what it needs there.
    together : int
        How many tasks may be sent to an executor at once, while there are many: each journey takes some milliseconds.
    """
    pool = parsed(workers)
    if isinstance(pool, Executor):
        yield from _ahead(pack or (lambda _: task), 0, count, pool, width_of(pool), together)
        return
    if pool == 1 or count == 1:
        yield from map(task, range(count))
        return
    with ThreadPoolExecutor(pool, thread_name_prefix="nonsac") as threads:
        yield from _ahead(lambda _: task, 0, count, threads, pool)


def parsed(workers: object) -> int | Executor:
    """A number of threads, or an executor.

    Parameters
    ----------
    workers : None, int, Executor, Dask client, or str
        None is one thread for each core; "dask" is the Dask client that this process has made, and an address, as
        "tcp://host:8786", that of a scheduler to connect to.

    Returns
    -------
    int or Executor
        1 in a task of the very executor or cluster: it would wait for a worker while it occupies one.

    Raises
    ------
    ValueError
        If it is something else, or there is no such client or scheduler, or the executor is one of the process that
        this one was forked from.
    """
    if workers is None:
        return cores()
    if isinstance(workers, int) and not isinstance(workers, bool) and workers >= 1:
        return workers
    pool = workers if isinstance(workers, Executor) else dask.executor_of(workers)
    if pool is not None:
        if is_inside(pool):
            return 1
        check_not_inherited(pool)
        return pool
    raise ValueError(
        "workers must be None, a positive integer, an Executor, a Dask client, "
        f'"dask" or the address of a Dask scheduler (tcp://host:8786), got {workers!r}'
    )


def are_elsewhere(workers: Workers) -> bool:
    """Whether what workers get has to travel to them."""
    pool = parsed(workers)
    return isinstance(pool, Executor) and not isinstance(pool, ThreadPoolExecutor)


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True)
class _Together:
    """Several tasks in a row; one that raises ends the row, and is done again by itself if it was not the first."""

    tasks: Sequence[Callable[[int], Any]]

    def __call__(self, first: int) -> list[Any]:
        outcomes: list[Any] = []
        for number, task in enumerate(self.tasks, first):
            try:
                outcomes.append(task(number))
            except Exception:
                if not outcomes:
                    raise
                break
        return outcomes


def _ahead(
    pack: Callable[[int], Callable[[int], Outcome]],
    first: int,
    count: int,
    pool: Executor,
    width: int,
    together: int = 1,
) -> Iterator[Outcome]:
    """The tasks from a number on; the rest in threads of this process if the pool is lost."""
    pending: deque[tuple[Future[list[Outcome]], int]] = deque()
    submitted = done = first

    def submit(number: int, size: int) -> tuple[Future[list[Outcome]], int]:
        return pool.submit(_Together([pack(each) for each in range(number, number + size)]), number), size

    try:
        while done < count:
            try:
                while submitted < count and len(pending) < 2 * width:
                    # Fewer towards the end, so that no worker waits long for the last one.
                    size = max(1, min(together, (count - submitted) // (3 * width)))
                    pending.append(submit(submitted, size))
                    submitted += size
                future, size = pending.popleft()
                outcomes = waited_for(future, pool)
                alone = range(done + len(outcomes), done + size)
                pending.extendleft(submit(number, 1) for number in reversed(alone))
            except (BrokenExecutor, CancelledError) as error:
                reason = " ".join(str(error).split()) or "they were cancelled"
                warnings.warn(f"the workers are lost ({reason}); the rest is done in this process", stacklevel=2)
                break
            for outcome in outcomes:
                yield outcome
                done += 1
    finally:
        for future, _ in pending:
            future.cancel()
    if done < count:
        with ThreadPoolExecutor(cores(), thread_name_prefix="nonsac") as threads:
            yield from _ahead(pack, done, count, threads, cores())


def waited_for(future: Future[Outcome], pool: Executor) -> Outcome:
    """What a task gives; a Dask cluster without workers would wait for new ones for ever."""
    client = dask.client_of(pool)
    if client is None:
        return future.result()
    deserted = 0
    while deserted < 2:
        try:
            return future.result(timeout=dask.PATIENCE)
        except TimeoutError:
            if future.done():  # it is the task's own, or the task has ended just now
                return future.result()
            deserted = 0 if client.status == "running" and dask.threads_of(client) else deserted + 1
    raise BrokenExecutor("the Dask cluster has no workers left, or does not answer")


def width_of(pool: Executor) -> int:
    """How many tasks a pool runs at once, as far as it tells."""
    client = dask.client_of(pool)
    width = getattr(pool, "_max_workers", None) if client is None else dask.threads_of(client)
    return width or cores()
