import contextlib
import mmap
import os
import pickle

import numpy as np
import pytest

from nonsac.io import InputError
from nonsac.layouts import MATCHES, POINTS
from nonsac.sources import ArraySource, JoinedSource
from nonsac.sources.columns import arranged

LAYOUTS = {
    "C": lambda rows: rows,
    "Fortran": np.asfortranarray,
    "float32": lambda rows: rows.astype(np.float32),
    "float16": lambda rows: rows.astype(np.float16),
    "integers": lambda rows: rows.astype(np.int32),
    "unsigned": lambda rows: rows.astype(np.uint8),
    "reversed": lambda rows: rows[::-1, ::-1],
    "big endian": lambda rows: rows.astype(">f8"),
    "nested lists": lambda rows: rows.tolist(),
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_rows_of_any_dtype_and_order(layout):
    given = layout(np.arange(21.0).reshape(7, 3))
    source, indices = ArraySource(given), np.array([6, 0, 0, 3])
    assert (len(source), source.width) == (7, 3)
    np.testing.assert_array_equal(source.take(indices), np.asarray(given)[indices])
    for rows in (source.take(indices), next(source.chunks(3))):
        assert rows.dtype == np.float64
        assert rows.dtype.isnative
        assert rows.flags.c_contiguous
        assert rows.flags.writeable


def test_rows_of_a_memory_map(tmp_path):
    np.save(tmp_path / "rows.npy", np.arange(12.0).reshape(4, 3))
    source = ArraySource(np.load(tmp_path / "rows.npy", mmap_mode="r"))
    assert isinstance(source.rows, np.memmap)
    np.testing.assert_array_equal(source.take(np.array([3])), [[9.0, 10, 11]])


def test_the_array_is_not_copied():
    rows = np.zeros((5, 2), np.float32, order="F")
    assert ArraySource(rows).rows is rows


def test_columns_may_have_names():
    assert ArraySource(np.zeros((5, 2))).about.names is None
    source = pickle.loads(pickle.dumps(ArraySource(np.zeros((5, 2)), ["a", "b"])))
    assert source.about.names == ("a", "b")
    with pytest.raises(ValueError, match="names must have one for each of 2 columns, got 3"):
        ArraySource(np.zeros((5, 2)), "abc")


def test_what_is_in_memory_costs_nothing_to_read(tmp_path):
    source = ArraySource(np.zeros((5, 2)))
    assert (source.about.in_memory, source.bytes_to_take(3)) == (True, 0)
    np.save(tmp_path / "rows.npy", np.zeros((5, 2)))
    mapped = ArraySource(np.load(tmp_path / "rows.npy", mmap_mode="r"))
    assert (mapped.about.in_memory, mapped.bytes_to_take(3)) == (False, 48)


@pytest.mark.parametrize("shape", [(3,), (2, 2, 2), ()])
def test_other_shapes_are_refused_by_name(shape):
    with pytest.raises(ValueError, match=r"rows must be a \(n, D\) array"):
        ArraySource(np.zeros(shape))


@pytest.mark.parametrize("wrong", [np.zeros((2, 2), complex), np.zeros((2, 2), bool), [["a", "b"]], [[None, 1]]])
def test_other_dtypes_are_refused_by_name(wrong):
    with pytest.raises(TypeError, match="rows must be an array of real numbers"):
        ArraySource(wrong)


VIEWS = {
    "all": lambda rows: rows,
    "some rows": lambda rows: rows[5:],
    "reversed": lambda rows: rows[::-2],
    "some columns": lambda rows: rows[:, 1:3],
    "plain array": lambda rows: np.asarray(rows)[3:],
    "transposed": lambda rows: rows.T[:, :9],
}


@pytest.mark.parametrize("order", "CF")
@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
def test_a_memory_map_travels_as_a_description(tmp_path, order, view):
    np.save(tmp_path / "rows.npy", np.asarray(np.arange(40_000, dtype=">i4").reshape(-1, 4), order=order))
    rows = view(np.load(tmp_path / "rows.npy", mmap_mode="r"))
    told = pickle.dumps(ArraySource(rows))
    assert len(told) < 1000
    there = pickle.loads(told)
    np.testing.assert_array_equal(there.take(np.arange(len(rows))), rows)
    assert len(pickle.dumps(there)) < 1000


@pytest.mark.parametrize("kind", ["copy on write", "file gone", "copy", "empty"])
def test_what_is_not_in_the_file_travels_itself(tmp_path, kind):
    np.save(tmp_path / "rows.npy", np.arange(400.0).reshape(-1, 4))
    rows = np.load(tmp_path / "rows.npy", mmap_mode="c" if kind == "copy on write" else "r")
    if kind == "copy on write":
        rows[7] = -1.0
    if kind == "file gone":
        (tmp_path / "rows.npy").unlink()
    rows = rows[:0] if kind == "empty" else rows[[1, 7]] if kind == "copy" else rows
    there = pickle.loads(pickle.dumps(ArraySource(rows)))
    np.testing.assert_array_equal(there.rows, rows)


@pytest.mark.parametrize("damage", [lambda path: path.unlink(), lambda path: path.write_bytes(bytes(200))])
def test_a_map_that_cannot_be_opened_there_is_refused(tmp_path, damage):
    np.save(tmp_path / "rows.npy", np.arange(400.0).reshape(-1, 4))
    told = pickle.dumps(ArraySource(np.load(tmp_path / "rows.npy", mmap_mode="r")))
    damage(tmp_path / "rows.npy")
    with pytest.raises(InputError, match=r"rows\.npy: cannot be mapped again"):
        pickle.loads(told)


class Frame:
    """As pandas and polars have it, as far as it matters."""

    def __init__(self, rows, columns):
        self.rows, self.columns = rows, columns

    def __array__(self, dtype=None, copy=None):
        return self.rows


def test_the_names_of_tables_are_kept():
    """So that x2 y2 x1 y1 are not taken for x1 y1 x2 y2."""
    rows, names = np.arange(20.0).reshape(5, 4), ["x2", "y2", "x1", "y1"]
    tables = [Frame(rows, names), Frame(rows, iter(names))]
    with contextlib.suppress(ImportError):
        import pyarrow as pa

        table = pa.table(dict(zip(names, rows.T, strict=True)))
        tables += [table, table.to_batches()[0]]
    for table in tables:
        source = ArraySource(table)
        assert source.about.names == tuple(names)
        np.testing.assert_array_equal(arranged(source, MATCHES).take(np.arange(5)), rows[:, [2, 3, 0, 1]])
        with pytest.raises(ValueError, match="of which none is called u v X Y Z"):
            arranged(source, POINTS)
    assert ArraySource(Frame(rows, names), ["a", "b", "c", "d"]).about.names == ("a", "b", "c", "d")
    assert ArraySource(Frame(rows, range(4))).about.names is None


def mapped(path, rows, how):
    if how == "plain map":
        with path.open("r+b") as file:
            memory = mmap.mmap(file.fileno(), 0)
        return np.frombuffer(memory, np.float64, rows.size, path.stat().st_size - rows.nbytes).reshape(rows.shape)
    if how == "with an offset":
        return np.memmap(path, np.float64, "r", path.stat().st_size - rows.nbytes, rows.shape)
    return np.load(path, mmap_mode=how)


@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
@pytest.mark.parametrize("how", ["r", "r+", "c", "plain map", "with an offset"])
def test_a_map_whose_file_shrinks(tmp_path, how, view):
    """To touch what is gone would end the process; what is left is not enough to go on, either."""
    rows, path = np.arange(30_000.0).reshape(10_000, 3), tmp_path / "rows.npy"
    np.save(path, rows)
    given = view(mapped(path, rows, how))
    sources = [ArraySource(given), JoinedSource([given, given])]
    last = len(given) - 1
    for source in sources:
        np.testing.assert_array_equal(source.take(np.array([last]))[0, : given.shape[1]], view(rows)[last])
    os.truncate(path, 130)
    for source in sources:
        for read in (lambda: source.take(np.array([0])), lambda: next(source.chunks(5))):  # noqa: B023
            with pytest.raises(InputError, match=r"the file was cut to 130 bytes while it was mapped into memory"):
                read()


def test_memory_that_no_file_is_behind():
    memory = mmap.mmap(-1, 8 * 12)
    rows = np.frombuffer(memory, np.float64).reshape(4, 3)
    np.testing.assert_array_equal(ArraySource(rows).take(np.array([3])), [[0, 0, 0]])


def test_a_map_that_is_longer_than_what_is_read_of_it(tmp_path):
    np.save(tmp_path / "rows.npy", np.arange(30_000.0).reshape(10_000, 3))
    source = ArraySource(np.load(tmp_path / "rows.npy", mmap_mode="r")[:100])
    os.truncate(tmp_path / "rows.npy", 4096)
    np.testing.assert_array_equal(source.take(np.array([99])), [[297, 298, 299]])
