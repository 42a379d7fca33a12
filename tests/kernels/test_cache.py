"""Compiled kernels on disk: without a folder, or with damaged files, calls go on and give the same."""

import os
import subprocess
import sys

import numpy as np
import pytest

from nonsac.kernels import _cache
from nonsac.kernels._jit import kernel

PERMUTE = """
from nonsac.kernels.permutation import _mix
import numpy as np
print(_mix(np.uint64(7)))
"""


def run(folder, script=PERMUTE):
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


@pytest.fixture
def warm(tmp_path):
    """A folder with compiled kernels, and what they give."""
    out, err = run(tmp_path)
    assert err == ""
    return tmp_path, out


def truncate(data):
    return data[: len(data) // 2]


def flip(data):
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


def empty(data):
    return b""


@pytest.mark.parametrize("damage", [truncate, flip, empty])
@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.slow
def test_damaged_kernels_are_compiled_again_once(warm, damage, suffix):
    folder, right = warm
    files = list(folder.rglob(f"*.{suffix}"))
    assert files
    for file in files:
        file.write_bytes(damage(file.read_bytes()))
    out, err = run(folder)
    assert out == right
    assert err.startswith("nonsac: compiled kernels in ")
    assert err.endswith(" are damaged; they are compiled again (once)\n")
    assert err.count("\n") == 1
    assert run(folder) == (right, "")


def test_without_a_folder_each_run_compiles(monkeypatch, caplog):
    monkeypatch.setattr(_cache, "_told", set())

    def no_folder(function):
        raise RuntimeError("cannot cache function 'f': no locator available")

    monkeypatch.setattr(_cache, "_Cache", no_folder)
    for _ in range(2):
        assert kernel(lambda x: x + 1)(1) == 2
    assert [record.name for record in caplog.records] == ["nonsac"]
    assert "set NUMBA_CACHE_DIR to a folder that can be written" in caplog.text


@pytest.mark.skipif(os.name != "posix" or os.getuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written(tmp_path):
    tmp_path.chmod(0o555)
    out, err = run(tmp_path)
    assert out
    assert err.count("\n") <= 1


def test_kernels_are_read_where_they_cannot_be_written(monkeypatch, caplog):
    monkeypatch.setattr(_cache, "_told", set())

    def function(x):
        return x * 3

    kernel(function)(2)

    def no_file(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", no_file)  # how numba tries whether it may write
    again = kernel(function)
    assert again(2) == 6
    assert sum(again.entry.stats.cache_hits.values()) == 1
    assert caplog.text == ""


def test_a_full_disk(monkeypatch, caplog):
    monkeypatch.setattr(_cache, "_told", set())

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(_cache._CheckedFile, "_save_data", full)
    assert kernel(lambda x: x * 2)(np.float32(1.5)) == 3.0
    assert "compiled kernels cannot be kept (No space left on device)" in caplog.text
