import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nonsac.kernels.facts import distant_rows


def marked(rows, split, apart=1.0):
    rows, apart = np.array(rows, np.float64, order="C"), np.full(rows.shape[1], apart)
    distant = np.ones(len(rows), dtype=np.bool_)
    assert distant_rows(rows, apart, split, distant) == np.count_nonzero(distant)
    return distant


def marked_slowly(rows, split):
    """The definition: 1 or more away, in either half, from all that were marked before."""
    chosen = []
    for i, row in enumerate(rows):
        differences = [row - rows[j] for j in chosen]
        if all(max(np.linalg.norm(d[:split]), np.linalg.norm(d[split:])) >= 1.0 for d in differences):
            chosen.append(i)
    return np.isin(np.arange(len(rows)), chosen)


@st.composite
def tables(draw, width=None):
    """Rows of quarters, the squares of which are exact in single precision, and where they split."""
    size = width or draw(st.integers(2, 6))
    shape = draw(st.integers(1, 30)), size
    rows = draw(arrays(np.int64, shape, elements=st.integers(-8, 8)))
    return rows / 4.0, draw(st.integers(1, size - 1))


@pytest.mark.parametrize(("size", "split"), [(4, 2), (5, 2), (6, 3)])
@pytest.mark.parametrize("spread", [0.1, 1.0, 10.0])
def test_equals_the_definition(rng, size, split, spread):
    rows = spread * rng.standard_normal((300, size)).astype(np.float32)
    np.testing.assert_array_equal(marked(rows, split), marked_slowly(rows, split))


@given(tables())
def test_equals_the_definition_at_any_distance(table):
    np.testing.assert_array_equal(marked(*table), marked_slowly(*table))


@given(tables(), st.randoms())
def test_the_order_of_columns_within_a_half_does_not_matter(table, random):
    rows, split = table
    first, second = list(range(split)), list(range(split, rows.shape[1]))
    random.shuffle(first)
    random.shuffle(second)
    np.testing.assert_array_equal(marked(rows[:, first + second], split), marked(rows, split))


@given(tables())
def test_the_halves_may_change_places(table):
    rows, split = table
    swapped = np.hstack([rows[:, split:], rows[:, :split]])
    np.testing.assert_array_equal(marked(swapped, rows.shape[1] - split), marked(rows, split))


@given(tables(), st.randoms())
def test_of_rows_far_apart_all_are_marked_in_any_order(table, random):
    rows, split = table
    order = list(range(len(rows)))
    random.shuffle(order)
    rows[:, random.randrange(rows.shape[1])] = order
    assert marked(rows, split).all()


@given(tables())
def test_the_first_row_is_marked_and_what_is_marked_stays_alone(table):
    rows, split = table
    distant = marked(rows, split)
    assert distant[0]
    assert marked(rows[distant], split).all()
    assert np.count_nonzero(marked(np.vstack([rows, rows]), split)) == np.count_nonzero(distant)


def test_the_bound_is_a_distance_of_one():
    at = np.array([[0.0, 0.0, 0.0, 0.0], [0.6, 0.8, 0.0, 0.0]])
    assert marked(np.vstack([at[0], 1.001 * at[1]]), 2).all()
    assert not marked(np.vstack([at[0], 0.999 * at[1]]), 2)[1]


def test_differences_of_both_halves_do_not_add_up():
    assert not marked(np.array([[0.0, 0.0], [0.9, 0.9]]), 1)[1]


@given(tables(), st.integers(-3, 3), st.integers(-1000, 1000))
def test_only_differences_in_units_of_the_least_one_matter(table, power, shift):
    rows, split = table
    np.testing.assert_array_equal(marked(2.0**power * rows + shift, split, 2.0**power), marked(rows, split))


def test_no_rows_are_no_problem():
    assert not len(marked(np.empty((0, 4)), 2))
