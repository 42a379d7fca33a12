"""Text from standard input and pipes; and what is no file at all."""

import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import nonsac
from nonsac.files import pipes
from nonsac.io import read_cloud, read_hloc, read_matches, read_points, read_transform
from nonsac.running.journal import Journal
from nonsac.sources import Hdf5Source, LasSource, NpySource, ParquetSource, RawSource

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")

READ = "import sys; from nonsac.io import read_cloud; print(read_cloud(sys.argv[1]).tolist())"
CALLS = {
    **dict.fromkeys((".ply", ".pcd", ".npy", ".npz", ".las", ".laz", ".csv", ".xyz", ".txt"), read_cloud),
    "matches.npy": read_matches,
    "matches.csv": read_matches,
    "points.npz": read_points,
    "transform.txt": read_transform,
    "rows": nonsac.open_source,
    "rows.parquet": ParquetSource,
    "rows.h5": lambda path: Hdf5Source(path, "rows"),
    "features.h5": lambda path: read_hloc(path, path, "a", "b"),
    "cloud.las": LasSource,
    "numbers.npy": NpySource,
    "numbers.raw": lambda path: RawSource(path, "f8", 3),
    "database.db": lambda path: read_matches(path, "a", "b"),
    "run.partial": lambda path: Journal(path, {}, resume=True),
}


def needs(name):
    for suffix, library in ((".parquet", "pyarrow"), (".h5", "h5py"), (".las", "laspy"), (".laz", "laspy")):
        if name.endswith(suffix):
            pytest.importorskip(library)


@pytest.mark.parametrize("name", CALLS)
def test_devices_are_refused(tmp_path, refused, name):
    needs(name)
    path = tmp_path / ("a" + name)
    path.symlink_to("/dev/zero")
    assert "is no regular file; copy what it gives to a file on disk" in refused(CALLS[name], path)


@pytest.mark.parametrize("name", CALLS)
def test_pipes_without_a_writer_are_not_waited_for(tmp_path, refused, monkeypatch, name):
    needs(name)
    monkeypatch.setattr(pipes, "_SECONDS_TO_WAIT", 0.1)
    path = tmp_path / ("a" + name)
    os.mkfifo(path)
    message = refused(CALLS[name], path)
    if path.suffix in pipes.TEXT_SUFFIXES:
        assert "is a pipe that nobody writes to; start the program that writes to it first" in message
    else:
        assert "is no regular file; copy what it gives to a file on disk (a pipe is read as text only" in message


def test_a_zarr_whose_description_is_a_pipe(tmp_path, refused):
    zarr = pytest.importorskip("zarr")
    for folder in (tmp_path / "array", tmp_path / "group"):
        zarr.open_group(str(folder), mode="w").create_array("rows", data=np.ones((3, 4)))
    for file in (tmp_path / "array" / "zarr.json", tmp_path / "group" / "rows" / "zarr.json"):
        file.unlink()
        os.mkfifo(file)
        assert "is no regular file" in refused(lambda path: nonsac.open_source(path.parent), file)
        with pytest.raises(nonsac.InputError, match="is no regular file"):
            nonsac.sources.ZarrSource(file.parent)


def test_a_named_pipe_of_text(tmp_path):
    path = tmp_path / "a.csv"
    os.mkfifo(path)

    def write():
        time.sleep(0.2)  # the reader comes first
        with path.open("w") as file:
            file.write("z,y,x\n1,2,3\n")
            file.flush()
            time.sleep(0.2)  # and finds the pipe empty for a while
            file.write("4,5,6\n")

    writer = threading.Thread(target=write)
    writer.start()
    np.testing.assert_array_equal(read_cloud(path), [[3, 2, 1], [6, 5, 4]])
    writer.join()


@pytest.mark.parametrize("name", ["-", "/dev/stdin"])
def test_standard_input(name):
    done = subprocess.run(
        [sys.executable, "-c", READ, name], input="x y z\n1 2 3\n", capture_output=True, text=True, check=True
    )
    assert done.stdout == "[[1.0, 2.0, 3.0]]\n"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (b"", "-: nothing came; write a table to it"),
        (bytes(100), "-: is not a text table, it looks like an unknown binary file"),
        (b"\x93NUMPY", "-: is not a text table, it looks like a NumPy array"),
    ],
)
def test_what_comes_must_be_text(given, message):
    done = subprocess.run([sys.executable, "-c", READ, "-"], input=given, capture_output=True)
    assert message in done.stderr.decode().splitlines()[-1]


def test_a_terminal_or_device_is_no_input():
    with open("/dev/zero", "rb") as zeros:
        done = subprocess.run([sys.executable, "-c", READ, "-"], stdin=zeros, capture_output=True)
    assert "-: is no regular file" in done.stderr.decode().splitlines()[-1]


def test_a_stream_has_a_bound(tmp_path, refused, monkeypatch):
    monkeypatch.setattr(pipes, "_MOST_BYTES", 1 << 20)
    path = tmp_path / "a.txt"
    os.mkfifo(path)

    def write():
        try:
            with path.open("wb") as file:
                while True:
                    file.write(b"1 2 3\n" * 1000)
        except BrokenPipeError:
            pass

    writer = threading.Thread(target=write)
    writer.start()
    assert "gives more than 1 MiB, which is the most that is read from a pipe; save it" in refused(read_cloud, path)
    writer.join()


@pytest.mark.parametrize("read", [read_cloud, read_matches, nonsac.open_source, read_transform])
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a" * 300 + ".xyz", "the name is too long for the system; shorten it"),
        ("a/" * 3000 + "a.xyz", "the name is too long for the system; shorten it"),
        ("a\0b.xyz", r"a\0b.xyz: cannot be the name of a file (embedded null byte); correct the path"),
    ],
)
def test_names_that_no_file_can_have(read, name, message):
    with pytest.raises(nonsac.InputError) as caught:
        read(name)
    assert str(caught.value).endswith(message)
    assert len(str(caught.value)) < 500
