"""nonsac verify: what it prints, writes and refuses, and runs that are killed."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import nonsac
from cli_samples import said
from database_samples import hloc_files, many_pairs, rows_of, write_photos
from waiting import wait_until


@pytest.fixture
def database(folder):
    many_pairs("database.db", 5)
    return "database.db"


def test_a_copy_with_summary_report_and_picture(run, database):
    arguments = ("verify", database, "--output", "out.db", "--report", "pairs.jsonl", "--plot", "graph.png")
    code, out, _ = run(*arguments, "--workers", "1")
    assert code == 0
    found = nonsac.verify(database, "again.db", workers=1)
    assert Path("out.db").read_bytes() == Path("again.db").read_bytes()
    lines = out.splitlines()
    assert lines[: len(str(found).splitlines())] == str(found).splitlines()
    assert lines[-4].endswith("pairs/s")
    assert lines[-3:] == [
        "wrote out.db: the geometries of 10 pairs",
        "wrote pairs.jsonl: a line for each pair",
        "wrote graph.png: the graph of matches",
    ]
    pairs = [json.loads(line) for line in Path("pairs.jsonl").read_text().splitlines()]
    assert pairs == [json.loads(json.dumps(pair.to_dict())) for pair in found.pairs]
    assert Path("graph.png").read_bytes()[1:4] == b"PNG"


def test_in_place_and_json(run, database):
    code, out, _ = run("verify", database, "--in-place", "--json", "--workers", "1", "--noise", "0.7")
    facts = json.loads(out)
    assert (code, facts["pairs"], facts["noise"]) == (0, 10, 0.7)
    assert sum(facts["kept"].values()) + sum(facts["left_out"].values()) == 10 == len(rows_of(database))
    assert os.listdir() == [database]


def test_files_of_hloc(run, folder):
    photos, wrong = many_pairs("other.db", 4)
    hloc_files(folder, photos, wrong)
    arguments = ("features.h5", "matches.h5", "--pairs", "pairs.txt", "--cameras", str(photos.camera))
    code, _, _ = run("verify", *arguments, "--output", "out.db", "--workers", "1")
    assert code == 0
    assert len(rows_of("out.db")) == 6


def test_exit_1_if_nothing_is_kept(run, folder):
    photos, wrong = many_pairs("other.db", 2)
    _, matches, *_ = hloc_files(folder, photos, dict.fromkeys(wrong, 1.0))
    write_photos("wrong.db", photos, matches)
    code, out, _ = run("verify", "wrong.db", "--output", "out.db", "--workers", "1")
    assert code == 1
    assert "1 pairs, 0 kept" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "give the name of a copy, or --in-place, and not both"),
        (("--output", "out.db", "--in-place"), "and not both"),
        (("--output", "out.db", "--report", "a.txt"), "end the name in .jsonl"),
        (("--output", "out.db", "--plot", "a.gif"), ".png, .pdf or .svg"),
        (("--output", "out.jsonl", "--report", "out.jsonl"), "is used already"),
        (("--output", "none/out.db"), "does not exist"),
        (("--output", "out.db", "--pairs", "none.txt"), "no such file"),
        (("--output", "out.db", "--max-samples", "0"), "max-samples"),
        (("--in-place", "--cameras", "PINHOLE 9 9 5 5 4 4"), "cameras are those of the database"),
    ],
)
def test_refused(refused, database, arguments, message):
    assert message in refused("verify", database, *arguments)


def test_a_killed_run_goes_on_to_the_same_bytes(run, database):
    arguments = ("verify", database, "--workers", "2", "--output")
    code = [sys.executable, "-m", "nonsac", *arguments, "out.db"]
    process = subprocess.Popen(code, stderr=subprocess.PIPE)
    rest = Path("out.db.partial")
    wait_until(lambda: rest.exists() and rest.read_bytes().count(b"\n") >= 3, process)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert not Path("out.db").exists()
    code, _, err = run(*arguments, "out.db")
    assert code == 2
    assert "what is done is kept in out.db.partial; --resume goes on there" in " ".join(said(err))
    assert run(*arguments, "out.db", "--resume")[0] == 0
    assert run(*arguments, "other.db")[0] == 0
    assert Path("out.db").read_bytes() == Path("other.db").read_bytes()
    assert not rest.exists()
