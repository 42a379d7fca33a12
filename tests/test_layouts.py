import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nonsac import AbsolutePose, Layout, Registration, RelativePose, Rows
from nonsac.layouts import MATCHES, PAIRS, POINTS, distinct

# --- layouts ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("columns", "names", "widths", "split"),
    [
        ("x1 y1 | x2 y2", ("x1", "y1", "x2", "y2"), (2, 2), 2),
        ("u v | X Y Z", ("u", "v", "X", "Y", "Z"), (2, 3), 2),
        ("x y", ("x", "y"), (2,), None),
        ("x|y", ("x", "y"), (1, 1), 1),
        ("  a   b|c ", ("a", "b", "c"), (2, 1), 2),
        ("distance", ("distance",), (1,), None),
    ],
)
def test_names_widths_and_split_are_read_from_the_columns(columns, names, widths, split):
    layout = Layout(columns)
    assert (layout.names, layout.widths, layout.split) == (names, widths, split)


@pytest.mark.parametrize("columns", ["", "  ", "|", "x y |", "| x y", "a | b | c", "a || b", "x x", "x y | x z"])
def test_columns_that_make_no_sense_are_refused_with_an_example(columns):
    with pytest.raises(ValueError, match=r'columns must be different names.*"x1 y1 \| x2 y2".*got') as caught:
        Layout(columns)
    assert repr(columns) in str(caught.value)


def test_the_parts_of_rows_are_their_columns_without_a_weight():
    table = np.arange(12.0).reshape(2, 6)
    for rows in (table[:, :5], table):
        image, world = POINTS.parts(rows)
        np.testing.assert_array_equal(image, table[:, :2])
        np.testing.assert_array_equal(world, table[:, 2:5])
    (points,) = Layout("x y z").parts(table[:, :4])
    np.testing.assert_array_equal(points, table[:, :3])
    assert [part.shape for part in POINTS.parts(np.empty((0, 5)))] == [(0, 2), (0, 3)]


def test_problems_of_the_package_name_their_columns():
    assert (RelativePose().layout, AbsolutePose().layout, Registration().layout) == (MATCHES, POINTS, PAIRS)
    assert (RelativePose().width, AbsolutePose().width, Registration().width) == (4, 5, 6)


def test_a_layout_is_frozen_and_hashable():
    with pytest.raises(dataclasses.FrozenInstanceError):
        MATCHES.columns = "x y"
    assert len({MATCHES, Layout(MATCHES.columns, MATCHES.keys, MATCHES.cameras), POINTS}) == 2
    assert len({Layout("x1 y1 | x2 y2"), Layout("x1 y1 | x2 y2"), Layout("x1 y1 x2 y2")}) == 2


@pytest.mark.parametrize("columns", [["x", "y"], ("x1 y1", "x2 y2"), None, 4])
def test_columns_are_one_string(columns):
    with pytest.raises(TypeError, match=r'columns must be names in one string, as "x1 y1 \| x2 y2", got') as caught:
        Layout(columns)
    assert repr(columns) in str(caught.value)


def test_known_layouts_say_under_which_keys_archives_hold_them():
    for layout in (MATCHES, POINTS, PAIRS):
        assert len(layout.widths) == 2
        assert len(layout.keys) == 2
        assert all(len(set(keys)) == 2 for keys in layout.keys)
    assert [len(layout.cameras) for layout in (MATCHES, POINTS, PAIRS)] == [2, 1, 0]
    assert (Layout("x y").keys, Layout("x y").cameras) == ((), ())


# --- rows -------------------------------------------------------------------------------------------------------------


def table_of(rng, n=10):
    return rng.standard_normal((n, 3)), rng.uniform(0.5, 2, n)


def assert_same(rows, values, weights):
    np.testing.assert_array_equal(rows.values, values)
    assert (rows.weights is None) == (weights is None)
    if weights is not None:
        np.testing.assert_array_equal(rows.weights, weights)


def test_a_table_of_the_right_width_has_no_weights(rng):
    values, _ = table_of(rng)
    rows = Rows.of(values, 3)
    assert rows.values is values
    assert rows.weights is None


def test_one_column_more_is_the_weights(rng):
    values, weights = table_of(rng)
    rows = Rows.of(np.column_stack([values, weights]), 3)
    assert_same(rows, values, weights)
    assert rows.values.flags.c_contiguous
    assert rows.weights.flags.c_contiguous


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_rows_that_are_not_finite_are_no_use(rng, bad):
    values, weights = table_of(rng)
    values[[2, 7], [0, 2]] = bad
    kept = np.delete(np.arange(10), [2, 7])
    assert_same(Rows(values).usable(), values[kept], None)
    assert_same(Rows(values, weights).usable(), values[kept], weights[kept])


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf, -np.inf])
def test_rows_whose_weight_is_no_positive_number_are_no_use(rng, bad):
    values, weights = table_of(rng)
    weights[4] = bad
    assert_same(Rows(values, weights).usable(), np.delete(values, 4, axis=0), np.delete(weights, 4))


def test_rows_that_are_all_of_use_are_not_copied(rng):
    rows = Rows(*table_of(rng))
    assert rows.usable() is rows


def test_rows_are_chosen_with_their_weights(rng):
    values, weights = table_of(rng)
    for chosen in (slice(2, 7), weights > 1.0, np.array([3, 3, 0]), rng.permutation(10)):
        assert_same(Rows(values, weights)[chosen], values[chosen], weights[chosen])
        assert_same(Rows(values)[chosen], values[chosen], None)


def test_the_number_of_rows_is_their_length(rng):
    assert len(Rows(*table_of(rng))) == 10
    assert len(Rows(np.empty((0, 3)))) == 0


def test_mean_weights_have_a_mean_of_one(rng):
    values, weights = table_of(rng)
    for unit in (1.0, 1e-6, 1e6):
        np.testing.assert_allclose(Rows(values, unit * weights).mean_weights, weights / weights.mean())
    assert Rows(values).mean_weights is None
    np.testing.assert_array_equal(Rows(values, np.zeros(10)).mean_weights, np.zeros(10))
    assert len(Rows(values[:0], weights[:0]).mean_weights) == 0


def test_factors_are_multiplied_by_the_weights_if_there_are_some(rng):
    values, weights = table_of(rng)
    factors = rng.uniform(0, 1, 10)
    np.testing.assert_array_equal(Rows(values, weights).times(factors), factors * weights)
    np.testing.assert_array_equal(Rows(values).times(factors), factors)


def test_parts_are_joined_in_their_order(rng):
    values, weights = table_of(rng)
    cuts = (slice(0, 3), slice(3, 3), slice(3, 10))
    assert_same(Rows.joined([Rows(values, weights)[cut] for cut in cuts]), values, weights)
    assert_same(Rows.joined([Rows(values)[cut] for cut in cuts]), values, None)


def test_some_rows_are_the_same_each_time_and_in_their_order(rng):
    values = np.column_stack([np.arange(1000.0), rng.standard_normal(1000)])
    weights = np.arange(1000.0)
    some, again = (Rows(values, weights).some(100) for _ in range(2))
    assert_same(again, some.values, some.weights)
    numbers = some.weights.astype(int)
    assert (np.diff(numbers) > 0).all()
    assert len(numbers) == 100
    np.testing.assert_array_equal(some.values, values[numbers])
    assert 400 < numbers.mean() < 600
    few = Rows(values)
    assert few.some(1000) is few


def test_rows_travel_to_another_process(rng):
    values, weights = table_of(rng)
    for rows in (Rows(values), Rows(values, weights)):
        assert_same(pickle.loads(pickle.dumps(rows)), rows.values, rows.weights)


@pytest.mark.parametrize("copies", [1, 2, 4, 5, 1000])
def test_rows_equal_to_more_than_three_others_count_once(rng, copies):
    values = rng.standard_normal((300, 4))
    values[::7] = 0.0
    values[7, 0] = -0.0
    padded = np.vstack([values, np.tile(values[5], (copies - 1, 1))])
    order = rng.permutation(len(padded))
    rows = Rows(padded[order], np.arange(len(padded))[order] + 1.0).without_padding()
    expected = [*(i for i in range(300) if i % 7), 294]  # of the zeros the heaviest one
    if copies <= 4:
        expected += range(300, 299 + copies)
    else:
        expected[expected.index(5)] = len(padded) - 1
    np.testing.assert_array_equal(np.sort(rows.weights) - 1.0, np.sort(expected))
    np.testing.assert_array_equal(rows.values, padded[rows.weights.astype(int) - 1])
    assert rows.copies == len(padded) - len(rows)


def test_rows_without_padding_are_not_copied(rng):
    rows = Rows(np.repeat(rng.standard_normal((200, 6)), 4, axis=0))
    assert rows.without_padding() is rows


@given(st.lists(st.integers(0, 5), max_size=40), st.integers(1, 3))
def test_distinct_is_what_a_dictionary_says(numbers, at_most):
    rows = np.array(numbers, np.float64).reshape(-1, 1) * [1.0, 0.5]
    places = {}
    for place, number in enumerate(numbers):
        places.setdefault(number, []).append(place)
    expected = sorted(place for each in places.values() for place in (each if len(each) <= at_most else each[:1]))
    np.testing.assert_array_equal(distinct(rows, at_most=at_most), expected)
