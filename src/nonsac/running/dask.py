"""Dask clusters: the client that is meant, and answers in bounded time, which Dask itself does not promise."""

from __future__ import annotations

import asyncio
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from importlib import import_module
from typing import Any, TypeVar

Answer = TypeVar("Answer")

PATIENCE = 10.0  # seconds, for an answer of a scheduler, and between looks at whether a cluster still has workers
_ADDRESSES = ("tcp://", "tls://", "ucx://", "ws://", "wss://", "inproc://")


def executor_of(workers: object) -> Executor | None:
    """The executor of a Dask client, of "dask" or of a scheduler's address; None if it is none of these.

    Raises
    ------
    ValueError
        If there is no such client or scheduler, or it cannot be used.
    """
    if isinstance(workers, str) and (workers == "dask" or workers.startswith(_ADDRESSES)):
        workers = _client_named(workers)
    if not hasattr(workers, "get_executor"):
        return None
    status = getattr(workers, "status", "running")
    if status not in ("running", "connecting"):
        raise ValueError(f"workers is a Dask client that is {status}; make a new one")
    if getattr(workers, "asynchronous", False):
        raise ValueError("workers is an asynchronous Dask client; make one with asynchronous=False")
    executor: Executor = workers.get_executor(pure=False)
    return executor


def client_of(pool: Executor) -> Any:
    """The Dask client behind an executor; None if there is none."""
    return getattr(pool, "_client", None)


def threads_of(client: Any) -> int:
    """How many threads the workers of a cluster have; 0 if its scheduler does not answer."""
    try:
        return sum(_in_time(client.nthreads).values())
    except (TimeoutError, OSError):
        return 0


def is_in_task_of(client: Any) -> bool:
    """Whether this thread is at work on a task of the client's cluster."""
    distributed: Any = sys.modules.get("distributed")
    if distributed is None:
        return False
    try:
        return bool(distributed.get_worker().scheduler.address == client.scheduler.address)
    except (ValueError, AttributeError):  # in no task; a client that was closed meanwhile
        return False


def _client_named(name: str) -> Any:
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
            _check_answers(name, distributed)
            known.append(distributed.Client(name, timeout=PATIENCE, set_as_default=False))
        except Exception as error:  # what is no scheduler may send anything
            raise ValueError(f"workers={name!r}: no Dask scheduler answers there; check that it is running") from error
        _clients.append(known[0])
    return known[0]


_clients: list[Any] = []  # connections stay open, as a pool of threads would


def _check_answers(address: str, distributed: Any) -> None:
    """Before a client is made: that one waits for ever for what accepts a connection and says nothing."""

    async def identity() -> Any:
        security = distributed.Security().get_connection_args("client")
        async with distributed.rpc(address, timeout=PATIENCE, connection_args=security) as server:
            return await server.identity()

    _in_time(lambda: asyncio.run(asyncio.wait_for(identity(), PATIENCE)))


def _in_time(call: Callable[[], Answer]) -> Answer:
    """What a call gives; a TimeoutError after twice the patience. It has a thread without an event loop."""
    answer: Future[Answer] = Future()

    def run() -> None:
        try:
            answer.set_result(call())
        except BaseException as error:
            answer.set_exception(error)

    threading.Thread(target=run, daemon=True, name="nonsac-dask").start()
    return answer.result(timeout=2.0 * PATIENCE)
