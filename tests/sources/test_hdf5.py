import os
import pickle
import sys

import numpy as np
import pytest

from nonsac.sources import Hdf5Source, hdf5

h5py = pytest.importorskip("h5py")

WRITTEN = {
    "contiguous": {},
    "chunked": {"chunks": (7, 2)},
    "compressed": {"chunks": (64, 3), "compression": "gzip", "shuffle": True, "fletcher32": True},
}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "rows.h5"


def write(path, userblock=0, options=(), **datasets):
    with h5py.File(path, "w", userblock_size=userblock) as file:
        for name, rows in datasets.items():
            file.create_dataset(name, data=rows, **dict(options))


@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", "f2", "i1", "u1", ">i2", "u4", "i8"])
@pytest.mark.parametrize("options", WRITTEN.values(), ids=WRITTEN)
def test_rows_of_any_dtype(path, rng, monkeypatch, dtype, options):
    monkeypatch.setattr(hdf5, "block_rows", lambda chunk, width: 2 * chunk)
    rows = rng.integers(0, 100, (500, 3)).astype(dtype)
    write(path, options=options, rows=rows)
    indices = rng.integers(0, 500, 40)
    for columns in (None, [2, 0], [1], [1, 1]):
        source, chosen = Hdf5Source(path, "rows", columns), rows[:, slice(None) if columns is None else columns]
        assert (len(source), source.width) == chosen.shape
        np.testing.assert_array_equal(source.take(indices), chosen[indices])
        np.testing.assert_array_equal(np.vstack(list(source.chunks(130, 9, 480))), chosen[9:480])


@pytest.mark.parametrize("options", [{}, {"chunks": True}], ids=["contiguous", "chunked"])
def test_datasets_side_by_side(path, rng, options):
    x, y, uv = rng.normal(size=300), np.arange(300, dtype="i2"), rng.normal(size=(300, 2)).astype("f4")
    write(path, options=options, **{"deep/x": x, "y": y, "uv": uv})
    indices = rng.integers(0, 300, 50)
    source = Hdf5Source(path, ["uv", "deep/x", "y"])
    np.testing.assert_array_equal(source.take(indices), np.column_stack([uv, x, y])[indices])
    assert source.about.names is None
    mixed = Hdf5Source(path, ["uv", "deep/x", "y"], [1, 3, 0])
    np.testing.assert_array_equal(mixed.take(indices), np.column_stack([uv[:, 1], y, uv[:, 0]])[indices])
    assert Hdf5Source(path, ("deep/x", "y")).about.names == ("deep/x", "y")
    named = Hdf5Source(path, ("deep/x", "y"), ["y", 0])
    assert (named.names, named.about.names) == (("y", "deep/x"), None)
    np.testing.assert_array_equal(named.take(indices), np.column_stack([y, x])[indices])


def test_contiguous_beside_chunked(path, rng):
    rows = rng.normal(size=(300, 3))
    with h5py.File(path, "w") as file:
        file["a"] = rows[:, :2]
        file.create_dataset("b", data=rows[:, 2], chunks=(50,))
    source = Hdf5Source(path, ["a", "b"])
    np.testing.assert_array_equal(source.take(np.array([299, 1])), rows[[299, 1]])
    assert len(source.about.blocks) > 1
    assert Hdf5Source(path, "a").about.blocks is None


def test_contiguous_rows_are_read_without_hdf5(path, monkeypatch):
    write(path, rows=np.arange(30.0).reshape(10, 3))
    source = Hdf5Source(path, "rows")
    monkeypatch.setitem(sys.modules, "h5py", None)
    np.testing.assert_array_equal(source.take(np.array([4])), [[12, 13, 14]])
    assert source.bytes_to_take(1) == 240


def test_a_user_block_comes_before_the_rows(path):
    write(path, userblock=512, rows=np.arange(30.0).reshape(10, 3))
    np.testing.assert_array_equal(Hdf5Source(path, "rows").take(np.array([4])), [[12, 13, 14]])


def test_numbers_of_few_bits_are_read_by_hdf5(path):
    """Their bytes are not those of NumPy's dtype."""
    kind = h5py.h5t.STD_I32LE.copy()
    kind.set_precision(12)
    kind.set_offset(4)
    with h5py.File(path, "w") as file:
        dataset = h5py.h5d.create(file.id, b"rows", kind, h5py.h5s.create_simple((4, 2)))
        dataset.write(h5py.h5s.ALL, h5py.h5s.ALL, np.arange(8, dtype="i4").reshape(4, 2))
    source = Hdf5Source(path, "rows")
    np.testing.assert_array_equal(source.take(np.arange(4)), np.arange(8).reshape(4, 2))


@pytest.mark.parametrize("fill", [0.0, 7.0, np.nan])
def test_what_was_never_written_is_refused(path, refused, fill):
    with h5py.File(path, "w") as file:
        file.create_dataset("rows", (10, 3), "f8", fillvalue=fill)
        chunked = file.create_dataset("chunked", (1000, 3), "f8", fillvalue=fill, chunks=(100, 2))
        chunked[:300], chunked[300:, :2] = 1.0, 2.0
        file.create_dataset("absurd", (2**60, 1), "f8", chunks=(100, 1))[5] = 3.0
        file.create_dataset("none", (0, 3), "f8", chunks=(100, 3), maxshape=(None, 3))
    assert "lacks the numbers of dataset 'rows' (never written, or gone)" in refused(path, Hdf5Source, path, "rows")
    assert "lacks rows 300 to 399 of dataset 'chunked'" in refused(path, Hdf5Source, path, "chunked")
    assert "lacks rows 100 to 199 of dataset 'absurd'" in refused(path, Hdf5Source, path, "absurd")
    assert len(Hdf5Source(path, "none")) == 0


def test_small_datasets_may_lie_in_their_header(path, rng):
    rows = rng.normal(size=(4, 2))
    kept = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    kept.set_layout(h5py.h5d.COMPACT)
    with h5py.File(path, "w") as file:
        space = h5py.h5s.create_simple(rows.shape)
        h5py.h5d.create(file.id, b"rows", h5py.h5t.NATIVE_DOUBLE, space, kept).write(space, space, rows)
    np.testing.assert_array_equal(Hdf5Source(path, "rows").take(np.array([3, 0])), rows[[3, 0]])


@pytest.mark.parametrize("options", WRITTEN.values(), ids=WRITTEN)
def test_links_lead_where_h5py_follows_them(path, rng, options, refused):
    """The same position in this file holds other numbers."""
    rows, data = rng.normal(size=(100, 4)), path.with_name("data.h5")
    write(data, options=options, **{"deep/rows": rows})
    with h5py.File(path, "w") as file:
        file["other"] = np.full((2000, 4), -7.0)
        file["rows"] = h5py.ExternalLink("data.h5", "/deep/rows")
        file["soft"] = h5py.SoftLink("/rows")
        file["deep"] = h5py.ExternalLink("data.h5", "/deep")
        file["deep2/rows"] = h5py.SoftLink("/deep/rows")
        file["same"] = file["other"]
    for name in ("rows", "soft", "deep/rows", "deep2/rows"):
        source = Hdf5Source(path, name)
        np.testing.assert_array_equal(source.take(np.array([0, 99])), rows[[0, 99]])
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(source)).take(np.array([5])), rows[[5]])
    assert Hdf5Source(path, "same").about.blocks is None
    write(data, options=options, **{"deep/rows": rows + 1})
    assert "the file was changed after it was opened" in refused(data, source.take, np.array([0]))
    data.unlink()
    assert "lacks the file data.h5" in refused(path, Hdf5Source, path, "rows")


@pytest.mark.parametrize("name", ["rows", "group/rows", "soft"])
def test_links_to_pipes_and_circles(tmp_path, path, refused, name):
    os.mkfifo(tmp_path / "pipe")
    write(tmp_path / "between.h5", rows=np.zeros((4, 2)))
    with h5py.File(tmp_path / "between.h5", "a") as file:
        file["pipe"] = h5py.ExternalLink("pipe", "/rows")
    with h5py.File(path, "w") as file:
        file["rows"] = h5py.ExternalLink("pipe", "/rows")
        file["group"] = h5py.ExternalLink("pipe", "/")
        file["soft"] = h5py.ExternalLink("between.h5", "/pipe")
        file["a"], file["b"] = h5py.SoftLink("/b"), h5py.SoftLink("/a")
    assert "names pipe, which is no regular file" in refused(path, Hdf5Source, path, name)
    assert "too many links lead to" in refused(path, Hdf5Source, path, "a")


def test_raw_bytes_of_other_files_are_no_numbers(tmp_path, path, refused):
    secret = tmp_path / "secret"
    secret.write_bytes(b"a password, say" * 100)
    with h5py.File(path, "w") as file:
        file.create_dataset("rows", (10, 4), "f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])
    message = refused(path, Hdf5Source, path, "rows")
    assert "the numbers of dataset 'rows' lie in other files, as raw bytes; copy the dataset into this file" in message
    virtual(tmp_path / "virtual.h5", 10, [(path, "rows", 10)], 4)
    message = refused(tmp_path / "virtual.h5", Hdf5Source, tmp_path / "virtual.h5", "rows")
    assert "lie in other files, as raw bytes" in message


def virtual(path, count, parts, width=3):
    layout, first = h5py.VirtualLayout((count, width), "f8"), 0
    for source, name, rows in parts:
        layout[first : first + rows] = h5py.VirtualSource(str(source), name, (rows, width))
        first += rows
    with h5py.File(path, "a") as file:
        file.create_virtual_dataset("rows", layout)


def test_virtual_datasets_are_read_if_all_of_them_is_there(tmp_path, path, rng, refused):
    rows, parts = rng.normal(size=(90, 3)), [tmp_path / "a.h5", tmp_path / "b.h5"]
    for part, piece in zip(parts, (rows[:40], rows[40:]), strict=True):
        write(part, rows=piece)
    write(path, more=rows)
    pieces = [(parts[0], "rows", 40), (parts[1], "rows", 50), (".", "more", 90)]
    virtual(path, 180, pieces)
    source = Hdf5Source(path, "rows")
    np.testing.assert_array_equal(source.take(np.array([0, 39, 40, 89, 179])), rows[[0, 39, 40, 89, 89]])
    write(parts[1], other=rows)
    assert "the file was changed after it was opened" in refused(parts[1], source.take, np.array([0]))
    assert "lacks the part 'rows' of dataset 'rows'" in refused(path, Hdf5Source, path, "rows")
    write(parts[1], rows=rows[:20])
    assert "lacks the end of the part 'rows'" in refused(path, Hdf5Source, path, "rows")
    with h5py.File(parts[1], "w") as file:
        file.create_dataset("rows", (50, 3), "f8", chunks=(10, 3))[:30] = 1.0
    assert "lacks rows 30 to 39 of dataset 'rows'" in refused(path, Hdf5Source, path, "rows")
    parts[1].unlink()
    assert "b.h5, which a link or dataset names" in refused(path, Hdf5Source, path, "rows")
    with h5py.File(tmp_path / "d.h5", "w") as file:
        layout = h5py.VirtualLayout((20, 3), "f8")
        layout[...] = h5py.VirtualSource("a.h5", "rows", (90, 3))[70:]
        file.create_virtual_dataset("rows", layout)
    assert "lacks the end of the part" in refused(tmp_path / "d.h5", Hdf5Source, tmp_path / "d.h5", "rows")
    virtual(tmp_path / "c.h5", 41, pieces[:1])
    assert "lacks parts of dataset 'rows'" in refused(tmp_path / "c.h5", Hdf5Source, tmp_path / "c.h5", "rows")


def test_chunks_do_not_explode(path, refused):
    with h5py.File(path, "w") as file:
        for name, shape, chunk in [("long", (3 * 10**7, 1), (3 * 10**7, 1)), ("wide", (2, 10**7), (1, 10**7))]:
            file.create_dataset(name, shape, "i1", chunks=chunk, compression="gzip")[...] = 1
        file.create_dataset("flat", (4, 10**5 + 1), "i1")[...] = 1
    assert "a chunk of dataset 'long' would take up 240 MB of memory" in refused(path, Hdf5Source, path, "long")
    assert "a chunk of dataset 'wide' would take up 80 MB" in refused(path, Hdf5Source, path, "wide")
    assert "more than 100000 of any table of rows; transpose it" in refused(path, Hdf5Source, path, "flat")


def test_only_blocks_that_hold_a_row_are_read(path, monkeypatch):
    monkeypatch.setattr(hdf5, "block_rows", lambda chunk, width: chunk)
    write(path, options={"chunks": (100, 3)}, rows=np.zeros((1000, 3)))
    source, read = Hdf5Source(path, "rows"), []
    np.testing.assert_array_equal(source.about.blocks, np.arange(0, 1001, 100))
    assert source.about.largest_block == 100
    inner = type(source._rows)
    read_block = inner.read_block
    monkeypatch.setattr(inner, "read_block", lambda self, block: read.append(block) or read_block(self, block))
    source.take(np.array([950, 301, 399, 303]))
    assert read == [3, 9]
    assert source.bytes_to_take(1) == 2400


@pytest.mark.parametrize("options", WRITTEN.values(), ids=WRITTEN)
def test_travels_as_a_short_description(path, options):
    rows = np.arange(30_000.0).reshape(-1, 3)
    write(path, options=options, rows=rows)
    source = Hdf5Source(path, "rows")
    source.take(np.array([1]))
    told = pickle.dumps(source)
    assert len(told) < 2000
    np.testing.assert_array_equal(pickle.loads(told).take(np.array([9, 0])), rows[[9, 0]])
    assert repr(source) == f"Hdf5Source({str(path)!r}: 10000 x 3)"


@pytest.mark.parametrize("options", WRITTEN.values(), ids=WRITTEN)
def test_a_file_that_changes_or_goes_is_noticed(path, refused, change, options):
    write(path, options=options, rows=np.zeros((500, 3)))
    source, other = Hdf5Source(path, "rows"), Hdf5Source(path, "rows")
    change(path)
    assert "was changed while it was read" in refused(path, source.take, np.array([1]))
    assert "was changed while it was read" in refused(path, list, source.chunks(5))
    path.unlink()
    assert "no such file" in refused(path, other.take, np.array([1]))


@pytest.mark.parametrize(
    ("dataset", "problem"),
    [
        ("b", "holds no dataset 'b' (it holds a, deep/f, i, s)"),
        ("deep", "holds no dataset 'deep'"),
        ("s", "holds a dataset 's' of type object"),
        ("i", "holds an array of shape (2, 2, 2), not (n, d) or (n,)"),
        (["a", "deep/f"], "its arrays have 4, 3 rows"),
        ([], "its arrays have no rows"),
    ],
)
def test_other_datasets_are_refused(path, refused, dataset, problem):
    write(path, **{"a": np.zeros((4, 3)), "deep/f": np.zeros(3), "i": np.zeros((2, 2, 2)), "s": ["a", "b"]})
    assert problem in refused(path, Hdf5Source, path, dataset)


def test_columns_it_does_not_hold(path, refused):
    write(path, a=np.zeros((4, 3)), x=np.zeros(4), y=np.zeros(4))
    assert "holds no column 3 (it holds 0, 1, 2)" in refused(path, Hdf5Source, path, "a", [3])
    assert "holds no column 'z' (it holds x, y)" in refused(path, Hdf5Source, path, ["x", "y"], ["z"])


def test_damaged_files(tmp_path, path, refused):
    write(path, rows=np.zeros((400, 3)))
    content = path.read_bytes()
    for size in (20, 1000, len(content) - 1):
        path.write_bytes(content[:size])
        assert "truncated" in refused(path, Hdf5Source, path, "rows")
    path.write_bytes(b"1 2 3\n")
    assert "is not an HDF5 file, it looks like a text table" in refused(path, Hdf5Source, path, "rows")
    assert "is a folder" in refused(tmp_path, Hdf5Source, tmp_path, "rows")


def test_damaged_chunks(path, refused):
    write(path, options=WRITTEN["compressed"], rows=np.random.default_rng(0).normal(size=(500, 3)))
    content = bytearray(path.read_bytes())
    content[-500:-400] = bytes(100)
    path.write_bytes(content)
    assert "damaged" in refused(path, list, Hdf5Source(path, "rows").chunks(100))


def test_h5py_missing(path, refused, monkeypatch):
    write(path, rows=np.zeros((4, 3)))
    monkeypatch.setitem(sys.modules, "h5py", None)
    assert refused(path, Hdf5Source, path, "rows").endswith('HDF5 files needs h5py; pip install "nonsac[hdf5]"')
