import os

import pytest

from nonsac.files.identity import identity_of


def test_links_of_both_kinds_are_the_file_itself(tmp_path):
    (tmp_path / "a").write_bytes(b"1")
    (tmp_path / "b").write_bytes(b"1")
    os.link(tmp_path / "a", tmp_path / "hard")
    (tmp_path / "soft").symlink_to(tmp_path / "a")
    for name in ("hard", "soft", "./a"):
        assert identity_of(tmp_path / name) == identity_of(tmp_path / "a")
    assert identity_of(tmp_path / "b") != identity_of(tmp_path / "a")


def test_files_that_are_not_there_yet(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert identity_of("new") == identity_of(tmp_path / "new")
    assert identity_of("new") != identity_of("newer")


@pytest.mark.parametrize("name", ["a\0b", "x" * 300])
def test_names_that_no_file_can_have(name):
    assert identity_of(name) == identity_of(name)
