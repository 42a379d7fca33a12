import numpy as np
import pytest

from nonsac.kernels.minimal_samples import distinct_rows, gather_rows


def drawn_from(uniform, rows):
    drawn = np.empty(uniform.shape, np.int64)
    distinct_rows(uniform, rows, drawn)
    return drawn


@pytest.mark.parametrize(("rows", "size"), [(3, 3), (5, 3), (7, 5), (1000, 5)])
def test_rows_of_a_sample_are_distinct_and_all_are_drawn_equally_often(rng, rows, size):
    drawn = drawn_from(rng.random((20_000, size)), rows)
    assert drawn.min() == 0
    assert drawn.max() == rows - 1
    ordered = np.sort(drawn, axis=1)
    assert (ordered[:, 1:] > ordered[:, :-1]).all()
    counts = np.bincount(drawn.ravel(), minlength=rows)
    expected = 20_000 * size / rows
    assert np.abs(counts - expected).max() < 6 * np.sqrt(expected)


def test_the_largest_number_below_one_is_the_last_row():
    np.testing.assert_array_equal(drawn_from(np.full((1, 3), np.nextafter(1.0, 0.0)), 10), [[7, 8, 9]])
    np.testing.assert_array_equal(drawn_from(np.zeros((1, 3)), 10), [[0, 8, 9]])


def test_rows_are_copied_in_the_order_of_their_numbers(rng):
    rows, numbers = rng.random((30, 4)), rng.integers(30, size=(8, 5))
    samples = np.empty((8, 5, 4))
    gather_rows(rows, numbers, samples)
    np.testing.assert_array_equal(samples, rows[numbers])
