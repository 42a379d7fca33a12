"""Many tasks on processes or any executor: in order, several in one message if they are small."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any, Generic, TypeVar

from nonsac.running.executors import Workers, parsed, waited_for, width_of
from nonsac.running.processes import CannotStart, WorkerProcesses, can_spawn, portable

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_SECONDS_OF_MESSAGE, _MOST_IN_MESSAGE = 0.1, 64


@contextmanager
def pool_of(workers: Workers) -> Iterator[Executor | None]:
    """The executor that workers stand for, processes if they are a number; None for the calling process."""
    count = parsed(workers)
    if isinstance(count, Executor):
        yield count
        return
    if count == 1:
        yield None
        return
    pool = WorkerProcesses(count)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def run_many(
    task: Callable[[Item], Answer],
    items: Iterable[Item],
    pool: Executor | None,
    *,
    apart: Callable[[Item], bool] = lambda item: False,
    together: bool = False,
) -> Iterator[tuple[Item, Answer | Exception]]:
    """The task's answer for each item, or the exception, in the order of the items.

    Parameters
    ----------
    task : callable
    items : iterable
        Taken as they are needed: at most two messages for each worker ahead of what was given back.
    pool : Executor or None
        None is the calling process.
    apart : callable, optional
        Whether an item may end the process. If there is no pool, such items get a process of their own, if they can.
    together : bool
        Whether small items may wait for others, to be sent in one message.
    """
    if pool is None:
        yield from _here(task, items, apart)
        return
    pending: deque[_Message[Item, Answer]] = deque()
    ahead, size, source = 2 * width_of(pool), 1, iter(items)
    try:
        while some := list(islice(source, size)):
            pending.append(_Message(task, some, pool))
            while pending and (len(pending) >= ahead or pending[0].future.done()):
                message = pending.popleft()
                yield from message.outcomes()
                size = message.fitting_size if together else 1
        while pending:
            yield from pending.popleft().outcomes()
    finally:
        for message in pending:
            message.future.cancel()


class _Message(Generic[Item, Answer]):
    """Some items on their way."""

    def __init__(self, task: Callable[[Item], Answer], items: list[Item], pool: Executor) -> None:
        self._task, self._items, self._pool = task, items, pool
        self.future: Future[_Reply[Answer]] = pool.submit(_Several(task), items)
        self.fitting_size = 1

    def outcomes(self) -> Iterator[tuple[Item, Answer | Exception]]:
        """What came of the items; if the message was lost, they are sent anew, one by one."""
        try:
            reply = waited_for(self.future, self._pool)
        except (CannotStart, BrokenExecutor):
            raise
        except Exception as error:
            if len(self._items) == 1:
                yield self._items[0], error
                return
            for message in [_Message(self._task, [item], self._pool) for item in self._items]:
                yield from message.outcomes()
            return
        fitting = _SECONDS_OF_MESSAGE * len(self._items) / max(reply.seconds, 1e-6)
        self.fitting_size = max(1, min(int(fitting), _MOST_IN_MESSAGE))
        yield from zip(self._items, reply.outcomes, strict=True)


@dataclass(frozen=True)
class _Reply(Generic[Answer]):
    outcomes: list[Answer | Exception]
    seconds: float


@dataclass(frozen=True)
class _Several(Generic[Item, Answer]):
    """The task for some items; what one of them raises is its own outcome."""

    task: Callable[[Item], Answer]

    def __call__(self, items: list[Item]) -> _Reply[Answer]:
        start = time.perf_counter()
        outcomes = [self._outcome(item) for item in items]
        return _Reply(outcomes, time.perf_counter() - start)

    def _outcome(self, item: Item) -> Answer | Exception:
        try:
            return self.task(item)
        except Exception as error:
            return portable(error)


def _here(
    task: Callable[[Item], Answer], items: Iterable[Item], apart: Callable[[Item], bool]
) -> Iterator[tuple[Item, Answer | Exception]]:
    """In this process, except for items that may end it."""
    pool: WorkerProcesses | None = None
    try:
        for item in items:
            answer: Any
            try:
                if apart(item) and can_spawn((task, item)):
                    pool = pool or WorkerProcesses(1)
                    answer = pool.submit(task, item).result()
                else:
                    answer = task(item)
            except (CannotStart, BrokenExecutor):
                raise
            except Exception as error:
                answer = error
            yield item, answer
    finally:
        if pool is not None:
            pool.shutdown(cancel_futures=True)
