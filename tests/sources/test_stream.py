import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from nonsac.layouts import MATCHES
from nonsac.method.sampling import sample_rows
from nonsac.sources import StreamSource
from nonsac.sources.columns import arranged


def numbered(rows, size=100, width=2):
    """A stream whose first column numbers its rows."""
    for first in range(0, rows, size):
        numbers = np.arange(first, min(first + size, rows), dtype=float)
        yield np.column_stack([numbers + column for column in range(width)])


def chi_square_tail(counts):
    expected = counts.mean()
    return chi2.sf(np.sum((counts - expected) ** 2) / expected, len(counts) - 1)


def test_a_short_stream_is_kept_whole_in_random_order():
    source = StreamSource(numbered(1000), rows=5000)
    assert (len(source), source.width, source.rows_seen) == (1000, 2, 1000)
    rows = source.take(np.arange(1000))
    assert sorted(rows[:, 0]) == list(range(1000))
    assert abs(np.corrcoef(rows[:, 0], np.arange(1000))[0, 1]) < 0.1
    np.testing.assert_array_equal(rows[:, 1], rows[:, 0] + 1)


def test_a_long_stream_is_thinned_without_repetition():
    source = StreamSource(numbered(10_000, 37), rows=100)
    assert (len(source), source.rows_seen) == (100, 10_000)
    assert len(set(source.rows[:, 0])) == 100


@pytest.mark.parametrize("size", [3, 40, 1000])
def test_every_row_is_kept_equally_often(size):
    counts = np.zeros(200)
    for seed in range(500):
        counts[StreamSource(numbered(200, size, 1), rows=40, rng=seed).rows[:, 0].astype(int)] += 1
    # Without replacement the counts vary less than Poisson's, by the share that is left out.
    assert counts.sum() == 500 * 40
    assert 1e-3 < chi2.sf(np.sum((counts - 100) ** 2) / 100 / 0.8, 199) < 1 - 1e-3


def test_every_place_holds_every_row_equally_often():
    first, last = np.zeros(50), np.zeros(50)
    for seed in range(2000):
        rows = StreamSource(numbered(50, 7, 1), rows=10, rng=seed).rows[:, 0].astype(int)
        first[rows[0]] += 1
        last[rows[-1]] += 1
    assert chi_square_tail(first) > 1e-3
    assert chi_square_tail(last) > 1e-3


def test_samples_of_it_are_uniform_samples_of_the_stream():
    counts = np.zeros(300)
    for seed in range(400):
        source = StreamSource(numbered(300, 64, 1), rows=60, rng=seed)
        samples = [source.take(sample_rows(60, start, 15, 1))[:, 0].astype(int) for start in (0, 15, 30)]
        assert len(set(np.concatenate(samples))) == 45
        counts[samples[1]] += 1
    assert chi2.sf(np.sum((counts - 20) ** 2) / 20 / 0.95, 299) > 1e-3


@given(st.lists(st.integers(0, 60), max_size=12), st.integers(1, 40))
def test_the_cuts_between_chunks_make_no_difference(cuts, rows):
    whole = next(numbered(60))
    pieces = np.split(whole, np.sort(np.array(cuts, int)))
    source = StreamSource(pieces, rows)
    np.testing.assert_array_equal(source.rows, StreamSource([whole], rows).rows)
    assert source.rows_seen == 60


def test_the_stream_is_read_once_and_the_chunks_may_be_reused():
    buffer, told = np.zeros((10, 2)), []

    def refilled():
        for number in range(30):
            buffer[:] = number
            told.append(number)
            yield buffer

    source = StreamSource(refilled(), rows=50)
    assert told == list(range(30))
    assert len(set(source.rows[:, 0])) > 10
    source.take(np.arange(50))
    assert told == list(range(30))


def test_seeds():
    same = [StreamSource(numbered(500), 50, rng=seed).rows for seed in (0, 0, 1, np.random.default_rng(0))]
    assert np.array_equal(same[0], same[1])
    assert not np.array_equal(same[0], same[2])
    assert not np.array_equal(same[0], same[3])


def test_it_pickles_as_the_rows_kept():
    source = StreamSource(numbered(5000), rows=50)
    copy = pickle.loads(pickle.dumps(source))
    assert len(pickle.dumps(source)) < 50 * 16 + 1000
    np.testing.assert_array_equal(copy.rows, source.rows)
    assert copy.rows_seen == 5000


@pytest.mark.parametrize(("chunks", "shape"), [([], (0, 0)), ([np.empty((0, 3))] * 2, (0, 3))])
def test_an_empty_stream(chunks, shape):
    source = StreamSource(chunks)
    assert ((len(source), source.width), source.rows_seen) == (shape, 0)


@pytest.mark.parametrize(
    ("chunks", "kind", "message"),
    [
        ([np.zeros((2, 3)), np.zeros((2, 4))], ValueError, r"chunks\[1\] has 4 columns where chunks\[0\] has 3"),
        (np.zeros((2, 3)), ValueError, r"chunks\[0\]: rows must be a \(n, D\) array, got shape \(3,\)"),
        ([np.zeros((2, 3)), [["a", "b"]]], TypeError, r"chunks\[1\]: rows must be an array of real numbers"),
        ([np.ma.masked_array(np.zeros((2, 3)))], TypeError, r"chunks\[0\]: rows must not be a masked array"),
    ],
)
def test_bad_chunks(chunks, kind, message):
    with pytest.raises(kind, match=message):
        StreamSource(chunks)


@pytest.mark.parametrize("rows", [0, -1, 2.5, True, "many"])
def test_rows_must_be_a_count(rows):
    with pytest.raises(ValueError, match="rows must be a positive integer"):
        StreamSource([], rows)


def test_the_names_of_tables_are_kept():
    pa = pytest.importorskip("pyarrow")
    rows = np.arange(48.0).reshape(12, 4)
    table = pa.table(dict(zip(("x2", "y2", "X1", "y1"), rows.T, strict=True)))
    source = StreamSource(table.to_batches(max_chunksize=5))
    assert source.about.names == ("x2", "y2", "X1", "y1")
    taken = arranged(source, MATCHES).take(np.arange(12))
    np.testing.assert_array_equal(taken[np.argsort(taken[:, 0])], rows[:, [2, 3, 0, 1]])
    with pytest.raises(ValueError, match=r"chunks\[1\] names its columns \('x2', 'y2', 'y1', 'X1'\), chunks\[0\] \("):
        StreamSource([table, table.select(["x2", "y2", "y1", "X1"])])
    with pytest.raises(ValueError, match=r"chunks\[1\] names its columns None, chunks\[0\] \('x2',"):
        StreamSource([table, rows])
