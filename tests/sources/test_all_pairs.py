import numpy as np
import pytest

from nonsac.sources import AllPairsSource, ArraySource, HeldSource
from nonsac.sources.blocks import EvenBlockSource


def test_row_number_counts_through_the_second_array_first():
    a, b = np.array([[1.0, 2], [3, 4]]), np.array([[10.0], [20], [30]])
    source = AllPairsSource(a, b)
    assert (len(source), source.width) == (6, 3)
    expected = [[1, 2, 10], [1, 2, 20], [1, 2, 30], [3, 4, 10], [3, 4, 20], [3, 4, 30]]
    np.testing.assert_array_equal(source.take(np.arange(6)), expected)


def test_a_million_times_a_million_points_take_no_memory():
    a = np.arange(3_000_000.0).reshape(-1, 3)
    source = AllPairsSource(a, a)
    assert len(source) == 10**12
    np.testing.assert_array_equal(
        source.take(np.array([10**12 - 1, 123_456_789_012])), np.hstack([a[[999_999, 123_456]], a[[999_999, 789_012]]])
    )


@pytest.mark.parametrize("shapes", [((0, 3), (4, 3)), ((4, 3), (0, 3))])
def test_an_empty_array_has_no_pairs(shapes):
    source = AllPairsSource(*map(np.zeros, shapes))
    assert len(source) == 0
    assert list(source.chunks(10)) == []


def test_too_many_pairs_are_refused():
    wide = np.broadcast_to(np.zeros((1, 3)), (2**31, 3))
    with pytest.raises(ValueError, match=r"2147483648 x 2147483648 pairs are more than 2\^62"):
        AllPairsSource(wide, wide)


class Blocks(EvenBlockSource):
    """Ten rows (i, i), in blocks of two."""

    def __init__(self):
        super().__init__(10, 2, 2, stored=1000)
        self.read = []

    def read_block(self, block):
        self.read.append(block)
        return np.repeat(np.arange(*self.bounds(block), dtype=float)[:, None], 2, axis=1)


def test_parts_in_blocks_are_kept_once_they_are_read():
    blocks = Blocks()
    source = AllPairsSource(np.arange(3.0)[:, None], blocks)
    assert isinstance(source.b, HeldSource)
    assert (source.about.blocks, source.about.in_memory, source.about.keeps_rows) == (None, True, True)
    source.hold(np.array([0, 13, 29]))
    assert blocks.read == [0, 1, 4]
    np.testing.assert_array_equal(source.take(np.array([29, 13, 0])), [[2, 9, 9], [1, 3, 3], [0, 0, 0]])
    assert blocks.read == [0, 1, 4]


def test_bytes_are_those_of_both_parts():
    assert AllPairsSource(Blocks(), Blocks()).bytes_to_take(10**6) == 2000
    plain = AllPairsSource(ArraySource(np.zeros((4, 2))), np.zeros((3, 1)))
    assert plain.bytes_to_take(5) == 0
    assert (plain.about.in_memory, plain.about.keeps_rows) == (True, False)
