"""What a source of somebody's own gets without writing it."""

import pickle

import numpy as np
import pytest

import nonsac
from nonsac import ArraySource, Source, simulate
from nonsac.testing import check_source

ROWS = np.arange(60.0).reshape(20, 3)


class Mine(Source):
    """No more than it has to have; its rows are made when they are asked for."""

    def __init__(self, rows=ROWS):
        self.rows, self.asked = rows, []

    def __len__(self):
        return len(self.rows)

    def take(self, indices):
        self.asked.append(len(indices))
        return self.rows[self.checked(indices)]


def test_rows_and_their_number_are_enough():
    check_source(Mine(), ROWS)
    check_source(Mine().narrowed([1]), ROWS[:, [1]])


def test_the_width_is_that_of_no_rows_and_asked_for_once():
    source = Mine()
    assert [source.width, source.width] == [3, 3]
    assert source.asked == [0]
    assert pickle.loads(pickle.dumps(source)).width == 3
    source.width = 2
    assert source.width == 2


def test_nothing_is_known_of_it():
    about = Mine().about
    assert (about.names, about.blocks, about.in_memory, about.keeps_rows) == (None, None, False, False)
    assert about.largest_block == 0
    assert Mine().hold(np.arange(3)) is None


def test_every_number_is_taken_to_be_read():
    assert Mine().bytes_to_take(7) == 7 * 3 * 8

    class InMemory(Mine):
        about = ArraySource(ROWS).about

    assert InMemory().bytes_to_take(7) == 0


def test_chunks_read_no_more_than_they_give():
    source = Mine()
    chunks = source.chunks(8, 1, 1000)
    assert source.asked == []
    np.testing.assert_array_equal(next(chunks), ROWS[1:9])
    assert source.asked == [8]
    assert [len(chunk) for chunk in chunks] == [8, 3]


@pytest.mark.parametrize("numbers", [[20], [3, -1], [-1, 20], [10**9]])
def test_a_row_that_does_not_exist_is_named(numbers):
    worst = min(numbers) if min(numbers) < 0 else max(numbers)
    with pytest.raises(IndexError, match=f"there is no row {worst}: rows are numbered from 0 to 19"):
        Mine().take(np.array(numbers))


@pytest.mark.parametrize("numbers", [[], [0, 19, 19], range(20)])
def test_row_numbers_that_exist_are_passed_on(numbers):
    checked = Mine().checked(numbers)
    assert checked.dtype == np.int64
    assert checked.tolist() == list(numbers)


def test_without_rows_or_their_number_it_is_refused_by_name():
    class NoRows(Source):
        def __len__(self):
            return 0

    class NoNumber(Source):
        def take(self, indices):
            return ROWS[indices]

    for kind, missing in ((NoRows, "take"), (NoNumber, "__len__")):
        with pytest.raises(TypeError, match=f"{kind.__name__}.*{missing}"):
            kind()


@pytest.mark.parametrize("workers", [1, 2])
def test_the_answer_is_that_of_the_array(workers):
    pairs = simulate.registration(3000, 0.5, 0.01, 1)
    rows = np.hstack([pairs.source, pairs.target])
    mine, expected = (
        nonsac.register_pairs(source, noise=0.01, workers=workers) for source in (Mine(rows), ArraySource(rows))
    )
    assert expected.success
    assert mine.T.tobytes() == expected.T.tobytes()
