"""Processes that may die of what they do."""

import os
import threading
import time

import numpy as np
import pytest

from confined_tasks import MB, allocate, die, fail, leave, no_pickle, pid, prepared, unprepared, wait
from nonsac.running.confined import Cancelled, Confined, Reason, failure
from nonsac.running.metered import metered, process_memory

linux = pytest.mark.skipif(process_memory("VmSize") is None, reason="no /proc here")


@pytest.fixture
def process():
    confined = Confined(prepared, 500 * MB)
    yield confined
    confined.close()


def ended(process, task, *arguments, time_limit=60.0):
    outcome = process.call(task, *arguments, time_limit=time_limit)
    return outcome.reason, outcome.detail


def test_one_process_does_many_tasks(process):
    first = process.call(pid, time_limit=60.0).value
    assert first not in (None, os.getpid())
    assert process.call(pid, time_limit=60.0).value == first
    assert process.starts == 1


@linux
def test_memory_is_what_is_taken_beside_what_was_held(process):
    assert process.call(allocate, 300, time_limit=60.0).value == 300 * MB // 8
    reason, detail = ended(process, allocate, 900)
    assert reason is Reason.OUT_OF_MEMORY
    assert "900" in detail or "Unable to allocate" in detail
    assert process.call(allocate, 300, time_limit=60.0).value == 300 * MB // 8  # the same process goes on
    assert process.starts == 1


def test_a_task_over_the_time_limit_ends(process):
    process.call(pid, time_limit=60.0)
    start = time.perf_counter()
    assert ended(process, wait, 60.0, time_limit=0.2) == (Reason.LATE, "more than 0.2 s")
    assert time.perf_counter() - start < 30.0
    assert process.call(pid, time_limit=60.0).value
    assert process.starts == 2


@pytest.mark.parametrize(
    ("task", "argument", "reason", "detail"),
    [
        (die, "double free\n", Reason.CRASHED, "signal 6: double free"),
        (die, "what():  std::bad_alloc\n", Reason.OUT_OF_MEMORY, "what(): std::bad_alloc"),
        (die, "kill", Reason.OUT_OF_MEMORY, "it was killed"),
        (leave, 7, Reason.CRASHED, "exit code 7"),
        (leave, 0, Reason.CRASHED, "exit code 0"),
    ],
)
def test_deaths_are_outcomes(process, task, argument, reason, detail):
    found = ended(process, task, argument)
    assert (found[0], " ".join(found[1].split())) == (reason, detail)
    assert process.call(pid, time_limit=60.0).value


def test_exceptions_are_outcomes(process):
    assert ended(process, fail) == (Reason.FAILED, "KeyError: 'key'")
    assert ended(process, no_pickle)[0] is Reason.FAILED
    assert process.starts == 1


def test_what_cannot_be_prepared_is_an_outcome():
    process = Confined(unprepared, 500 * MB)
    assert ended(process, pid) == (Reason.FAILED, "ValueError: nothing to prepare")
    process.close()


def test_another_thread_cancels(process):
    process.call(pid, time_limit=60.0)
    timer = threading.Timer(0.3, process.cancel)
    timer.start()
    start = time.perf_counter()
    with pytest.raises(Cancelled):
        process.call(wait, 60.0, time_limit=60.0)
    assert time.perf_counter() - start < 30.0
    with pytest.raises(Cancelled):
        process.call(pid, time_limit=60.0)
    timer.join()


def test_memory_is_told_by_the_message():
    assert failure("numpy._core._exceptions._ArrayMemoryError: Unable to allocate").reason is Reason.OUT_OF_MEMORY
    assert failure("ValueError: \n  two lines").detail == "ValueError: two lines"


@linux
def test_what_work_takes():
    with metered() as used:
        np.ones(80 * MB // 8).sum()  # more than the system keeps for this process after earlier work
        time.sleep(0.05)
    assert used.seconds >= 0.05
    assert used.cpu_seconds < used.seconds + 1.0
    assert 70 * MB < used.memory < 120 * MB
