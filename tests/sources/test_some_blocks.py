import pickle

import numpy as np
import pytest

from nonsac.sources import ArraySource, HeldSource, MappedSource, SomeBlocksSource
from nonsac.sources.contract import About
from nonsac.sources.some_blocks import whole

ROWS = np.arange(60.0).reshape(20, 3)
FIRSTS, ENDS = np.array([2, 11, 15]), np.array([5, 12, 19])
NUMBERS = [2, 3, 4, 11, 15, 16, 17, 18]


class Blocks(ArraySource):
    about = About(("x", "y", "z"), np.array([0, 2, 5, 11, 12, 15, 19, 20]))

    def bytes_to_take(self, rows):
        return 10 * min(rows, 20)


def test_rows_are_those_of_the_blocks():
    some = SomeBlocksSource(ArraySource(ROWS), FIRSTS, ENDS)
    assert (len(some), some.width) == (8, 3)
    np.testing.assert_array_equal(some.take(np.arange(8)), ROWS[NUMBERS])
    np.testing.assert_array_equal(some.take(np.array([7, 0, 7])), ROWS[[18, 2, 18]])
    np.testing.assert_array_equal(np.concatenate(list(some.chunks(3, 1, 7))), ROWS[NUMBERS[1:7]])


def test_which_block_a_row_lies_in():
    some = SomeBlocksSource(ArraySource(ROWS), FIRSTS, ENDS)
    assert some.blocks_of(np.arange(8)).tolist() == [0, 0, 0, 1, 2, 2, 2, 2]


@pytest.mark.parametrize("wrong", [-1, 8])
def test_other_rows_there_are_not(wrong):
    with pytest.raises(IndexError, match=f"there is no row {wrong}: rows are numbered from 0 to 7"):
        SomeBlocksSource(ArraySource(ROWS), FIRSTS, ENDS).take(np.array([wrong]))


def test_what_is_known_of_it():
    some = SomeBlocksSource(Blocks(ROWS), FIRSTS, ENDS)
    assert some.about.blocks.tolist() == [0, 3, 4, 8]
    assert some.about.names == ("x", "y", "z")
    assert (some.bytes_to_take(3), some.bytes_to_take(8)) == (30, 80)
    assert SomeBlocksSource(ArraySource(ROWS), FIRSTS, ENDS).about.blocks is None


def test_it_travels():
    some = pickle.loads(pickle.dumps(SomeBlocksSource(ArraySource(ROWS), FIRSTS, ENDS)))
    np.testing.assert_array_equal(some.take(np.arange(8)), ROWS[NUMBERS])


def test_the_whole_of_it():
    source = MappedSource(ArraySource(ROWS), np.negative)
    assert whole(HeldSource(SomeBlocksSource(source, FIRSTS, ENDS))) is source
    assert whole(source) is source
