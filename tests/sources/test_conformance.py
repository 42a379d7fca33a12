"""What every source must do; a new source in `nonsac.sources` has to be added to EXAMPLES, the test says so."""

import pickle

import numpy as np
import pytest

import nonsac.sources
from nonsac.sources import (
    AllPairsSource,
    ArraySource,
    Hdf5Source,
    HeldSource,
    JoinedSource,
    LasSource,
    NpySource,
    RawSource,
    Source,
    ZarrSource,
)

ROWS = np.arange(60.0).reshape(20, 3)


def raw(folder):
    (folder / "rows.bin").write_bytes(ROWS.astype(">f4").tobytes())
    return RawSource(folder / "rows.bin", ">f4", 3), ROWS


def npy(folder):
    np.save(folder / "rows.npy", np.asfortranarray(ROWS))
    return NpySource(folder / "rows.npy"), ROWS


def hdf5(folder):
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "rows.h5", "w") as file:
        file.create_dataset("rows", data=ROWS, chunks=(7, 3), compression="gzip")
    return Hdf5Source(folder / "rows.h5", "rows"), ROWS


def zarr(folder):
    library = pytest.importorskip("zarr")
    library.save_array(str(folder / "rows.zarr"), ROWS)
    return ZarrSource(folder / "rows.zarr"), ROWS


def laz(folder):
    laspy = pytest.importorskip("laspy")
    pytest.importorskip("lazrs")
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.ones(3)
    cloud = laspy.LasData(header)
    cloud.X, cloud.Y, cloud.Z = ROWS.T.astype(np.int32)
    cloud.write(folder / "rows.laz")
    return LasSource(folder / "rows.laz"), ROWS


# Class -> a source, which may lie in a folder, and all of its rows.
EXAMPLES = {
    Hdf5Source: hdf5,
    LasSource: laz,
    NpySource: npy,
    RawSource: raw,
    ZarrSource: zarr,
    ArraySource: lambda _: (ArraySource(np.arange(60.0).reshape(20, 3)), np.arange(60.0).reshape(20, 3)),
    AllPairsSource: lambda _: (
        AllPairsSource([[1.0, 2], [3, 4], [5, 6]], np.arange(5.0)[:, None]),
        np.array([[a, b, c] for a, b in ((1.0, 2), (3, 4), (5, 6)) for c in range(5)]),
    ),
    HeldSource: lambda _: (HeldSource(ArraySource(ROWS)), ROWS),
    JoinedSource: lambda _: (
        JoinedSource([np.arange(40).reshape(20, 2), np.arange(20.0)[:, None]], [np.negative, None]),
        np.column_stack([-np.arange(40.0).reshape(20, 2), np.arange(20.0)]),
    ),
}
EXPORTED = [getattr(nonsac.sources, name) for name in nonsac.sources.__all__ if name != "Source"]


@pytest.fixture(params=EXPORTED, ids=lambda kind: kind.__name__)
def example(request, tmp_path):
    assert request.param in EXAMPLES, f"add an example of {request.param.__name__} to EXAMPLES"
    return EXAMPLES[request.param](tmp_path)


def test_follows_the_protocol(example):
    source, rows = example
    assert isinstance(source, Source)
    assert (len(source), source.width) == rows.shape
    assert type(len(source)) is type(source.width) is int


def test_take_gives_the_rows_asked_for(example):
    source, rows = example
    for indices in ([0], [len(rows) - 1, 0], [2, 2, 1], range(len(rows)), []):
        indices = np.array(indices, np.int64)
        np.testing.assert_array_equal(source.take(indices), rows[indices].reshape(-1, source.width))


def test_take_gives_fresh_writable_ordered_doubles(example):
    source, rows = example
    taken = source.take(np.array([1, 2]))
    assert taken.dtype == np.float64
    assert taken.flags.c_contiguous
    assert taken.flags.writeable
    taken[:] = -1.0
    np.testing.assert_array_equal(source.take(np.array([1, 2])), rows[[1, 2]])


@pytest.mark.parametrize("size", [1, 4, 7, 1000])
def test_chunks_are_all_rows_in_order(example, size):
    source, rows = example
    chunks = list(source.chunks(size))
    assert all(chunk.dtype == np.float64 and chunk.flags.c_contiguous and chunk.flags.writeable for chunk in chunks)
    assert all(len(chunk) == size for chunk in chunks[:-1])
    np.testing.assert_array_equal(np.vstack(chunks), rows)


def test_travels_to_another_process(example):
    source, rows = example
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(source)).take(np.array([3, 1])), rows[[3, 1]])


@pytest.mark.parametrize("number", [10**6, -(10**6)])
def test_a_row_that_does_not_exist_is_an_error(example, number):
    with pytest.raises(IndexError):
        example[0].take(np.array([number]))


@pytest.mark.parametrize(("start", "stop"), [(0, 5), (3, 3), (4, 9), (7, None), (2, 1000)])
def test_chunks_of_a_range(example, start, stop):
    source, rows = example
    chunks = list(source.chunks(2, start, stop))
    assert all(len(chunk) == 2 for chunk in chunks[:-1])
    np.testing.assert_array_equal(np.vstack([np.empty((0, source.width)), *chunks]), rows[start:stop])
