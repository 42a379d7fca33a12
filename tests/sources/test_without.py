import numpy as np

from nonsac.sources import ArraySource, WithoutRows
from nonsac.sources.contract import About

ROWS = np.arange(60.0).reshape(20, 3)
LEFT_OUT = np.array([0, 3, 4, 11, 19])
KEPT = np.setdiff1d(np.arange(20), LEFT_OUT)


class Blocks(ArraySource):
    about = About(("x", "y", "z"), np.array([0, 2, 5, 5, 12, 20]))


def test_rows_are_the_others_in_their_order():
    source = WithoutRows(ArraySource(ROWS), LEFT_OUT)
    assert (len(source), source.width) == (15, 3)
    np.testing.assert_array_equal(source.take(np.arange(15)), ROWS[KEPT])
    np.testing.assert_array_equal(source.take(np.array([14, 0, 14])), ROWS[KEPT[[14, 0, 14]]])
    assert len(source.take(np.empty(0, np.int64))) == 0


def test_any_choice_of_rows(rng):
    for _ in range(50):
        left_out = np.flatnonzero(rng.random(20) < rng.random())
        kept = np.setdiff1d(np.arange(20), left_out)
        source = WithoutRows(ArraySource(ROWS), left_out)
        np.testing.assert_array_equal(source.take(np.arange(len(source))), ROWS[kept])


def test_blocks_lose_their_rows():
    source = WithoutRows(Blocks(ROWS), LEFT_OUT)
    np.testing.assert_array_equal(source.about.blocks, [0, 1, 2, 2, 8, 15])
    assert source.about.names == ("x", "y", "z")
