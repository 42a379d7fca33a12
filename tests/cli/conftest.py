"""Fixtures of the tests of the command line, in this process where it can be: kernels compile once for all tests."""

import pytest

from nonsac import cli


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(capsys):
    """Run the command line; what comes back is (exit code, stdout, stderr)."""

    def call(*arguments):
        code = cli.main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return code, captured.out, captured.err

    return call


@pytest.fixture
def refused(run, folder):
    """Run what must end in exit 2 with one line on stderr, nothing on stdout and no new file; return the line."""

    def call(*arguments):
        before = sorted(folder.rglob("*"))
        code, out, err = run(*arguments)
        assert (code, out) == (2, "")
        assert err.startswith("nonsac: ")
        assert err.count("\n") == 1
        assert sorted(folder.rglob("*")) == before
        return err

    return call
