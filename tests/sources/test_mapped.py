import pickle

import numpy as np
import pytest

from nonsac import Camera
from nonsac.sources import ArraySource, MappedSource
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


def test_blocks_and_costs_are_handed_on_where_there_are_any():
    source = pickle.loads(pickle.dumps(MappedSource(MappedSource(Blocks(), np.negative), np.negative)))
    assert source.block_starts.tolist() == [0, 5, 12]
    assert source.bytes_to_take(3) == 21
    np.testing.assert_array_equal(source.take(np.array([11, 0])), ROWS[[11, 0]])
    assert not hasattr(source, "in_memory")
    plain = MappedSource(ArraySource(ROWS), np.negative)
    assert plain.in_memory
    assert not hasattr(plain, "block_starts")
    assert not hasattr(plain, "bytes_to_take")
    with pytest.raises(AttributeError, match="MappedSource has no attribute 'rows'"):
        _ = plain.rows
