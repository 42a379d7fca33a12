import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from nonsac.method.sampling import sample_rows, sample_start, union_rows


def draw(rows, sample, size, seed):
    """The rows of one of many samples of the same size."""
    return sample_rows(rows, sample_start(rows, 0, sample, size), size, seed)


@pytest.mark.parametrize("sample", [0, 4, 39], ids=["first", "last of a pass", "a later pass"])
def test_every_row_is_drawn_equally_often(sample):
    hits = np.zeros(37)
    for seed in range(600):
        hits[draw(37, sample, 7, seed)] += 1
    # Without replacement the counts vary less than independent draws would, so the test is a safe one.
    assert chisquare(hits).pvalue > 1e-4


@pytest.mark.parametrize("sample", [0, 39], ids=["first", "a later pass"])
def test_every_pair_of_rows_is_drawn_equally_often(sample):
    hits = np.zeros((10, 10))
    for seed in range(2000):
        rows = draw(10, sample, 3, seed)
        hits[np.ix_(rows, rows)] += 1
    assert chisquare(hits[np.triu_indices(10, 1)]).pvalue > 1e-4


@given(st.integers(1, 2000), st.integers(0, 12), st.integers(1, 300), st.integers(0, 2**63))
def test_a_sample_is_sorted_distinct_in_range_and_of_the_right_size(rows, sample, size, seed):
    drawn = draw(rows, sample, size, seed)
    assert drawn.dtype == np.int64
    assert len(drawn) == min(size, rows)
    assert (np.diff(drawn) > 0).all()
    assert drawn[0] >= 0
    assert drawn[-1] < rows


@pytest.mark.parametrize(("rows", "samples", "size"), [(100, 10, 10), (1000, 3, 100), (10**12, 20, 1000), (7, 7, 1)])
def test_samples_are_disjoint_where_the_data_allow_it(rows, samples, size):
    drawn = np.concatenate([draw(rows, i, size, seed=5) for i in range(samples)])
    assert len(np.unique(drawn)) == samples * size


@pytest.mark.parametrize("turn", [0, 1, 5])
def test_a_pass_that_comes_out_even_is_a_partition(turn):
    drawn = np.concatenate([draw(120, 6 * turn + i, 20, seed=5) for i in range(6)])
    np.testing.assert_array_equal(np.sort(drawn), np.arange(120))


def test_passes_overlap_as_independent_draws():
    samples = [set(draw(1000, i, 100, seed=5)) for i in range(30)]
    shared = [len(a & b) for i, a in enumerate(samples) for b in samples[: i - i % 10]]
    assert 9 < np.mean(shared) < 11  # hypergeometric: 100 of 1000 rows, 10 expected
    assert np.std(shared) < 4


@pytest.mark.parametrize("size", [10, 11, 1000])
def test_a_sample_that_needs_all_rows_gets_all_rows(size):
    np.testing.assert_array_equal(draw(10, 2, size, seed=9), np.arange(10))


def test_no_rows_give_an_empty_sample():
    assert draw(0, 0, 10, seed=0).shape == (0,)


def test_the_seed_and_the_number_decide():
    def drawn(sample, seed):
        return tuple(draw(1000, sample, 100, seed))

    assert drawn(1, 7) == drawn(1, 7)
    assert drawn(1, 7) != drawn(1, 8)
    assert drawn(1, 7) != drawn(2, 7)
    assert drawn(1, 7) != drawn(11, 7)


@given(st.integers(1, 300), st.lists(st.integers(1, 100), min_size=1, max_size=20), st.integers(0, 2**40))
def test_samples_of_any_sizes_are_disjoint_within_a_pass(rows, sizes, seed):
    position, seen = 0, {}
    for size in sizes:
        start = sample_start(rows, position, 0, size)
        drawn = sample_rows(rows, start, size, seed)
        if size < rows:
            assert start // rows == (start + size - 1) // rows
            earlier = seen.setdefault(start // rows, set())
            assert not earlier & set(drawn)
            earlier.update(drawn)
        position = start + size


@pytest.mark.parametrize(
    ("rows", "first", "size"), [(100, 0, 7), (100, 33, 10), (100, 95, 10), (100, 250, 100), (5, 3, 9)]
)
def test_the_start_of_a_sample_follows_that_of_the_one_before(rows, first, size):
    start = sample_start(rows, first, 0, size)
    for sample in range(1, 40):
        following = sample_start(rows, first, sample, size)
        assert following == sample_start(rows, start + size, 0, size)
        start = following


@pytest.mark.parametrize("rows", [1000, 200, 160, 10**12])
@pytest.mark.parametrize("count", [1, 2, 4])
def test_the_union_holds_each_row_of_the_first_samples_once(rows, count):
    drawn = np.concatenate([draw(rows, i, 40, seed=6) for i in range(count)])
    np.testing.assert_array_equal(union_rows(rows, 40 * count, 6), np.sort(drawn))


@pytest.mark.parametrize("end", [1000, 1001, 5000])
def test_the_union_of_more_than_a_pass_is_all_rows(end):
    np.testing.assert_array_equal(union_rows(1000, end, 6), np.arange(1000))


def test_the_union_grows_by_further_rows():
    small, grown = union_rows(1000, 80, 6), union_rows(1000, 80, 6, at_least=300)
    assert len(small) == 80
    assert len(np.unique(grown)) == len(grown) == 300
    assert set(small) < set(grown)
    np.testing.assert_array_equal(union_rows(1000, 80, 6, at_least=60), small)
    np.testing.assert_array_equal(union_rows(1000, 80, 6, at_least=1000), np.arange(1000))


def test_drawing_from_a_huge_source_takes_no_time_or_memory(rng):
    assert len(draw(2**62, 3, 1000, seed=1)) == 1000
