import numpy as np
import pytest

from nonsac.sources.blocks import BlockSource

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


def test_no_rows():
    source = Counting(starts=(0,))
    assert len(source) == 0
    assert list(source.chunks(5)) == []
    assert source.take(np.empty(0, np.int64)).shape == (0, 3)
