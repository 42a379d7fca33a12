"""The fuzzer sees what it is for."""

import random
import subprocess
import sys

import pytest

from fuzz import cases, formats, mutations, pool, run
from fuzz.planted import PLANTED

pytestmark = pytest.mark.slow

_KINDS = {
    "undocumented": "error",
    "panic": "error",
    "nameless": "message",
    "control": "message",
    "wrong": "wrong",
    "warning": "warning",
    "late": "error",
    "refused-memory": "memory",
    "memory": "memory",
    "hang": "hang",
    "busy": "hang",
    "death": "crash",
}


@pytest.fixture(scope="module")
def reports():
    return pool.fuzz(dict.fromkeys(PLANTED, 6))


def test_documented_errors_pass(reports):
    assert reports["good"].failures == {}


@pytest.mark.parametrize("name", _KINDS)
def test_failures_are_seen_and_do_not_stop_the_rest(reports, name):
    (seen,) = reports[name].failures.values()
    assert [(number, failure.kind) for number, failure in seen] == [(3, _KINDS[name])]
    assert reports[name].inputs == 6


def test_every_planted_failure_is_asked_for():
    assert {*_KINDS, "good"} == set(PLANTED)


@pytest.mark.parametrize("name", formats.FORMATS)
def test_inputs_depend_on_their_number_alone(name):
    """So a failure can be made again."""
    if cases.KINDS[name].missing:
        pytest.skip("a library is missing")
    format = formats.FORMATS[name]
    made = [format.files(name, 0, number) for number in range(30)]
    assert [format.files(name, 0, number) for number in reversed(range(30))][::-1] == made
    assert [format.files(name, 1, number) for number in range(30)] != made
    assert len({str(files) for files in made}) > 20


@pytest.mark.parametrize(
    "change", [*mutations.BYTES, *mutations.TEXT, *mutations.JSON, *mutations.ARCHIVE], ids=lambda c: c.__name__
)
@pytest.mark.parametrize("content", [b"", b"\n", b"x", b"\0" * 9, b'{"a": [1, {"b": null}]}', b"1 2 3\n4 5 6\n"])
def test_any_bytes_can_be_changed(change, content):
    rng = random.Random(0)
    for _ in range(50):
        assert isinstance(change(rng, content, b"other"), bytes)


def test_replay(tmp_path):
    """A saved input is tried again by one command."""
    failure = pool.judge.Failure("error", "", "planted")
    run.save(tmp_path, "ply-ascii", 0, 12, failure)
    assert {path.name for path in (tmp_path / "input").iterdir()} == {"a.ply"}
    command = [sys.executable, run.__file__, "--replay", str(tmp_path)]
    said = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert said.returncode == 0, said.stderr
    assert said.stdout.splitlines()[-1] == "now: no failure"


def test_command_counts_and_saves(tmp_path):
    command = [sys.executable, run.__file__, "40", "--format", "ply-ascii", "--workers", "1", "--save", str(tmp_path)]
    said = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert said.returncode == 0, said.stderr
    assert "40 inputs, 0 failures" in said.stdout
