import numpy as np
import pytest

from nonsac.sources import AllPairsSource


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
