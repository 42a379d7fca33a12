import math
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from concurrent.futures import BrokenExecutor, CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import pytest

from nonsac.running.executors import ordered_map, parsed, waited_for


def square(i):
    return i * i


def fails_at_3(i):
    if i == 3:
        raise RuntimeError("sample 3 failed")
    return i


class Recorder:
    """A task that is slower for earlier numbers and remembers which numbers ran."""

    def __init__(self, seconds=0.0):
        self.seconds, self.started, self.lock = seconds, [], threading.Lock()

    def __call__(self, i):
        with self.lock:
            self.started.append(i)
        time.sleep(self.seconds)
        return i


def finished(value):
    future = Future()
    future.set_result(value)
    return future


workers = pytest.mark.parametrize("workers", [None, 1, 2, 5])


@workers
@pytest.mark.parametrize("count", [0, 1, 2, 30])
def test_outcomes_come_in_order(workers, count):
    assert list(ordered_map(square, count, workers)) == [i * i for i in range(count)]


def test_outcomes_come_in_order_when_early_tasks_are_slow():
    def slow_first(i):
        time.sleep(0.02 if i % 4 == 0 else 0.0)
        return i

    assert list(ordered_map(slow_first, 16, 4)) == list(range(16))


def test_an_executor_of_threads_is_used_and_left_running():
    names = []
    with ThreadPoolExecutor(2, thread_name_prefix="mine") as pool:
        assert list(ordered_map(lambda i: names.append(threading.current_thread().name) or i, 9, pool)) == list(
            range(9)
        )
        assert pool.submit(square, 5).result() == 25
    assert all(name.startswith("mine") for name in names)


def test_an_executor_of_processes_gives_the_same():
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        # A function that the new processes can import, wherever the tests lie.
        assert list(ordered_map(math.factorial, 20, pool)) == [math.factorial(i) for i in range(20)]
        assert pool.submit(math.factorial, 5).result() == 120


def test_one_worker_runs_in_the_calling_thread():
    names = list(ordered_map(lambda i: threading.current_thread(), 3, 1))
    assert set(names) == {threading.main_thread()}


@workers
def test_exceptions_reach_the_caller_after_the_outcomes_before_them(workers):
    outcomes = ordered_map(fails_at_3, 10, workers)
    assert [next(outcomes) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(RuntimeError, match="sample 3 failed"):
        next(outcomes)


@pytest.mark.parametrize("width", [1, 2, 4])
def test_closing_early_cancels_what_has_not_started(width):
    task = Recorder(0.005)
    outcomes = ordered_map(task, 1000, width)
    assert [next(outcomes), next(outcomes)] == [0, 1]
    outcomes.close()
    ran = len(task.started)
    assert ran <= 2 + 2 * width + width
    time.sleep(0.03)
    assert len(task.started) == ran


def test_closing_early_cancels_every_future_in_waiting():
    class Never(ThreadPoolExecutor):
        """Finishes the first task only."""

        def submit(self, function, /, *args):
            futures.append(finished(function(*args)) if not futures else Future())
            return futures[-1]

    futures = []
    with Never(3) as pool:
        outcomes = ordered_map(square, 100, pool)
        assert next(outcomes) == 0
        outcomes.close()
    assert len(futures) > 3
    assert all(future.cancelled() for future in futures[1:])


def test_closing_early_leaves_the_callers_executor_usable():
    with ThreadPoolExecutor(2) as pool:
        outcomes = ordered_map(Recorder(0.005), 1000, pool)
        next(outcomes)
        outcomes.close()
        assert pool.submit(square, 3).result(timeout=5) == 9


def test_only_a_few_tasks_run_ahead_of_a_slow_caller():
    task = Recorder()
    outcomes = ordered_map(task, 1000, 2)
    next(outcomes)
    time.sleep(0.05)
    assert len(task.started) <= 5
    outcomes.close()


def test_two_workers_work_at_the_same_time():
    both = threading.Barrier(2, timeout=5)
    list(ordered_map(lambda i: both.wait() if i < 2 else None, 4, 2))


def test_an_executor_without_a_known_width_is_served():
    class Immediate(ThreadPoolExecutor):
        def __init__(self):
            super().__init__(1)
            del self._max_workers

        def submit(self, function, /, *args):
            return finished(function(*args))

    assert list(ordered_map(square, 50, Immediate())) == [i * i for i in range(50)]


class Dying(ThreadPoolExecutor):
    """Does some tasks; then its workers are gone."""

    def __init__(self, lives, error):
        super().__init__(2)
        self.lives, self.error = lives, error

    def submit(self, function, /, *args):
        self.lives -= 1
        future = Future()
        if self.lives == -3:
            raise self.error
        if self.lives < 0:
            future.set_exception(self.error)
        else:
            future.set_result(function(*args))
        return future


@pytest.mark.parametrize("error", [BrokenExecutor("a worker died"), CancelledError()], ids=["broken", "cancelled"])
@pytest.mark.parametrize("lives", [0, 1, 5, 19, 30])
def test_where_workers_die_the_rest_is_done_here(lives, error):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert list(ordered_map(square, 20, Dying(lives, error))) == [i * i for i in range(20)]
    assert len(caught) == (lives < 20)
    assert all("the rest is done in this process" in str(warning.message) for warning in caught)


def kill_worker(i):
    if i == 3 and multiprocessing.parent_process() is not None:
        os.kill(os.getpid(), signal.SIGKILL)
    return i * i


def test_a_killed_process_costs_time_only():
    context = get_context("fork")  # the function of a test module does not travel to a new interpreter
    with ProcessPoolExecutor(2, mp_context=context) as pool, pytest.warns(UserWarning, match="the workers are lost"):
        assert list(ordered_map(kill_worker, 12, pool)) == [i * i for i in range(12)]


class EndsAsTheWaitDoes(Future):
    """A task that ends just after the patience with it."""

    def result(self, timeout=None):
        if not self.done():
            self.set_result(7)
            raise TimeoutError
        return super().result()


def test_a_task_that_ends_as_the_patience_does_is_no_error():
    pool = ThreadPoolExecutor(1)
    pool._client = None
    assert waited_for(finished(1), pool) == 1
    pool._client = object()
    assert waited_for(EndsAsTheWaitDoes(), pool) == 7
    own = Future()
    own.set_exception(TimeoutError("the task's own"))
    with pytest.raises(TimeoutError, match="the task's own"):
        waited_for(own, pool)
    pool.shutdown()


class ClosedClient:
    status = "closed"

    def get_executor(self, pure):
        raise AssertionError("it is closed")


def test_a_closed_client_is_refused():
    with pytest.raises(ValueError, match="a Dask client that is closed; make a new one"):
        list(ordered_map(square, 3, ClosedClient()))


class Journeys(ThreadPoolExecutor):
    """Counts what is sent, and how many tasks may run at once."""

    def __init__(self, width):
        super().__init__(width)
        self.sent = []

    def submit(self, function, /, *args):
        self.sent.append(args[0])
        return super().submit(function, *args)


@pytest.mark.parametrize("together", [1, 2, 4, 50])
@pytest.mark.parametrize("count", [1, 3, 7, 60])
def test_tasks_that_travel_together_come_in_order(count, together):
    with Journeys(2) as pool:
        assert list(ordered_map(square, count, pool, together=together)) == [i * i for i in range(count)]
        packed = list(ordered_map(square, count, pool, lambda i: lambda number: (i, number), together))
        assert packed == [(i, i) for i in range(count)]


def test_there_are_fewer_journeys_at_first_and_single_tasks_at_the_end():
    with Journeys(2) as pool:
        list(ordered_map(square, 60, pool, together=4))
    sizes = [after - before for before, after in zip(pool.sent, [*pool.sent[1:], 60], strict=True)]
    assert sizes[:8] == [4] * 8
    assert sizes[-6:] == [1] * 6
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.parametrize("together", [1, 2, 4, 50])
def test_what_fails_among_others_raises_after_the_outcomes_before_it(together):
    with ThreadPoolExecutor(1) as pool:
        outcomes = ordered_map(fails_at_3, 60, pool, together=together)
        assert [next(outcomes) for _ in range(3)] == [0, 1, 2]
        with pytest.raises(RuntimeError, match="sample 3 failed"):
            next(outcomes)


def test_what_fails_once_among_others_is_done_again_and_so_are_those_after_it():
    failed, lock = set(), threading.Lock()

    def fails_once(i):
        with lock:
            if i in (3, 8, 11) and i not in failed:  # not the first of their rows
                failed.add(i)
                raise RuntimeError(i)
        return i

    with ThreadPoolExecutor(1) as pool:
        assert list(ordered_map(fails_once, 20, pool, together=6)) == list(range(20))


def test_a_task_may_be_packed_for_the_way():
    """Of which only a part is sent to an executor; threads of this process get the task itself."""

    def task(i):
        return "whole", i

    def pack(i):
        return lambda number: (i, number)

    with ThreadPoolExecutor(2) as pool:
        assert list(ordered_map(task, 5, pool, pack)) == [(i, i) for i in range(5)]
    assert list(ordered_map(task, 5, 2, pack)) == [("whole", i) for i in range(5)]


@pytest.mark.parametrize("wrong", [0, -1, True, 2.0, "2", "threads"])
def test_other_workers_are_refused_by_name(wrong):
    with pytest.raises(ValueError, match="workers must be"):
        list(ordered_map(square, 3, wrong))


def test_a_task_may_use_the_executor_that_it_runs_on():
    """It would wait for a thread while it occupies the only one."""
    pool = ThreadPoolExecutor(1)
    try:
        inside = pool.submit(lambda: list(ordered_map(square, 5, pool)))
        assert inside.result(timeout=30) == [0, 1, 4, 9, 16]
        assert parsed(pool) is pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


@pytest.mark.parametrize("made", ["ThreadPoolExecutor(1)", "ProcessPoolExecutor(1, mp_context=fork)"])
def test_an_executor_that_was_copied_by_a_fork_is_refused(made):
    """Its threads are not in the copy, and nothing would ever be done."""
    script = f"""
import sys, multiprocessing, warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
warnings.simplefilter("ignore")
from nonsac.running.executors import ordered_map
fork = multiprocessing.get_context("fork")
pool = {made}
print(list(ordered_map(abs, 3, pool)), flush=True)
def inside():
    try:
        list(ordered_map(abs, 3, pool))
    except ValueError as error:
        print(error, flush=True)
child = fork.Process(target=inside)
child.start()
child.join(60)
print(child.exitcode, flush=True)
child.kill()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    numbers, refusal, code = done.stdout.splitlines()
    assert numbers == "[0, 1, 2]"
    assert refusal.endswith("which cannot work here; make one in this process, or give a number")
    assert code == "0"
