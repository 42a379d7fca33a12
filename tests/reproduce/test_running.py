"""Trials in processes, and runs that are stopped."""

import json
import re
import sys

import numpy as np
import pytest

from nonsac.reproduce import running
from nonsac.reproduce.cells import RULES, Cell, Trial
from nonsac.reproduce.experiments import EXPERIMENTS
from nonsac.reproduce.journal import Journal
from nonsac.reproduce.running import Plan, run_trials


@pytest.fixture(scope="module")
def plan():
    registration = EXPERIMENTS["registration"]
    cells = tuple(Cell(registration, 0.9, noise, (2, 3), 500) for noise in (0.01, 0.02))
    return Plan(cells, trials=3, seed=0, settings={"seed": 0, "trials": 3})


@pytest.fixture(scope="module")
def whole(plan):
    return run_trials(plan, workers=1)


def errors_of(outcomes):
    return [[trial.errors for trial in cell] for cell in outcomes]


def test_one_list_of_trials_for_each_cell(plan, whole):
    assert [len(trials) for trials in whole] == [3, 3]
    for cell, trials in zip(plan.cells, whole, strict=True):
        for number, trial in enumerate(trials):
            assert trial.errors == running.run_trial(cell, 0, number).errors


def test_processes_change_nothing(plan, whole):
    seen = []
    outcomes = run_trials(plan, workers=2, progress=lambda *done: seen.append(done))
    assert errors_of(outcomes) == errors_of(whole)
    assert seen == [(done, 6) for done in range(1, 7)]


@pytest.mark.parametrize("kept", [0, 1, 4, 6])
def test_a_stopped_run_goes_on_where_it_was(plan, whole, tmp_path, kept, monkeypatch):
    path = tmp_path / "journal"
    ran = []
    original = running.run_trial

    class Stopped(Exception):
        pass

    def stop(done, total):
        if done == kept:
            raise Stopped

    if kept:
        with pytest.raises(Stopped):
            run_trials(plan, 1, stop, path)
    text = path.read_text() if kept else json.dumps({"settings": plan.settings}) + "\n"
    path.write_text(text + '[5, {"2": {"ide')  # killed while it wrote

    def recorded(cell, seed, number):
        ran.append((cell.noise, number))
        return original(cell, seed, number)

    monkeypatch.setattr("nonsac.reproduce.cells.run_trial", recorded)
    outcomes = run_trials(plan, 1, journal=path, resume=True)
    assert errors_of(outcomes) == errors_of(whole)
    assert len(ran) == 6 - kept
    lines = path.read_text().splitlines()
    assert len(lines) == 7
    assert [json.loads(line)[0] for line in lines[1:]] == list(range(6))


def test_the_journal_keeps_every_bit(tmp_path):
    errors = {
        m: {rule: float(e) for rule, e in zip(RULES, np.random.default_rng(m).random(22), strict=True)} for m in (1, 20)
    }
    errors[1]["ideal"] = float("nan")
    trial = Trial(errors, {1: {"fixed": 0.1}, 20: {"fixed": 1 / 3}}, {1: True, 20: False})
    with Journal(tmp_path / "j", {"seed": 1}) as journal:
        journal.add(9, trial)
    with Journal(tmp_path / "j", {"seed": 1}, resume=True) as journal:
        again = journal.trials[9]
    assert repr(again) == repr(trial)


def test_damaged_trials_run_again(plan, whole, tmp_path, monkeypatch):
    path = tmp_path / "journal"
    run_trials(plan, 1, journal=path)
    lines = path.read_bytes().splitlines(keepends=True)
    place = lines[3].index(b": 0.") + 6
    lines[3] = lines[3][:place] + bytes([lines[3][place] ^ 1]) + lines[3][place + 1 :]
    path.write_bytes(b"".join(lines))
    ran = []
    original = running.run_trial
    monkeypatch.setattr("nonsac.reproduce.cells.run_trial", lambda *trial: ran.append(trial) or original(*trial))
    with pytest.warns(UserWarning, match=r"1 of the trials in .*journal are damaged; what is missing is done again"):
        outcomes = run_trials(plan, 1, journal=path, resume=True)
    assert errors_of(outcomes) == errors_of(whole)
    assert len(ran) == 1


@pytest.mark.skipif(sys.platform == "win32", reason="no flock")
def test_a_journal_that_another_run_writes_to_is_refused(tmp_path):
    with Journal(tmp_path / "j", {"seed": 1}) as journal:
        journal.add(0, Trial({}, {}, {}))
        for resume in (False, True):
            with pytest.raises(ValueError, match="in use by another run"):
                Journal(tmp_path / "j", {"seed": 1}, resume)
        journal.add(1, Trial({}, {}, {}))
    with Journal(tmp_path / "j", {"seed": 1}, resume=True) as journal:
        assert list(journal.trials) == [0, 1]


def test_a_journal_of_another_run_is_refused(tmp_path):
    path = tmp_path / "report.json.partial"
    with Journal(path, {"seed": 1, "samples": (10, 20)}) as journal:
        journal.add(0, Trial({}, {}, {}))
    content = path.read_bytes()
    with pytest.raises(ValueError, match=r"with 1 trials done; .*--resume"):
        Journal(path, {"seed": 1, "samples": (10, 20)})
    with pytest.raises(ValueError, match=re.escape("is of a run with samples [10, 20], not [10]")):
        Journal(path, {"seed": 1, "samples": (10,)}, resume=True)
    with pytest.raises(ValueError, match="with trials None, not 5"):
        Journal(path, {"seed": 1, "samples": (10, 20), "trials": 5}, resume=True)
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    "content",
    [
        b"precious note",
        b"something else\n",
        b"[1]\n",
        b'{"settings": 5}\n',
        b"\xff\n",
        b'{"settings": {}}\n[0,[1],[2],[3]]\n',
        b'{"settings": {}}\n[0,{},5]\n',
        b'{"settings": {}}\n{"success": true}\n',
        b'{"settings": ' + b"[" * 100_000 + b"\n",
    ],
)
@pytest.mark.parametrize("resume", [False, True])
def test_a_file_that_is_no_journal_is_refused_and_kept(tmp_path, content, resume):
    path = tmp_path / "report.json.partial"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"report\.json\.partial is not a record of a run"):
        Journal(path, {"seed": 1}, resume)
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    ("position", "trial"),
    [(0, Trial({}, {}, {})), (99, Trial({2: {}, 3: {}}, {2: {}, 3: {}}, {2: True, 3: True}))],
)
def test_a_trial_that_does_not_fit_is_told_before_others_run(plan, tmp_path, position, trial):
    path = tmp_path / "journal"
    with Journal(path, plan.settings) as journal:
        journal.add(position, trial)
    with pytest.raises(ValueError, match="is damaged"):
        run_trials(plan, 1, journal=path, resume=True, progress=lambda *_: pytest.fail("ran"))


def test_a_run_that_was_killed_in_its_first_line_starts_anew(tmp_path):
    path = tmp_path / "journal"
    path.write_text('{"settings": {"se')
    with Journal(path, {"seed": 1}) as journal:
        assert journal.trials == {}
    assert path.read_text() == '{"settings": {"seed": 1}}\n'
