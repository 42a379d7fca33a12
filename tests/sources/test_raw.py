import gc
import os
import pickle
import threading
from pathlib import Path

import numpy as np
import pytest

from nonsac.files import positioned as files
from nonsac.sources import RawSource

DTYPES = ["f8", "f4", "f2", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "rows.bin"


def write(path, rows, before=0, after=0):
    path.write_bytes(b"h" * before + np.ascontiguousarray(rows).tobytes() + b"t" * after)
    return rows


@pytest.mark.parametrize("dtype", [order + kind for order in "<>" for kind in DTYPES])
def test_rows_of_any_dtype_and_byte_order(path, rng, dtype):
    rows = write(path, rng.integers(0, 100, (500, 3)).astype(dtype))
    source = RawSource(path, dtype, 3)
    assert (len(source), source.width) == rows.shape
    indices = rng.integers(0, 500, 200)
    np.testing.assert_array_equal(source.take(indices), rows[indices])
    np.testing.assert_array_equal(np.vstack(list(source.chunks(70, 10, 401))), rows[10:401])


@pytest.mark.parametrize("width", [1, 4, 700])
@pytest.mark.parametrize("kind", ["random", "all", "clustered", "every 100th", "one"])
def test_rows_far_and_near(path, rng, monkeypatch, width, kind):
    monkeypatch.setattr(files, "_SCRATCH", 20_000)  # several pieces
    rows = write(path, rng.normal(size=(5000, width)))
    indices = {
        "random": rng.permutation(5000)[:300],
        "all": np.arange(5000),
        "clustered": (rng.integers(0, 5, 300) * 900 + rng.integers(0, 9, 300)),
        "every 100th": np.arange(0, 5000, 100),
        "one": np.array([4999]),
    }[kind]
    np.testing.assert_array_equal(RawSource(path, "f8", width).take(indices), rows[indices])


def test_offset_and_number_of_rows(path):
    rows = write(path, np.arange(30.0).reshape(10, 3), before=7, after=11)
    source = RawSource(path, "f8", 3, offset=7, rows=10)
    np.testing.assert_array_equal(source.take(np.arange(10)), rows)
    np.testing.assert_array_equal(np.vstack(list(source.chunks(4))), rows)
    assert len(RawSource(path, "f8", 3, offset=7, rows=0)) == 0


def test_as_few_bytes_are_read_as_can_be(path, monkeypatch):
    write(path, np.zeros((100_000, 4)))
    source, read = RawSource(path, "f8", 4), []
    pread = os.pread
    monkeypatch.setattr(files.os, "pread", lambda d, length, at: read.append((at, length)) or pread(d, length, at))
    source.take(np.array([90_000, 3, 1, 50_000, 2, 100]))
    assert read == [(32, 100 * 32), (50_000 * 32, 32), (90_000 * 32, 32)]


def test_rows_announced_to_the_disk_are_the_same(path, rng, monkeypatch):
    rows, announced = write(path, rng.normal(size=(9000, 4))), []
    monkeypatch.setattr(files, "_must_come_from_disk", lambda *_: True)
    monkeypatch.setattr(os, "posix_fadvise", lambda *told: announced.append(told[1:3]), raising=False)
    monkeypatch.setattr(os, "POSIX_FADV_WILLNEED", 3, raising=False)
    np.testing.assert_array_equal(RawSource(path, "f8", 4).take(np.array([0, 8000])), rows[[0, 8000]])
    assert announced == [(0, 32), (8000 * 32, 32)]


def test_where_the_system_has_no_positioned_reads(path, rng, monkeypatch):
    monkeypatch.delattr(os, "pread", raising=False)
    monkeypatch.delattr(os, "preadv", raising=False)
    monkeypatch.delattr(os, "RWF_NOWAIT", raising=False)
    rows = write(path, rng.normal(size=(900, 4)))
    source = RawSource(path, "f8", 4)
    np.testing.assert_array_equal(source.take(np.array([800, 2, 3])), rows[[800, 2, 3]])
    np.testing.assert_array_equal(np.vstack(list(source.chunks(400))), rows)


def test_doubles_are_read_in_pieces_the_system_allows(path, rng, monkeypatch):
    monkeypatch.setattr(files, "_LARGEST_READ", 1000)
    rows = write(path, rng.normal(size=(900, 4)))
    np.testing.assert_array_equal(np.vstack(list(RawSource(path, "f8", 4).chunks(800))), rows)


def test_travels_as_a_short_description(path):
    rows = write(path, np.arange(30.0).reshape(10, 3))
    source = RawSource(path, "f8", 3)
    source.take(np.array([1]))
    told = pickle.dumps(source)
    assert len(told) < 500
    np.testing.assert_array_equal(pickle.loads(told).take(np.array([9, 0])), rows[[9, 0]])


def test_says_what_it_is(path):
    write(path, np.zeros((10, 3)))
    assert repr(RawSource(path, "f8", 3)) == f"RawSource({str(path)!r}: 10 x 3)"


def test_a_relative_path_is_found_from_elsewhere(path, monkeypatch):
    rows = write(path, np.arange(30.0).reshape(10, 3))
    monkeypatch.chdir(path.parent)
    source = RawSource(path.name, "f8", 3)
    monkeypatch.chdir("/")
    np.testing.assert_array_equal(source.take(np.array([4])), rows[[4]])


def descriptors(path):
    return sum(os.path.samefile(link, path) for link in Path("/proc/self/fd").iterdir() if link.exists())


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="no list of open files")
def test_the_file_is_open_from_the_first_read_until_the_source_is_gone(path):
    write(path, np.zeros((10, 3)))
    source = RawSource(path, "f8", 3)
    assert descriptors(path) == 0
    source.take(np.array([1]))
    list(source.chunks(3))
    assert descriptors(path) == 1
    del source
    gc.collect()
    assert descriptors(path) == 0


def test_threads_share_a_source(path, rng):
    rows, found = write(path, rng.normal(size=(50_000, 4))), {}
    source, indices = RawSource(path, "f8", 4), rng.integers(0, 50_000, (4, 3000))
    threads = [threading.Thread(target=lambda i=i: found.update({i: source.take(indices[i])})) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i in range(4):
        np.testing.assert_array_equal(found[i], rows[indices[i]])


@pytest.mark.parametrize("opened", [False, True])
def test_a_file_that_changes_is_noticed(path, refused, change, opened):
    write(path, np.zeros((10, 3)))
    source = RawSource(path, "f8", 3)
    if opened:
        source.take(np.array([1]))
    change(path)
    for read in (lambda: source.take(np.array([1])), lambda: list(source.chunks(3))):
        assert "was changed while it was read" in refused(path, read)


def test_a_file_that_shrinks_between_the_checks_is_noticed(path, refused, monkeypatch):
    write(path, np.zeros((10, 3)))
    source = RawSource(path, "f8", 3)
    descriptor = source.parts[0].file.check()
    monkeypatch.setattr(files.PositionedFile, "check", lambda _: descriptor)
    os.truncate(path, 100)
    for read in (lambda: source.take(np.array([1, 9])), lambda: list(source.chunks(10))):
        assert "was changed while it was read" in refused(path, read)


def test_a_file_that_is_not_there_for_a_worker(path, refused):
    write(path, np.zeros((10, 3)))
    source = pickle.loads(pickle.dumps(RawSource(path, "f8", 3)))
    path.unlink()
    assert "no such file" in refused(path, source.take, np.array([1]))


def test_a_file_that_was_opened_outlives_its_name(path):
    write(path, np.ones((10, 3)))
    source = RawSource(path, "f8", 3)
    source.take(np.array([1]))
    path.unlink()
    np.testing.assert_array_equal(source.take(np.array([2])), [[1, 1, 1]])


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"width": 4}, "its 240 bytes are no whole number of rows of 32 bytes after 0 others"),
        ({"offset": 1}, "its 240 bytes are no whole number of rows of 24 bytes after 1 others"),
        ({"offset": 240}, "its 240 bytes are no whole number"),
        ({"offset": 24, "rows": 10}, "the file is truncated: it holds 9 rows of 10"),
        ({"dtype": "c16"}, "holds numbers of type complex128"),
        ({"dtype": bool}, "holds numbers of type bool"),
        ({"dtype": object}, "holds numbers of type object"),
    ],
)
def test_what_does_not_fit_is_refused(path, refused, given, problem):
    write(path, np.zeros((10, 3)))
    assert problem in refused(path, RawSource, path, **({"dtype": "f8", "width": 3} | given))


@pytest.mark.parametrize("given", [{"width": 0}, {"offset": -1}, {"rows": -1}])
def test_wrong_arguments(path, given):
    write(path, np.zeros((10, 3)))
    with pytest.raises(ValueError, match="width must be positive, offset and rows not negative"):
        RawSource(path, "f8", **({"width": 3} | given))


def test_what_is_no_file_is_refused(tmp_path, path, refused):
    assert "no such file" in refused(path, RawSource, path, "f8", 3)
    assert "is a folder" in refused(tmp_path, RawSource, tmp_path, "f8", 3)
    path.touch()
    assert "the file is empty" in refused(path, RawSource, path, "f8", 3)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        assert "is no regular file" in refused(tmp_path / "pipe", RawSource, tmp_path / "pipe", "f8", 3)


def test_bytes_to_take(path):
    write(path, np.zeros((100_000, 4)))
    source = RawSource(path, "f8", 4)
    assert [source.bytes_to_take(rows) for rows in (0, 10, 10**6)] == [0, 10 * (32 + 4096), 3_200_000]
