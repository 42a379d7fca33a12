import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from nonsac.sampling import canonical_seed, permutation, sample_rows, union_rows

SIZES = [1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 63, 64, 65, 100, 255, 256, 257, 1000, 4095, 4096, 4097, 65536, 65537]


@pytest.mark.parametrize("rows", SIZES)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_permutation_is_a_bijection(rows, seed):
    values = permutation(rows, 0, rows, seed)
    assert values.dtype == np.int64
    np.testing.assert_array_equal(np.sort(values), np.arange(rows))


@given(rows=st.integers(1, 3000), seed=st.integers(0, 2**64), stream=st.integers(0, 10))
def test_the_permutation_is_a_bijection_for_any_size(rows, seed, stream):
    np.testing.assert_array_equal(np.sort(permutation(rows, 0, rows, seed, stream)), np.arange(rows))


@pytest.mark.parametrize("rows", [2**31 - 1, 2**31 + 1, 10**12, 2**61 + 1, 2**62])
def test_the_permutation_of_a_huge_range_has_no_duplicates(rows):
    n = 50_000
    values = np.concatenate([permutation(rows, first, n, 3) for first in (0, rows // 2, rows - n)])
    assert values.min() >= 0
    assert 0.999 * rows < values.max() < rows
    assert len(np.unique(values)) == 3 * n
    assert abs(values.astype(float).mean() / rows - 0.5) < 0.01


def test_a_piece_of_the_permutation_is_that_piece_of_the_whole():
    np.testing.assert_array_equal(permutation(1000, 250, 100, 4), permutation(1000, 0, 1000, 4)[250:350])
    assert permutation(1000, 250, 0, 4).shape == (0,)


def test_each_seed_and_stream_gives_another_permutation():
    pieces = {tuple(permutation(1000, 0, 20, seed, stream)) for seed in range(20) for stream in range(20)}
    assert len(pieces) == 400


@pytest.mark.parametrize("rows", [5, 16, 17, 100])
def test_every_position_goes_everywhere_equally_often(rows):
    hits = np.zeros((2, rows))
    for seed in range(20 * rows):
        hits[0, permutation(rows, 0, 1, seed)] += 1
        hits[1, permutation(rows, rows - 1, 1, seed)] += 1
    assert chisquare(hits[0]).pvalue > 1e-4
    assert chisquare(hits[1]).pvalue > 1e-4


@pytest.mark.parametrize("samples", [1, 40], ids=["disjoint", "independent"])
def test_every_row_is_drawn_equally_often(samples):
    hits = np.zeros(37)
    for seed in range(600):
        hits[sample_rows(37, samples - 1, samples, 7, seed)] += 1
    # Without replacement the counts vary less than independent draws would, so the test is a safe one.
    assert chisquare(hits).pvalue > 1e-4


@pytest.mark.parametrize("samples", [1, 40], ids=["disjoint", "independent"])
def test_every_pair_of_rows_is_drawn_equally_often(samples):
    hits = np.zeros((10, 10))
    for seed in range(2000):
        rows = sample_rows(10, samples - 1, samples, 3, seed)
        hits[np.ix_(rows, rows)] += 1
    assert chisquare(hits[np.triu_indices(10, 1)]).pvalue > 1e-4


@given(st.integers(1, 2000), st.integers(1, 12), st.integers(1, 300), st.integers(0, 2**63))
def test_a_sample_is_sorted_distinct_in_range_and_of_the_right_size(rows, samples, size, seed):
    for sample in {0, samples - 1}:
        drawn = sample_rows(rows, sample, samples, size, seed)
        assert drawn.dtype == np.int64
        assert len(drawn) == min(size, rows)
        assert (np.diff(drawn) > 0).all()
        assert drawn[0] >= 0
        assert drawn[-1] < rows


@pytest.mark.parametrize(("rows", "samples", "size"), [(100, 10, 10), (1000, 3, 100), (10**12, 20, 1000), (7, 7, 1)])
def test_samples_are_disjoint_where_the_data_allow_it(rows, samples, size):
    drawn = np.concatenate([sample_rows(rows, i, samples, size, seed=5) for i in range(samples)])
    assert len(np.unique(drawn)) == samples * size


def test_samples_that_use_all_rows_are_a_partition():
    drawn = np.concatenate([sample_rows(120, i, 6, 20, seed=5) for i in range(6)])
    np.testing.assert_array_equal(np.sort(drawn), np.arange(120))


def test_samples_overlap_as_independent_ones_where_the_rows_do_not_suffice():
    samples = [set(sample_rows(1000, i, 11, 100, seed=5)) for i in range(11)]
    shared = [len(a & b) for i, a in enumerate(samples) for b in samples[:i]]
    assert 7 < np.mean(shared) < 13  # hypergeometric: 100 of 1000 rows, 10 expected
    assert min(shared) > 0


@pytest.mark.parametrize("size", [10, 11, 1000])
def test_a_sample_that_needs_all_rows_gets_all_rows(size):
    np.testing.assert_array_equal(sample_rows(10, 2, 5, size, seed=9), np.arange(10))


def test_no_rows_give_an_empty_sample():
    assert sample_rows(0, 0, 5, 10, seed=0).shape == (0,)


@pytest.mark.parametrize("samples", [3, 50])
def test_the_seed_and_the_number_decide(samples):
    def draw(sample, seed):
        return tuple(sample_rows(1000, sample, samples, 100, seed))

    assert draw(1, 7) == draw(1, 7)
    assert draw(1, 7) != draw(1, 8)
    assert draw(1, 7) != draw(2, 7)


@pytest.mark.parametrize(
    ("rows", "samples", "size"),
    [(1000, 5, 40), (200, 5, 40), (199, 5, 40), (100, 5, 40), (40, 5, 40), (30, 5, 40), (10**12, 5, 40)],
)
@pytest.mark.parametrize("count", [1, 3, 5])
def test_the_union_holds_each_row_of_the_first_samples_once(rows, samples, size, count):
    drawn = np.concatenate([sample_rows(rows, i, samples, size, seed=6) for i in range(count)])
    np.testing.assert_array_equal(union_rows(rows, count, samples, size, 6), np.unique(drawn))


def test_the_union_grows_by_further_rows_where_samples_do_not_overlap():
    small = union_rows(1000, 2, 5, 40, 6)
    grown = union_rows(1000, 2, 5, 40, 6, at_least=300)
    assert len(small) == 80
    assert len(np.unique(grown)) == len(grown) == 300
    assert set(small) < set(grown)
    np.testing.assert_array_equal(union_rows(1000, 2, 5, 40, 6, at_least=60), small)


@pytest.mark.parametrize("samples", [5, 50])
def test_a_union_of_more_rows_than_there_are_is_all_of_them(samples):
    np.testing.assert_array_equal(union_rows(1000, 2, samples, 40, 6, at_least=1000), np.arange(1000))
    assert len(union_rows(1000, 2, samples, 40, 6, at_least=999)) < 1000


def test_drawing_from_a_huge_source_takes_no_time_or_memory(rng):
    assert len(sample_rows(2**62, 3, 1000, 1000, seed=1)) == 1000


@pytest.mark.parametrize("seed", [0, 1, 2**63, 10**30, np.int64(7), np.uint8(7)])
def test_an_integer_is_its_own_seed(seed):
    assert canonical_seed(seed) == int(seed)
    assert type(canonical_seed(seed)) is int


def test_a_generator_gives_a_seed_of_its_own_each_time():
    rng = np.random.default_rng(3)
    first, second = canonical_seed(rng), canonical_seed(rng)
    assert first != second
    assert canonical_seed(np.random.default_rng(3)) == first
    assert 0 <= first < 2**63
    assert len({canonical_seed(rng) for _ in range(1000)}) == 1000


def test_none_takes_fresh_entropy():
    assert canonical_seed(None) != canonical_seed(None)
    assert canonical_seed(None) >= 0


@pytest.mark.parametrize("wrong", [-1, 1.0, "0", True, [1], np.random.RandomState(0)])
def test_other_seeds_are_refused_by_name(wrong):
    with pytest.raises(ValueError, match="rng must be"):
        canonical_seed(wrong)
