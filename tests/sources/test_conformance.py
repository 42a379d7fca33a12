"""What every source must do; a new source in `nonsac.sources` has to be added to EXAMPLES, the test says so."""

import numpy as np
import pytest
from scipy.stats import chi2

import nonsac.sources
from nonsac.method.sampling import sample_rows
from nonsac.sources import (
    AllPairsSource,
    ArraySource,
    Hdf5Source,
    HeldSource,
    JoinedSource,
    LasSource,
    MappedSource,
    NpySource,
    ParquetSource,
    RawSource,
    SomeBlocksSource,
    StreamSource,
    WithoutRows,
    ZarrSource,
)
from nonsac.testing import check_source

ROWS = np.arange(60.0).reshape(20, 3)
BLOCKS = np.array([2, 11, 15]), np.array([5, 12, 19])


def raw(folder, rows=ROWS):
    (folder / "rows.bin").write_bytes(rows.astype(">f4").tobytes())
    return RawSource(folder / "rows.bin", ">f4", rows.shape[1]), rows


def npy(folder, rows=ROWS):
    np.save(folder / "rows.npy", np.asfortranarray(rows))
    return NpySource(folder / "rows.npy"), rows


def hdf5(folder, rows=ROWS):
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "rows.h5", "w") as file:
        file.create_dataset("rows", data=rows, chunks=(7, rows.shape[1]), compression="gzip")
    return Hdf5Source(folder / "rows.h5", "rows"), rows


def zarr(folder, rows=ROWS):
    library = pytest.importorskip("zarr")
    library.save_array(str(folder / "rows.zarr"), rows)
    return ZarrSource(folder / "rows.zarr"), rows


def laz(folder, rows=ROWS):
    laspy = pytest.importorskip("laspy")
    pytest.importorskip("lazrs")
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.ones(3)
    cloud = laspy.LasData(header)
    cloud.X, cloud.Y, cloud.Z = rows.T.astype(np.int32)
    cloud.write(folder / "rows.laz")
    return LasSource(folder / "rows.laz"), rows


def parquet(rows, folder):
    pa = pytest.importorskip("pyarrow")
    from pyarrow.parquet import write_table

    for number, part in enumerate(np.array_split(rows, 2)):
        names = list(map(str, range(rows.shape[1])))
        write_table(pa.table(list(part.T), names), folder / f"{number}.parquet", row_group_size=1 + len(rows) // 7)
    return ParquetSource(folder)


def stream(rows):
    source = StreamSource(np.array_split(rows, 3))
    return source, source.rows.copy()


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
    MappedSource: lambda folder: (MappedSource(ArraySource(ROWS), np.negative), -ROWS),
    ParquetSource: lambda folder: (parquet(ROWS, folder), ROWS),
    SomeBlocksSource: lambda _: (SomeBlocksSource(ArraySource(ROWS), *BLOCKS), ROWS[[2, 3, 4, 11, 15, 16, 17, 18]]),
    StreamSource: lambda _: stream(ROWS),
    WithoutRows: lambda _: (WithoutRows(ArraySource(ROWS), np.array([0, 5, 6])), np.delete(ROWS, [0, 5, 6], axis=0)),
}
# Class -> a source with these rows, in any order; those left out make their rows themselves.
HOLDING = {
    ArraySource: lambda rows, folder: ArraySource(rows),
    JoinedSource: lambda rows, folder: JoinedSource([rows]),
    MappedSource: lambda rows, folder: MappedSource(ArraySource(-rows), np.negative),
    ParquetSource: parquet,
    SomeBlocksSource: lambda rows, folder: SomeBlocksSource(
        ArraySource(np.concatenate([-rows, rows, -rows])), np.array([len(rows)]), np.array([2 * len(rows)])
    ),
    StreamSource: lambda rows, folder: StreamSource(np.array_split(rows, 7)),
    WithoutRows: lambda rows, folder: WithoutRows(
        ArraySource(np.concatenate([-rows, rows])), np.arange(len(rows), dtype=np.int64)
    ),
    HeldSource: lambda rows, folder: HeldSource(ArraySource(rows)),
    Hdf5Source: lambda rows, folder: hdf5(folder, rows)[0],
    LasSource: lambda rows, folder: laz(folder, np.hstack([rows, rows, rows]))[0],
    NpySource: lambda rows, folder: npy(folder, rows)[0],
    RawSource: lambda rows, folder: raw(folder, rows)[0],
    ZarrSource: lambda rows, folder: zarr(folder, rows)[0],
    AllPairsSource: lambda rows, folder: MappedSource(AllPairsSource(rows[:20] * 10, rows[:10]), added),
}
EXPORTED = [getattr(nonsac.sources, name) for name in nonsac.sources.__all__ if name not in ("Source", "About")]


@pytest.fixture(params=EXPORTED, ids=lambda kind: kind.__name__)
def example(request, tmp_path):
    assert request.param in EXAMPLES, f"add an example of {request.param.__name__} to EXAMPLES"
    return EXAMPLES[request.param](tmp_path)


def test_does_what_the_contract_says(example):
    source, rows = example
    check_source(source, rows)
    assert type(len(source)) is type(source.width) is int


def test_some_of_its_columns_are_a_source(example):
    source, rows = example
    check_source(source.narrowed([2, 0]), rows[:, [2, 0]])


def test_what_it_says_of_itself_is_consistent(example):
    source, rows = example
    about = source.about
    assert about.names is None or len(about.names) == source.width
    assert type(about.in_memory) is type(about.keeps_rows) is bool
    assert 0 == source.bytes_to_take(0) <= source.bytes_to_take(1) <= source.bytes_to_take(len(rows))
    assert type(source.bytes_to_take(1)) is int
    if about.blocks is not None:
        assert (about.blocks[0], about.blocks[-1]) == (0, len(rows))
        assert (np.diff(about.blocks) >= 0).all()
        assert 0 < about.largest_block <= len(rows)


@pytest.mark.parametrize("size", [1, 4, 7, 1000])
def test_chunks_are_all_rows_in_order(example, size):
    source, rows = example
    chunks = list(source.chunks(size))
    assert all(chunk.dtype == np.float64 and chunk.flags.c_contiguous and chunk.flags.writeable for chunk in chunks)
    assert all(len(chunk) == size for chunk in chunks[:-1])
    np.testing.assert_array_equal(np.vstack(chunks), rows)


@pytest.mark.parametrize(("start", "stop"), [(0, 5), (3, 3), (4, 9), (7, None), (2, 1000)])
def test_chunks_of_a_range(example, start, stop):
    source, rows = example
    chunks = list(source.chunks(2, start, stop))
    assert all(len(chunk) == 2 for chunk in chunks[:-1])
    np.testing.assert_array_equal(np.vstack([np.empty((0, source.width)), *chunks]), rows[start:stop])


def added(rows):
    return rows.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("kind", EXPORTED, ids=lambda kind: kind.__name__)
def test_samples_hold_every_row_equally_often(kind, tmp_path):
    """Of 200 rows that hold their own number, two samples of 20 in each of 500 passes."""
    assert kind in HOLDING, f"add {kind.__name__} to HOLDING"
    source, counts = HOLDING[kind](np.arange(200.0)[:, None], tmp_path), np.zeros(200)
    for turn in range(500):
        for sample in range(2):  # of ten that a pass has
            rows = source.take(sample_rows(200, 200 * turn + 20 * sample, 20, seed=3))
            np.add.at(counts, rows[:, 0].astype(int), 1)
    assert counts.sum() == 500 * 40
    # Without replacement the counts vary less than Poisson's, by the share that is left out.
    assert 1e-3 < chi2.sf(np.sum((counts - 100) ** 2) / 100 / 0.8, 199) < 1 - 1e-3
