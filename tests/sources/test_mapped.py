import pickle

import numpy as np

from nonsac import Camera
from nonsac.sources import ArraySource, HeldSource, MappedSource
from nonsac.sources.blocks import BlockSource
from nonsac.sources.mapped import BySideMap

ROWS = np.arange(60.0).reshape(12, 5)
CAMERA = Camera.parse("SIMPLE_RADIAL 100 50 40 0.1")


class Blocks(BlockSource):
    def __init__(self):
        super().__init__(np.array([0, 5, 12]), 5)

    def read_block(self, block):
        return ROWS[self.block_starts[block] : self.block_starts[block + 1]].copy()

    def bytes_to_take(self, rows):
        return 7 * rows


def test_only_rows_that_are_taken_pass_through():
    seen = []
    source = MappedSource(ArraySource(ROWS), lambda rows: seen.append(len(rows)) or rows[:, :2] * 2)
    np.testing.assert_array_equal(source.take(np.array([3, 1])), 2 * ROWS[[3, 1], :2])
    assert seen == [2]
    assert (len(source), source.width) == (12, 2)
    np.testing.assert_array_equal(np.vstack(list(source.chunks(5, 1, 9))), 2 * ROWS[1:9, :2])


def test_parts_have_maps_of_their_own():
    source = MappedSource(ArraySource(ROWS), BySideMap((2, 2, 1), (CAMERA.normalise, None, np.negative)))
    taken = pickle.loads(pickle.dumps(source)).take(np.array([0, 4]))
    np.testing.assert_allclose(CAMERA.project(taken[:, :2]), ROWS[[0, 4], :2], atol=1e-9)
    np.testing.assert_array_equal(taken[:, 2:], ROWS[[0, 4], 2:] * [1, 1, -1])


def test_blocks_and_costs_are_those_of_the_source():
    source = pickle.loads(pickle.dumps(MappedSource(MappedSource(Blocks(), np.negative), np.negative)))
    assert source.about.blocks.tolist() == [0, 5, 12]
    assert source.bytes_to_take(3) == 21
    np.testing.assert_array_equal(source.take(np.array([11, 0])), ROWS[[11, 0]])
    assert not source.about.in_memory
    plain = MappedSource(ArraySource(ROWS), np.negative)
    assert plain.about.in_memory
    assert plain.about.blocks is None
    assert plain.bytes_to_take(3) == 0


def test_names_are_lost_in_a_function():
    """It may give other columns."""
    source = ArraySource(ROWS, "abcde")
    assert MappedSource(source, np.negative).about.names is None
    assert source.narrowed([0, 1]).about.names is None


def test_the_width_is_that_of_what_the_function_gives():
    seen = []
    source = MappedSource(ArraySource(ROWS), lambda rows: seen.append(len(rows)) or rows[:, :2])
    assert (source.width, source.width) == (2, 2)
    assert seen == [0]


def test_what_the_source_holds_is_asked_of_it():
    held = HeldSource(Blocks())
    MappedSource(MappedSource(held, np.negative), np.negative).hold(np.array([4, 11]))
    assert len(held._indices) == 2
    assert MappedSource(held, np.negative).about.keeps_rows
