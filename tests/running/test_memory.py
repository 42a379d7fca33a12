import tracemalloc

import numpy as np
import pytest

import nonsac
from nonsac import simulate
from nonsac.running.memory import bytes_for, bytes_of, peak_memory, rows_within
from nonsac.sources import ArraySource
from nonsac.sources.blocks import BlockSource


@pytest.mark.parametrize(
    ("text", "expected"),
    [(1000, 1000), (2.5e6, 2_500_000), ("500", 500), ("500 MB", 5 * 10**8), ("2GiB", 2**31), (" 1.5 gb ", 15 * 10**8),
     ("3k", 3000), ("1e3 B", 1000), ("1e+9", 10**9), (np.int64(7), 7)],
)  # fmt: skip
def test_bytes_in_numbers_and_words(text, expected):
    assert bytes_of(text) == expected


@pytest.mark.parametrize(
    "wrong", [0, -5, True, None, "", "much", "5 XB", "1.2.3 MB", float("nan"), float("inf"), "0 MB"]
)
def test_other_words_are_refused(wrong):
    with pytest.raises(ValueError, match=r"max_memory must be a positive number of bytes, or words such as \"500 MB\""):
        bytes_of(wrong)


class Blocks(BlockSource):
    def __init__(self, rows=400_000, size=50_000, width=6):
        super().__init__(np.append(np.arange(0, rows, size), rows), width)
        self.read = []

    def read_block(self, block):
        self.read.append(block)
        rng = np.random.default_rng(block)
        source = rng.random((int(np.diff(self.block_starts)[block]), 3))
        return np.hstack([source, source + 0.01 * rng.standard_normal(source.shape)])[:, : self.width]


@pytest.mark.parametrize("source", [ArraySource(np.zeros((10, 4))), Blocks()], ids=["array", "blocks"])
def test_rows_and_bytes_are_inverse(source):
    for rows in (0, 5000, 200_000):
        assert rows_within(bytes_for(rows, source), source) == rows
    assert rows_within(1, source) == 0


def test_the_peak_grows():
    before = peak_memory()
    block = np.ones(2**23)
    assert peak_memory() >= max(before, block.nbytes)


@pytest.mark.parametrize("limit", [20e6, 40e6])
@pytest.mark.slow
def test_a_limit_is_kept_and_bounds_the_samples(rng, limit):
    """Pure outliers, for which all samples are drawn that there may be."""
    rows = rng.uniform(-1, 1, (300_000, 6))

    def peak(**settings):
        tracemalloc.start()
        result = nonsac.register_pairs(rows[:, :3], rows[:, 3:], noise=0.01, workers=1, **settings)
        held = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return held, result

    peak()  # compiles
    held, result = peak(max_memory=limit)
    assert held < limit
    assert len(result.hypotheses) < 100
    assert result.status is nonsac.Status.LOW_SUPPORT


def test_easy_data_do_with_little(rng):
    pairs = simulate.registration(300_000, 0.5, 0.01, rng)
    result = nonsac.register_pairs(pairs.source, pairs.target, noise=0.01, max_memory="7 MB")
    assert result.success
    assert result.num_rows < 5000
    assert result.info["peak_memory"] > 10**7


def test_too_little_is_said_at_once(rng):
    rows = rng.uniform(-1, 1, (30_000, 3))
    with pytest.raises(ValueError, match=r"max_memory is too little for 200000 sampled rows .*: at least 102 MB"):
        nonsac.register_pairs(rows, rows, noise=0.01, samples=100, max_memory="50 MB", sample_size=2000)
    with pytest.raises(ValueError, match=r"max_memory is too little .* a file with smaller row groups"):
        nonsac.estimate(Blocks(), nonsac.Registration(), nonsac.Pcr99(), noise=0.01, max_memory="9 MB")


def test_blocks_are_read_once_for_all_samples():
    source = Blocks()
    result = nonsac.estimate(
        source, nonsac.Registration(), nonsac.Pcr99.for_pairs(), noise=0.01, samples=8, refine="polish"
    )
    assert sorted(source.read) == list(range(8))
    assert result.num_rows == 100_000
    plain = ArraySource(np.vstack(list(Blocks().chunks(100_000))))
    same = nonsac.estimate(
        plain, nonsac.Registration(), nonsac.Pcr99.for_pairs(), noise=0.01, samples=8, refine="polish"
    )
    np.testing.assert_array_equal(result.T, same.T)


def test_a_round_of_samples_is_read_in_one_go():
    """Beyond what is read ahead in the beginning."""
    source = Blocks()
    result = nonsac.estimate(
        source, nonsac.Registration(), nonsac.Pcr99.for_pairs(), noise=0.01, samples=12, sample_size=20_000
    )
    assert len(result.hypotheses) == 12
    assert len(source.read) == 8 * 2


def test_pairs_of_blocks_are_read_in_one_go():
    a, b = Blocks(2000, 500, 3), Blocks(3000, 500, 3)
    pairs = nonsac.AllPairsSource(a, b)
    nonsac.estimate(pairs, nonsac.Registration(), nonsac.Pcr99(), noise=0.01, samples=6, sample_size=5000)
    assert sorted(a.read) == list(range(4))
    assert sorted(b.read) == list(range(6))


def test_all_rows_take_a_reading_for_each_pass():
    source = Blocks()
    result = nonsac.estimate(source, nonsac.Registration(), nonsac.Pcr99.for_pairs(), noise=0.01, refine="full")
    assert result.num_rows == 400_000
    assert len(source.read) == 8 * (1 + result.info["passes"])
