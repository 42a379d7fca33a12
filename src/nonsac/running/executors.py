"""Runs numbered tasks, in order, on threads, processes, a Dask cluster or any `concurrent.futures.Executor`."""

from __future__ import annotations

import os
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from importlib import import_module
from typing import Any, TypeVar

Outcome = TypeVar("Outcome")
Workers = int | str | Executor | None

_PATIENCE = 10.0  # seconds between looks at whether a cluster still has workers
_ADDRESSES = ("tcp://", "tls://", "ucx://", "ws://", "wss://", "inproc://")


def ordered_map(
    task: Callable[[int], Outcome],
    count: int,
    workers: Workers = None,
    pack: Callable[[int], Callable[[int], Outcome]] | None = None,
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
    """
    pool = parsed(workers)
    if isinstance(pool, Executor):
        yield from _ahead(pack or (lambda _: task), 0, count, pool, width_of(pool))
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

    Raises
    ------
    ValueError
        If it is something else, or there is no such client or scheduler.
    """
    if workers is None:
        return cores()
    if isinstance(workers, Executor):
        return workers
    if isinstance(workers, int) and not isinstance(workers, bool) and workers >= 1:
        return workers
    if isinstance(workers, str) and (workers == "dask" or workers.startswith(_ADDRESSES)):
        workers = _dask_client(workers)
    if hasattr(workers, "get_executor"):
        status = getattr(workers, "status", "running")
        if status not in ("running", "connecting"):
            raise ValueError(f"workers is a Dask client that is {status}; make a new one")
        return workers.get_executor(pure=False)
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


def _ahead(
    pack: Callable[[int], Callable[[int], Outcome]], first: int, count: int, pool: Executor, width: int
) -> Iterator[Outcome]:
    """The tasks from a number on; the rest in threads of this process if the pool is lost."""
    pending: deque[Future[Outcome]] = deque()
    submitted = done = first
    try:
        while done < count:
            try:
                while submitted < count and len(pending) < 2 * width:
                    pending.append(pool.submit(pack(submitted), submitted))
                    submitted += 1
                outcome = _waited_for(pending.popleft(), pool)
            except (BrokenExecutor, CancelledError) as error:
                reason = " ".join(str(error).split()) or "they were cancelled"
                warnings.warn(f"the workers are lost ({reason}); the rest is done in this process", stacklevel=2)
                break
            yield outcome
            done += 1
    finally:
        for future in pending:
            future.cancel()
    if done < count:
        with ThreadPoolExecutor(cores(), thread_name_prefix="nonsac") as threads:
            yield from _ahead(pack, done, count, threads, cores())


def _waited_for(future: Future[Outcome], pool: Executor) -> Outcome:
    """What a task gives; a Dask cluster without workers would wait for new ones for ever."""
    client = getattr(pool, "_client", None)
    if client is None:
        return future.result()
    deserted = 0
    while deserted < 2:
        try:
            return future.result(timeout=_PATIENCE)
        except TimeoutError:
            if future.done():  # it is the task's own, or the task has ended just now
                return future.result()
            deserted = 0 if client.status == "running" and client.nthreads() else deserted + 1
    raise BrokenExecutor("the Dask cluster has no workers left")


def width_of(pool: Executor) -> int:
    """How many tasks a pool runs at once, as far as it tells."""
    client = getattr(pool, "_client", None)
    width = getattr(pool, "_max_workers", None) if client is None else sum(client.nthreads().values())
    return width or cores()


def _dask_client(name: str) -> Any:
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise ValueError(f'workers={name!r} needs Dask: pip install "nonsac[dask]"') from error
    if name == "dask":
        try:
            return distributed.default_client()
        except ValueError as error:
            raise ValueError('workers="dask" needs a distributed.Client; make one, or give the address') from error
    known = [client for client in _clients if client.status == "running" and client.scheduler.address == name]
    if not known:
        try:
            known.append(distributed.Client(name, timeout=_PATIENCE, set_as_default=False))
        except (ValueError, OSError) as error:
            raise ValueError(f"workers={name!r}: no Dask scheduler answers there; check that it is running") from error
        _clients.append(known[0])
    return known[0]


_clients: list[Any] = []  # connections stay open, as a pool of threads would
