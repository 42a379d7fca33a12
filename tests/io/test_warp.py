import numpy as np
import pytest

from nonsac.io import from_warp


def grid(height, width):
    """Where PyTorch, with align_corners=False, has the centres of pixels."""
    x = np.linspace(-1 + 1 / width, 1 - 1 / width, width)
    y = np.linspace(-1 + 1 / height, 1 - 1 / height, height)
    return np.stack(np.meshgrid(x, y), axis=2)


def test_pixels_of_an_identity():
    warp = np.concatenate([grid(2, 3), grid(2, 3)], axis=2)
    certainty = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 1.0]])
    # The same size as the warp, and twice that: the centres of the pixels of a warp lie between four pixels.
    matches = from_warp(warp, certainty, (3, 2), (6, 4))
    pixels = np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])
    np.testing.assert_allclose(matches.points1, pixels, atol=1e-12)
    np.testing.assert_allclose(matches.points2, 2 * pixels + 0.5, atol=1e-12)
    np.testing.assert_array_equal(matches.weights, certainty.ravel())
    assert matches.points1.dtype == np.float64
    assert matches.indices is None


def test_edges_and_axes():
    warp = np.array([[[-1, -1, 1, 0], [1, -1, 0, 1]]])
    matches = from_warp(warp, np.ones((1, 2)), (640, 480), (800, 600))
    np.testing.assert_array_equal(matches.points1, [[-0.5, -0.5], [639.5, -0.5]])
    np.testing.assert_array_equal(matches.points2, [[799.5, 299.5], [399.5, 599.5]])


def test_first_image_left_out(rng):
    target = rng.uniform(-1, 1, (4, 5, 2))
    certainty = rng.uniform(0.1, 1, (4, 5))
    short = from_warp(target, certainty, (50, 40), (64, 48))
    whole = from_warp(np.concatenate([grid(4, 5), target], axis=2), certainty, (50, 40), (64, 48))
    np.testing.assert_allclose(short.points1, whole.points1, atol=1e-12)
    np.testing.assert_array_equal(short.points2, whole.points2)


def test_symmetric_warp(rng):
    there, back = rng.uniform(-1, 1, (2, 3, 4, 2))
    warp = np.concatenate(
        [np.concatenate([grid(3, 4), there], axis=2), np.concatenate([back, grid(3, 4)], axis=2)], axis=1
    )
    certainty = rng.uniform(0.1, 1, (3, 8))
    matches = from_warp(warp, certainty, (100, 80), (60, 40))
    swapped = from_warp(warp[:, :, [2, 3, 0, 1]], certainty, (60, 40), (100, 80))
    assert len(matches) == 24
    np.testing.assert_array_equal(matches.points1, swapped.points2)
    np.testing.assert_array_equal(matches.points2, swapped.points1)
    right_half = np.arange(24) % 8 >= 4
    np.testing.assert_allclose(matches.points2[right_half][0], [60 / 8 - 0.5, 40 / 6 - 0.5])


def test_what_is_not_certain_is_dropped():
    warp = np.zeros((1, 4, 4))
    warp[0, :, 0] = [-0.5, 0, 0.5, 1]
    matches = from_warp(warp, [[0, 0.5, np.nan, 1]], (100, 100), (100, 100))
    np.testing.assert_array_equal(matches.points1[:, 0], [49.5, 99.5])
    np.testing.assert_array_equal(matches.weights, [0.5, 1])
    assert len(from_warp(warp, np.zeros((1, 4)), (9, 9), (9, 9))) == 0
    assert len(from_warp(warp, np.zeros((1, 4)), (9, 9), (9, 9), 3)) == 0


def drawn(certainty, count, rng):
    warp = np.concatenate([grid(*certainty.shape)] * 2, axis=2)
    height, width = certainty.shape
    matches = from_warp(warp, certainty, (width, height), (width, height), count, rng)
    return matches, np.rint(matches.points1 @ [1, width]).astype(int)


def test_draw(rng):
    certainty = rng.uniform(0, 1, (30, 40))
    matches, cells = drawn(certainty, 100, 0)
    assert len(np.unique(cells)) == len(matches) == 100
    assert matches.weights is None
    np.testing.assert_array_equal(matches.points1, matches.points2)
    np.testing.assert_array_equal(cells, drawn(certainty, 100, 0)[1])
    np.testing.assert_array_equal(cells, drawn(certainty, 100, np.random.default_rng(0))[1])
    assert set(cells) != set(drawn(certainty, 100, 1)[1])


def test_draw_of_everything():
    certainty = np.array([[0.5, 0, 0.25]])
    for count in (2, 3, 1000):
        matches, cells = drawn(certainty, count, 0)
        np.testing.assert_array_equal(cells, [0, 2])
        np.testing.assert_array_equal(matches.weights, [0.5, 0.25])


def test_frequencies_of_the_draw(rng):
    # Two of three, worked by hand: P(pair) = p1 p2 / (1 - p1) + p2 p1 / (1 - p2).
    certainty = np.array([[0.6, 0.3, 0.1]])
    draws = 4000
    missed = np.zeros(3)
    for _ in range(draws):
        missed[list({0, 1, 2} - set(drawn(certainty, 2, rng)[1]))] += 1
    expected = {2: 0.18 / 0.4 + 0.18 / 0.7, 1: 0.06 / 0.4 + 0.06 / 0.9, 0: 0.03 / 0.7 + 0.03 / 0.9}
    for cell, probability in expected.items():
        deviation = np.sqrt(probability * (1 - probability) / draws)
        assert abs(missed[cell] / draws - probability) < 5 * deviation


class Tensor:
    """What a tensor of PyTorch on a GPU looks like from outside."""

    def __init__(self, array, steps=("detach", "cpu", "double")):
        self.array, self.steps = array, steps

    def __getattr__(self, name):
        if not self.steps or name != self.steps[0]:
            raise AttributeError(name)
        return lambda: Tensor(self.array, self.steps[1:])

    def __array__(self, dtype=None, copy=None):
        assert not self.steps, "NumPy cannot take a tensor on a GPU"
        return self.array


def test_tensors(rng):
    warp, certainty = rng.uniform(-1, 1, (3, 4, 4)), rng.uniform(0, 1, (3, 4))
    tensors = from_warp(Tensor(warp), Tensor(certainty), (8, 6), (8, 6))
    arrays = from_warp(warp, certainty, (8, 6), (8, 6))
    np.testing.assert_array_equal(tensors.points2, arrays.points2)
    np.testing.assert_array_equal(tensors.weights, arrays.weights)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"warp": np.zeros((1, 3, 4, 4))}, r"warp has shape \(1, 3, 4, 4\); expected \(H, W, 4\) or \(H, W, 2\)"),
        ({"warp": np.zeros((3, 4, 3))}, r"warp has shape \(3, 4, 3\)"),
        ({"warp": np.zeros((3, 4, 4), complex)}, "warp has the type complex128; expected real numbers"),
        ({"certainty": np.zeros((4, 3))}, r"certainty has shape \(4, 3\); expected \(3, 4\)"),
        ({"certainty": np.full((3, 4), "a")}, "certainty has the type <U1"),
        ({"size1": (640, 0)}, r"size1 is \(640, 0\); expected the width and height"),
        ({"size2": (640, 480, 3)}, r"size2 is \(640, 480, 3\)"),
        ({"count": 0}, "count is 0; expected at least 1"),
    ],
)
def test_wrong_arguments(changes, expected):
    arguments = {"warp": np.zeros((3, 4, 4)), "certainty": np.ones((3, 4)), "size1": (8, 6), "size2": (8, 6)}
    with pytest.raises(ValueError, match=expected):
        from_warp(**arguments | changes)
