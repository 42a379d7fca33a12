"""SIGTERM as an exception, as Ctrl-C is one: temporary files are removed, and a batch says what is kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

TERMINATED = 143


class Terminated(BaseException):
    """The process was told to end."""


@contextmanager
def termination_raised() -> Iterator[None]:
    """Raise `Terminated` in the main thread, which alone may say what a signal does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, _raise)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _raise(number: int, frame: object) -> NoReturn:
    signal.signal(number, signal.SIG_IGN)  # once is enough: what follows cleans up
    raise Terminated
