import pickle
import threading

import numpy as np

from nonsac.sources import ArraySource, HeldSource
from nonsac.sources.contract import About

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


def test_rows_may_be_read_before_they_are_asked_for():
    source = Counting()
    held = HeldSource(source)
    held.hold(np.array([7, 3]))
    assert sorted(source.taken) == [3, 7]
    np.testing.assert_array_equal(held.take(np.array([3, 7, 3])), ROWS[[3, 7, 3]])
    assert sorted(source.taken) == [3, 7]


class Blocks(Counting):
    """Rows in blocks, on a disk, with names."""

    about = About(("x", "y", "z"), np.array([0, 60, 100]))

    def bytes_to_take(self, rows):
        return 11 * rows


def test_what_is_known_of_the_source_is_known_but_that_its_rows_are_here():
    held = HeldSource(Blocks())
    assert (held.width, len(held), held.about.names) == (3, 100, ("x", "y", "z"))
    assert held.about.blocks.tolist() == [0, 60, 100]
    assert (held.about.in_memory, held.about.keeps_rows) == (True, True)
    assert held.bytes_to_take(3) == 33
    assert (Blocks().about.in_memory, Blocks().about.keeps_rows) == (False, False)


def test_some_columns_of_what_is_held():
    source = Counting()
    narrowed = HeldSource(source).narrowed([2, 0])
    narrowed.hold(np.array([5]))
    np.testing.assert_array_equal(narrowed.take(np.array([5, 5])), ROWS[[5, 5]][:, [2, 0]])
    assert source.taken == [5]
