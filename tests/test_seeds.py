"""Seeds, and the permutations that they stand for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from nonsac.seeds import canonical_seed, permutation

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
