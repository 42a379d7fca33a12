import bz2
import json
import lzma
import pickle
import shutil
import sys

import numpy as np
import pytest

from limits import little_memory
from nonsac.files.compressed import expands_beyond
from nonsac.sources import ZarrSource
from nonsac.sources import zarr as module

zarr = pytest.importorskip("zarr")

__all__ = ["little_memory"]

FORMATS = [2, 3] if zarr.__version__ >= "3" else [2]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "rows.zarr"


@pytest.fixture(params=FORMATS, ids=lambda number: f"v{number}")
def formatted(request):
    """Options for one of the formats of Zarr."""
    return {"zarr_format": request.param} if zarr.__version__ >= "3" else {}


def write(store, rows, chunks=(100, 2), **options):
    array = zarr.create(shape=rows.shape, dtype=rows.dtype, chunks=chunks, store=store, **options)
    array[...] = rows


@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", "f2", "i1", "u1", ">i2", "u4", "i8"])
def test_rows_of_any_dtype(path, rng, monkeypatch, dtype, formatted):
    monkeypatch.setattr(module, "block_rows", lambda chunk, width: chunk)
    rows = rng.integers(0, 100, (450, 3)).astype(dtype)
    write(str(path), rows, **formatted)
    indices = rng.integers(0, 450, 10)
    for columns in (None, [2, 0], [1, 1]):
        source, chosen = ZarrSource(path, columns=columns), rows[:, slice(None) if columns is None else columns]
        assert (len(source), source.width) == chosen.shape
        np.testing.assert_array_equal(source.about.blocks, [0, 100, 200, 300, 400, 450])
        np.testing.assert_array_equal(source.take(indices), chosen[indices])
        np.testing.assert_array_equal(np.vstack(list(source.chunks(130, 9, 420))), chosen[9:420])


@pytest.mark.skipif(zarr.__version__ < "3", reason="no shards")
def test_shards_are_blocks(path, rng, monkeypatch):
    monkeypatch.setattr(module, "block_rows", lambda chunk, width: chunk)
    rows = rng.normal(size=(450, 3))
    array = zarr.create_array(store=str(path), shape=rows.shape, dtype="f8", chunks=(20, 3), shards=(200, 3))
    array[...] = rows
    source = ZarrSource(path)
    np.testing.assert_array_equal(source.about.blocks, [0, 200, 400, 450])
    np.testing.assert_array_equal(source.take(np.array([449, 3])), rows[[449, 3]])


def group(path, formatted, **arrays):
    node = zarr.open_group(str(path), mode="w", **formatted)
    for name, rows in arrays.items():
        write(node.store, rows, (7,) * rows.ndim, path=name, **formatted)


def test_arrays_of_a_group_side_by_side(path, rng, formatted):
    x, y, uv = rng.normal(size=300), np.arange(300, dtype="i2"), rng.normal(size=(300, 2)).astype("f4")
    group(path, formatted, **{"deep/x": x, "y": y, "uv": uv})
    indices = rng.integers(0, 300, 50)
    source = ZarrSource(path, ["uv", "deep/x", "y"], [1, 3, 0, 2])
    np.testing.assert_array_equal(source.take(indices), np.column_stack([uv[:, 1], y, uv[:, 0], x])[indices])
    assert source.about.names is None
    assert ZarrSource(path, ("deep/x", "y")).about.names == ("deep/x", "y")
    named = ZarrSource(path, ("deep/x", "y"), ["y"])
    assert (named.names, named.about.names) == (("y",), None)
    np.testing.assert_array_equal(named.take(indices), y[indices, None])
    np.testing.assert_array_equal(ZarrSource(path, "uv").take(indices), uv[indices])


@pytest.mark.parametrize("scheme", ["file", "memory"])
def test_urls(path, rng, formatted, scheme):
    pytest.importorskip("fsspec")
    url = path.as_uri() if scheme == "file" else f"memory://{path.name}/{formatted}"
    rows = rng.normal(size=(450, 3))
    write(str(path) if scheme == "file" else url, rows, **formatted)
    source = ZarrSource(url)
    assert source.path == url
    np.testing.assert_array_equal(source.take(np.array([449, 3])), rows[[449, 3]])


def test_only_blocks_that_hold_a_row_are_read(path, monkeypatch):
    monkeypatch.setattr(module, "block_rows", lambda chunk, width: chunk)
    write(str(path), np.ones((1000, 3)))
    source, read = ZarrSource(path), []
    read_block = ZarrSource.read_block
    monkeypatch.setattr(ZarrSource, "read_block", lambda self, block: read.append(block) or read_block(self, block))
    source.take(np.array([950, 301, 399, 303]))
    assert read == [3, 9]
    assert source.bytes_to_take(1) == 2400


def test_travels_as_a_short_description(path, formatted):
    rows = np.arange(30_000.0).reshape(-1, 3)
    write(str(path), rows, **formatted)
    source = ZarrSource(path)
    source.take(np.array([1]))
    told = pickle.dumps(source)
    assert len(told) < 2000
    np.testing.assert_array_equal(pickle.loads(told).take(np.array([9, 0])), rows[[9, 0]])
    assert repr(source) == f"ZarrSource({str(path)!r}: 10000 x 3)"


def test_an_array_that_is_gone_or_another_one(path, refused, formatted):
    write(str(path), np.ones((500, 3)), **formatted)
    source = ZarrSource(path)
    source.take(np.array([1]))
    told = pickle.dumps(source)
    shutil.rmtree(path)
    assert "no such file" in refused(path, source.take, np.array([1]))
    assert "no such file" in refused(path, pickle.loads(told).take, np.array([1]))
    write(str(path), np.ones((400, 3)), **formatted)
    assert "was changed while it was read" in refused(path, pickle.loads(told).take, np.array([1]))


@pytest.mark.parametrize("dtype", ["f8", "f4", "i2", "u1"])
@pytest.mark.parametrize("fill", [0, 1, 7])
def test_chunks_that_are_gone_or_were_never_written(path, refused, monkeypatch, formatted, dtype, fill):
    monkeypatch.setattr(module, "block_rows", lambda chunk, width: 2 * chunk)
    rows = (np.arange(1350).reshape(450, 3) % 97).astype(dtype)
    write(str(path), rows, fill_value=fill, **formatted)
    np.testing.assert_array_equal(ZarrSource(path).take(np.arange(450)), rows)
    (gone,) = [chunk for chunk in path.rglob("*") if str(chunk.relative_to(path)) in ("2.1", "c/2/1")]
    gone.unlink()
    source = ZarrSource(path)
    assert "lacks rows 200 to 299 (never written, or gone)" in refused(path, source.take, np.array([399]))
    assert "lacks rows 200 to 299" in refused(path, list, source.chunks(500))
    np.testing.assert_array_equal(source.take(np.array([5, 199, 449])), rows[[5, 199, 449]])
    np.testing.assert_array_equal(ZarrSource(path, columns=[1, 0]).take(np.arange(450)), rows[:, [1, 0]])
    rows[300:] = fill
    write(str(path / "other"), rows, fill_value=fill, **formatted)
    assert "lacks rows 300 to 399" in refused(path / "other", ZarrSource(path / "other").take, np.array([399, 5]))


def test_fill_values_that_were_written_are_numbers(path, formatted):
    array = zarr.create(shape=(40, 3), dtype="f8", chunks=(10, 3), store=str(path), fill_value=np.nan, **formatted)
    array[...] = np.where(np.arange(40)[:, None] < 39, np.nan, 5.0)
    for chunk, rows in [(0, 10), (3, 10)]:
        array[10 * chunk : 10 * chunk + rows, 1] = 5.0
    array[10:30] = 0.0
    expected = array[:]
    np.testing.assert_array_equal(ZarrSource(path).take(np.arange(40)), expected)


@pytest.mark.skipif(zarr.__version__ < "3", reason="no shards")
def test_chunks_that_were_never_written_into_a_shard(path, rng, refused, monkeypatch):
    monkeypatch.setattr(module, "block_rows", lambda chunk, width: chunk)
    array = zarr.create_array(store=str(path), shape=(450, 3), dtype="f8", chunks=(20, 3), shards=(200, 3))
    array[:240] = rng.normal(size=(240, 3))
    source = ZarrSource(path)
    np.testing.assert_array_equal(source.take(np.array([5, 199])), array[:][[5, 199]])
    assert "lacks rows 240 to 259" in refused(path, source.take, np.array([210]))
    assert "lacks rows 400 to 419" in refused(path, source.take, np.array([449]))


ABSURD = {
    "no chunks": ({"chunks": [0, 4]}, "names the chunks (0, 4), which no array has"),
    "10^18": ({"shape": [10**18, 4]}, "promises 1e+18 rows"),
    "10^30": ({"shape": [10**30, 4]}, "more than any file holds"),
    "3 10^13": ({"shape": [3 * 10**13, 4], "chunks": [1000, 4]}, "promises 3e+13 rows"),
    "10^10": ({"shape": [10**10, 4], "chunks": [1000, 4]}, "lacks rows 99999"),
    "wide": ({"shape": [60, 4 * 10**7]}, "more than 100000 of any table"),
    "large chunks": ({"shape": [10**8, 4], "chunks": [10**8, 4]}, "a chunk would take up 3.2 GB of memory"),
    "negative": ({"shape": [-5, 4]}, ""),
}


@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize(("changes", "problem"), ABSURD.values(), ids=ABSURD)
def test_metadata_that_nothing_bears_out(path, refused, changes, problem):
    usual = {"zarr_format": 2, "shape": [60, 4], "chunks": [16, 4], "dtype": "<f8", "compressor": None}
    path.mkdir()
    (path / ".zarray").write_text(json.dumps(usual | {"fill_value": 0.0, "order": "C", "filters": None} | changes))
    assert problem in refused(path, ZarrSource, path)


@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize("codec", ["Zstd", "BZ2", "LZMA"])
@pytest.mark.parametrize("name", ["", "deep/x"])
def test_chunks_do_not_explode(path, refused, codec, name):
    """A few bytes that would become gigabytes, in the place of a chunk of 1000 numbers."""
    codec, store = getattr(pytest.importorskip("numcodecs"), codec)(), str(path / name)
    write(store, np.arange(1.0, 1001).reshape(500, 2), (500, 2), **({"zarr_format": 2} if FORMATS != [2] else {}))
    (chunk,) = [file for file in path.rglob("0.0") if file.is_file()]
    metadata = json.loads((chunk.parent / ".zarray").read_text())
    (chunk.parent / ".zarray").write_text(json.dumps(metadata | {"compressor": codec.get_config()}))
    chunk.write_bytes(codec.encode(np.arange(1.0, 1001)))
    source = ZarrSource(store)
    np.testing.assert_array_equal(source.take(np.array([499])), [[999, 1000]])
    chunk.write_bytes(codec.encode(np.zeros(30_000_000, np.uint8)))
    assert "is a chunk that would expand far beyond its size" in refused(chunk, source.take, np.array([499]))


@pytest.mark.parametrize("size", [0, 1, 200, 300, 70_000, 10**6])
def test_sizes_in_frames(tmp_path, size):
    zstd = pytest.importorskip("numcodecs").Zstd()
    for content in (zstd.encode(bytes(size)), bz2.compress(bytes(size)), lzma.compress(bytes(size))):
        (tmp_path / "chunk").write_bytes(content)
        assert not expands_beyond(size, str(tmp_path / "chunk"))
        assert size == 0 or expands_beyond(size - 1, str(tmp_path / "chunk"))


def test_damaged_chunks(path, refused, formatted):
    write(str(path), np.random.default_rng(0).normal(size=(500, 3)), **formatted)
    for chunk in path.rglob("*"):
        if chunk.is_file() and not chunk.name.startswith((".z", "zarr")):
            chunk.write_bytes(chunk.read_bytes()[:-9])
    assert "is truncated or damaged" in refused(path, list, ZarrSource(path).chunks(100))


def test_other_arrays_are_refused(path, refused, formatted):
    group(path, formatted, a=np.zeros((4, 3)), c=np.zeros((4, 3), complex), i=np.zeros((2, 2, 2)), x=np.zeros(3))
    assert "is a group of arrays (it holds a, c, i, x); name one" in refused(path, ZarrSource, path)
    assert "holds no array 'b' (it holds a, c, i, x)" in refused(path, ZarrSource, path, "b")
    assert "holds an array of type complex128" in refused(path, ZarrSource, path, "c")
    assert "holds an array of shape (2, 2, 2)" in refused(path, ZarrSource, path, "i")
    assert "its arrays have 4, 3 rows" in refused(path, ZarrSource, path, ["a", "x"])
    assert "holds no column 3 (it holds 0, 1, 2)" in refused(path, ZarrSource, path, "a", [3])
    assert "is an array, not a group" in refused(path / "a", ZarrSource, path / "a", "x")


def test_what_is_no_zarr_array(tmp_path, path, refused):
    assert "no such file" in refused(path, ZarrSource, path)
    path.write_bytes(b"1 2 3\n")
    assert "holds no Zarr array or group" in refused(path, ZarrSource, path)
    assert "holds no Zarr array or group" in refused(tmp_path, ZarrSource, tmp_path)


def test_zarr_missing(path, refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    assert refused(path, ZarrSource, path).endswith('Zarr arrays needs zarr; pip install "nonsac[zarr]"')
