import pickle

import numpy as np
import pytest

from nonsac.sources.blocks import BlockSource, EvenBlockSource, block_rows
from nonsac.sources.contract import About

ROWS = np.arange(30.0).reshape(10, 3)


class Counting(BlockSource):
    def __init__(self, starts=(0, 4, 4, 9, 10)):
        super().__init__(np.array(starts), 3)
        self.read = []

    def read_block(self, block):
        self.read.append(block)
        return ROWS[self.block_starts[block] : self.block_starts[block + 1]].copy()


@pytest.mark.parametrize("indices", [[], [0], [9, 0, 5, 5], range(10), [4, 3]])
def test_rows_are_those_asked_for_in_their_order(indices):
    indices = np.array(indices, np.int64)
    np.testing.assert_array_equal(Counting().take(indices), ROWS[indices])


def test_only_blocks_that_hold_a_row_are_read_and_each_once():
    source = Counting()
    source.take(np.array([8, 0, 3, 7]))
    assert source.read == [0, 2]


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 9, 10, 11])
@pytest.mark.parametrize(("start", "stop"), [(0, None), (0, 4), (3, 5), (4, 4), (9, 10), (2, 9), (5, 99)])
def test_chunks_go_across_blocks(size, start, stop):
    chunks = list(Counting().chunks(size, start, stop))
    assert all(len(chunk) == size for chunk in chunks[:-1])
    assert all(len(chunk) for chunk in chunks)
    np.testing.assert_array_equal(np.vstack([np.empty((0, 3)), *chunks]), ROWS[start:stop])


def test_a_range_reads_its_own_blocks_only():
    source = Counting()
    list(source.chunks(2, 4, 9))
    assert source.read == [2]


def test_the_largest_block_is_known_without_reading():
    source = Counting()
    assert (source.about.largest_block, source.read) == (5, [])
    assert About().largest_block == 0


def test_no_rows():
    source = Counting(starts=(0,))
    assert (len(source), source.about.largest_block) == (0, 0)
    assert list(source.chunks(5)) == []
    assert source.take(np.empty(0, np.int64)).shape == (0, 3)


@pytest.mark.parametrize("number", [-1, 10])
def test_a_row_that_does_not_exist_is_an_error(number):
    with pytest.raises(IndexError, match=f"no row {number}: rows are numbered from 0 to 9"):
        Counting().take(np.array([3, number]))


class Even(EvenBlockSource):
    def __init__(self, rows, size):
        super().__init__(rows, size, 3, stored=1000)

    def read_block(self, block):
        return ROWS[slice(*self.bounds(block))].copy()


@pytest.mark.parametrize(
    ("rows", "size", "starts"), [(10, 4, [0, 4, 8, 10]), (8, 4, [0, 4, 8]), (3, 4, [0, 3]), (0, 4, [0])]
)
def test_even_blocks(rows, size, starts):
    source = Even(rows, size)
    np.testing.assert_array_equal(source.about.blocks, starts)
    np.testing.assert_array_equal(source.take(np.arange(rows)[::-1]), ROWS[:rows][::-1])


def test_starts_of_even_blocks_do_not_travel():
    source = Even(10**6, 2)
    told = pickle.dumps(source)
    assert len(told) < 200
    np.testing.assert_array_equal(pickle.loads(told).about.blocks, source.about.blocks)


def test_bytes_of_even_blocks():
    source = Even(10, 2)
    assert [source.bytes_to_take(rows) for rows in (0, 1, 10**6)] == [0, 200, 1000]


@pytest.mark.parametrize(
    ("chunk", "width", "rows"),
    [(1000, 4, 65_000), (1, 4, 65_536), (70_000, 4, 70_000), (40_000, 4, 40_000), (7, 10**6, 7)],
)
def test_blocks_are_whole_chunks_of_about_2_mib(chunk, width, rows):
    assert block_rows(chunk, width) == rows
