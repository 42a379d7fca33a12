import pickle
import threading

import numpy as np

from nonsac.sources import ArraySource, HeldSource

ROWS = np.arange(300.0).reshape(100, 3)


class Counting(ArraySource):
    def __init__(self, rows=ROWS):
        super().__init__(rows)
        self.taken = []

    def take(self, indices):
        self.taken.extend(indices.tolist())
        return super().take(indices)


def test_no_row_is_read_twice():
    source = Counting()
    held = HeldSource(source)
    for indices in ([5, 3, 5], [3], [99, 0, 5, 4], range(100), [7, 7]):
        indices = np.array(indices)
        np.testing.assert_array_equal(held.take(indices), ROWS[indices])
    assert sorted(source.taken) == list(range(100))


def test_what_is_taken_is_the_callers_own():
    held = HeldSource(Counting())
    held.take(np.array([1, 2]))[:] = -1.0
    np.testing.assert_array_equal(held.take(np.array([1, 2])), ROWS[[1, 2]])


def test_threads_may_take_at_once():
    held, wrong = HeldSource(Counting()), []

    def work(seed):
        for _ in range(50):
            indices = np.random.default_rng(seed).integers(100, size=20)
            if not np.array_equal(held.take(indices), ROWS[indices]):
                wrong.append(seed)

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    assert len(held.source.taken) <= 100


def test_what_is_held_does_not_travel():
    held = HeldSource(ArraySource(ROWS))
    held.take(np.arange(100))
    assert len(pickle.dumps(held)) < len(pickle.dumps(ArraySource(ROWS))) + 200
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(held)).take(np.array([3])), ROWS[[3]])


def test_other_attributes_are_those_of_the_source():
    source = Counting()
    source.names = ("x", "y", "z")
    assert HeldSource(source).names == ("x", "y", "z")
    assert not hasattr(HeldSource(source), "bytes_to_take")
