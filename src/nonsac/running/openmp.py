"""How many threads libraries may start that use OpenMP."""

from __future__ import annotations

import multiprocessing
import os

from nonsac.running.executors import cores

_FIRST_PROCESS = os.getpid()


def openmp_threads() -> int:
    """One for each core, but only one in a process that was forked, or is a worker of `multiprocessing`.

    A fork copies what OpenMP remembers of its threads, but not the threads: the next team of them would wait for ever.
    One thread is no team. Workers are as many as there are cores already.
    """
    forked = os.getpid() != _FIRST_PROCESS or multiprocessing.parent_process() is not None
    return 1 if forked else cores()
