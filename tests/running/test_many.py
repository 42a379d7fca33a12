"""Many small tasks in few messages: order, sizes, and what is lost with a worker."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from batch_samples import troublesome
from nonsac.running import many
from nonsac.running.many import pool_of, run_many
from nonsac.running.processes import WorkerDied


def square(number):
    return number * number


class Counting(ThreadPoolExecutor):
    """Notes how many items each message has."""

    def __init__(self, count):
        super().__init__(count)
        self.sizes = []

    def submit(self, task, items):
        self.sizes.append(len(items))
        return super().submit(task, items)


def test_small_tasks_go_together_once_it_is_known_that_they_are_small():
    with Counting(2) as pool:
        outcomes = list(run_many(square, range(1000), pool, together=True))
    assert outcomes == [(number, number * number) for number in range(1000)]
    assert pool.sizes[0] == 1
    assert max(pool.sizes) == 64
    assert len(pool.sizes) < 50


def test_large_tasks_go_alone(monkeypatch):
    monkeypatch.setattr(many, "_SECONDS_OF_MESSAGE", 0.0)  # any task takes longer
    with Counting(2) as pool:
        list(run_many(square, range(6), pool, together=True))
    assert pool.sizes == [1] * 6


def test_tasks_that_may_not_wait_for_others_go_alone():
    with Counting(2) as pool:
        list(run_many(square, range(50), pool))
    assert pool.sizes == [1] * 50


def test_what_fails_takes_its_own_place_in_a_message():
    with Counting(1) as pool:
        outcomes = dict(run_many(troublesome, [*range(11), *range(12, 200)], pool, together=True))
    assert str(outcomes.pop(7)) == "seven"
    assert outcomes == {number: number * number for number in [*range(7), *range(8, 11), *range(12, 200)]}


@pytest.mark.parametrize("start", [0, 11])
def test_what_kills_its_process_takes_its_own_place_in_a_message(start):
    """Also as the first one, when it goes alone; the others of its message are sent anew."""
    numbers = list(range(start, 100))
    with pool_of(2) as pool:
        outcomes = dict(run_many(troublesome, numbers, pool, together=True))
    assert list(outcomes) == numbers
    assert isinstance(outcomes.pop(11), WorkerDied)
    if start == 0:
        assert isinstance(outcomes.pop(7), ValueError)
    assert outcomes == {number: number * number for number in outcomes}


def test_no_more_is_taken_than_two_messages_for_each_worker():
    taken = []
    with Counting(2) as pool:
        outcomes = run_many(square, (taken.append(k) or k for k in range(10_000)), pool, together=True)
        for given in range(1, 2000):
            next(outcomes)
            assert len(taken) <= given + 5 * 64
        outcomes.close()


def test_all_in_this_process_without_a_pool():
    with pool_of(1) as pool:
        assert pool is None
        assert dict(run_many(square, range(5), pool)) == {0: 0, 1: 1, 2: 4, 3: 9, 4: 16}
