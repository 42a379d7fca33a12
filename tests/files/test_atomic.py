import os
import re

import pytest

import nonsac
from nonsac.files.atomic import check_target, write_atomically


def test_writes_through_a_file_of_the_same_suffix_and_folder(tmp_path):
    seen = []

    def writer(temporary):
        seen.append(temporary)
        temporary.write_bytes(b"new")
        assert (tmp_path / "a.ply").read_bytes() == b"old"

    (tmp_path / "a.ply").write_bytes(b"old")
    write_atomically(tmp_path / "a.ply", writer)
    assert (tmp_path / "a.ply").read_bytes() == b"new"
    assert os.listdir(tmp_path) == ["a.ply"]
    assert seen[0].suffix == ".ply"
    assert seen[0].parent == tmp_path.resolve()


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_failure_leaves_the_old_file_alone(tmp_path, error):
    def writer(temporary):
        temporary.write_bytes(b"half")
        raise error

    (tmp_path / "a.txt").write_bytes(b"old")
    with pytest.raises(error):
        write_atomically(tmp_path / "a.txt", writer)
    assert (tmp_path / "a.txt").read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_refusal_of_the_system(tmp_path, refused, monkeypatch, step):
    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, step, refuse)
    message = refused(write_atomically, tmp_path / "a.txt", lambda temporary: temporary.write_bytes(b"new"))
    assert "cannot be written (No space left on device)" in message
    assert os.listdir(tmp_path) == []


def test_places_that_cannot_be_written(tmp_path, refused):
    def never(_):
        raise AssertionError

    assert "none does not exist; create it first" in refused(write_atomically, tmp_path / "none" / "a.txt", never)
    assert "is a folder or a device" in refused(write_atomically, tmp_path, never)
    if os.path.exists(os.devnull) and os.name == "posix":
        assert "is a folder or a device" in refused(write_atomically, os.devnull, never)


@pytest.mark.skipif(os.name != "posix", reason="modes and links are those of POSIX")
def test_umask_and_links_are_respected(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    (tmp_path / "link").symlink_to(tmp_path / "target")
    write_atomically(tmp_path / "link", lambda temporary: temporary.write_bytes(b"new"))
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_bytes() == b"new"
    assert (tmp_path / "target").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_folder_that_is_write_protected(tmp_path, refused, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert "is write-protected; choose another one" in refused(check_target, tmp_path / "a.txt")


@pytest.mark.parametrize(
    ("name", "problem"),
    [("a\0b", "cannot be the name of a file (embedded null byte)"), ("x" * 300, "the name is too long for the system")],
)
def test_names_that_no_file_can_have(tmp_path, name, problem):
    with pytest.raises(nonsac.InputError, match=re.escape(problem)):
        write_atomically(tmp_path / name, lambda temporary: pytest.fail("written"))
