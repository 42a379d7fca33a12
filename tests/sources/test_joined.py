import numpy as np
import pytest

from nonsac import Camera
from nonsac.sources import JoinedSource

FIRST = np.arange(20, dtype=np.float32).reshape(10, 2)
SECOND = np.asfortranarray(np.arange(30.0).reshape(10, 3))


def test_rows_stand_side_by_side():
    source = JoinedSource([FIRST, SECOND])
    assert (len(source), source.width) == (10, 5)
    np.testing.assert_array_equal(source.take(np.array([7, 0])), np.hstack([FIRST, SECOND])[[7, 0]])


def test_only_the_rows_asked_for_pass_through_the_maps():
    seen = []

    def doubled(rows):
        seen.append(len(rows))
        return np.column_stack([2 * rows, rows[:, 0]])

    source = JoinedSource([FIRST, SECOND], [None, doubled])
    taken = source.take(np.array([3, 4]))
    np.testing.assert_array_equal(taken, np.column_stack([FIRST, 2 * SECOND, SECOND[:, 0]])[3:5])
    assert seen == [2]
    assert source.width == 6


def test_a_camera_undistorts_what_is_sampled():
    camera = Camera.parse("SIMPLE_RADIAL 100 50 40 0.1")
    source = JoinedSource([FIRST, FIRST], [camera.normalise, None])
    taken = source.take(np.arange(10))
    np.testing.assert_allclose(camera.project(taken[:, :2]), FIRST, atol=1e-9)


@pytest.mark.parametrize(
    ("arrays", "maps", "message"),
    [
        ([], None, "arrays must hold at least one array"),
        ([FIRST, SECOND[1:]], None, "arrays must have equally many rows, got 10, 9"),
        ([FIRST, SECOND], [None], "maps must hold one entry for each of 2 arrays, got 1"),
        ([FIRST[:, 0]], None, r"rows must be a \(n, D\) array"),
    ],
)
def test_what_does_not_fit_together_is_refused(arrays, maps, message):
    with pytest.raises(ValueError, match=message):
        JoinedSource(arrays, maps)
