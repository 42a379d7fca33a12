"""Table 2 with as few trials as show that it works."""

import json
import os
import signal
import subprocess
import sys
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from nonsac import cli
from nonsac.reproduce import summaries, table2
from nonsac.reproduce.cells import RULES, Trial
from nonsac.reproduce.experiments import EXPERIMENTS
from waiting import wait_until

SHORT = ["--problem", "registration", "--trials", "2", "--samples", "2", "3", "--quiet"]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """What `nonsac reproduce table2` writes."""
    folder = tmp_path_factory.mktemp("table2")
    outputs = ["--json", str(folder / "report.json"), "--picture", str(folder / "table2.png")]
    assert cli.main(["reproduce", "table2", *SHORT, "--workers", "1", *outputs]) == 0
    return folder


@pytest.fixture(scope="module")
def report(files):
    return json.loads((files / "report.json").read_text())


def test_the_paper_is_quoted_in_full():
    assert set(table2.PAPER) == set(EXPERIMENTS)
    for columns in table2.PAPER.values():
        assert list(columns) == [10, 20, 30]
        for column in columns.values():
            assert tuple(column) == RULES[:-1]
    # Spot checks across the table, and its column sums.
    assert table2.PAPER["relative-pose"][10]["ideal"] == 0.91
    assert table2.PAPER["absolute-pose"][20]["tlp_0.01"] == 0.64
    assert table2.PAPER["registration"][30]["tlp_2"] == 0.91
    assert table2.PAPER["registration"][10]["minimum_q3"] == 0.12
    sums = [round(sum(column.values()), 2) for columns in table2.PAPER.values() for column in columns.values()]
    assert sums == SUMS


SUMS = [17.08, 17.74, 18.17, 16.02, 17.38, 17.75, 14.26, 15.59, 16.25]


def test_every_cell_rule_and_m_is_there(report):
    grid = EXPERIMENTS["registration"]
    expected = [(noise, ratio) for noise in grid.noises for ratio in grid.outlier_ratios]
    assert [(cell["noise"], cell["outlier_ratio"]) for cell in report["cells"]] == expected
    for columns in (report["registration"], *(cell["accuracy"] for cell in report["cells"])):
        assert list(columns) == ["2", "3"]
        assert all(tuple(column) == RULES for column in columns.values())
    assert "relative-pose" not in report


def test_averages_follow_from_the_cells(report):
    for m, averages in report["registration"].items():
        for rule, average in averages.items():
            assert average == pytest.approx(np.mean([cell["accuracy"][m][rule] for cell in report["cells"]]))
        assert averages["ideal"] >= max(averages[rule] for rule in RULES if rule not in ("fixed", "refined"))
    for m, judged in report["claims"]["registration"].items():
        assert sum(judged.values()) == 36
        errors = report["percentiles"]["registration"][m]
        assert all(errors[rule] == sorted(errors[rule]) and len(errors[rule]) == 5 for rule in RULES)


@pytest.mark.slow
def test_processes_change_the_seconds_only(files, report, tmp_path):
    outputs = ["--json", str(tmp_path / "report.json")]
    assert cli.main(["reproduce", "table2", *SHORT, "--workers", "2", *outputs]) == 0
    assert without_seconds(tmp_path / "report.json") == without_seconds(files / "report.json")
    assert sorted(os.listdir(files)) == ["report.json", "table2.png"]


def without_seconds(path):
    report = json.loads(path.read_text())
    del report["seconds"]
    return json.dumps(report)


@pytest.mark.slow
def test_killed_and_resumed(files, tmp_path):
    path, journal = tmp_path / "report.json", tmp_path / "report.json.partial"
    command = [sys.executable, "-m", "nonsac", "reproduce", "table2", *SHORT, "--workers", "2", "--json", str(path)]
    process = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL)
    wait_until(lambda: journal.exists() and journal.read_text().count("\n") > 5, process)
    process.send_signal(signal.SIGKILL)
    process.wait()
    wait_until(lambda: not group_lives(process.pid))  # its workers do not outlive it
    assert 5 < journal.read_text().count("\n") < 37
    assert not path.exists()
    assert cli.main(["reproduce", "table2", *SHORT, "--json", str(path)]) == 2
    assert cli.main(["reproduce", "table2", *SHORT, "--json", str(path), "--resume"]) == 0
    assert without_seconds(path) == without_seconds(files / "report.json")
    assert os.listdir(tmp_path) == ["report.json"]


def test_a_worker_that_is_killed_costs_time_only(tmp_path, files):
    path = tmp_path / "report.json"
    command = [sys.executable, "-m", "nonsac", "reproduce", "table2", *SHORT, "--workers", "2", "--json", str(path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: len(pool_of(process.pid)) == 2, process)
    os.kill(pool_of(process.pid)[0], signal.SIGKILL)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0
    assert err.startswith("nonsac: warning: the workers are lost")
    assert without_seconds(path) == without_seconds(files / "report.json")


def pool_of(parent):
    """The processes of its pool."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


def group_lives(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("problem", ["relative-pose", "absolute-pose"])
def test_the_other_problems(problem):
    report = table2.run([problem], samples=[3], trials=1, workers=1)
    assert report[problem]["3"]["refined"] > 0.9
    assert len(report["cells"]) == 18


def test_the_table_fits_a_terminal_of_80_columns(report):
    from rich.console import Console

    columns = dict.fromkeys(("10", "20", "30"), report["registration"]["3"])
    wide = report | {"registration": columns}
    for key in ("seconds", "claims"):
        wide[key] = {"registration": dict.fromkeys(columns, report[key]["registration"]["3"])}
    console = Console(width=80, record=True, file=StringIO())
    console.print(table2.table(wide, "registration"))
    text = console.export_text()
    for rule in RULES:
        assert f" {rule} " in text
    assert "0.95" in text
    assert "18 cells of 2 trials" in text
    assert "doubted" in text


def test_sums():
    errors = {"ideal": [0.5, 3.5, 9.5, float("nan")], "refined": [0.1, 20.0, 9.9, 30.0]}
    others = [rule for rule in RULES if rule not in errors]
    trials = [
        Trial(
            {4: {rule: values[i] for rule, values in errors.items()} | dict.fromkeys(others, 1.0)},
            {4: {"fixed": float(i)}},
            {4: i < 2},
        )
        for i in range(4)
    ]
    assert summaries.accuracies(trials, 4)["ideal"] == pytest.approx((10 + 7 + 1) / 40)
    assert summaries.accuracies(trials, 4)["fixed"] == pytest.approx(0.9)  # 1 is not below 1
    halves = [trials[:2], trials[2:]]
    assert summaries.mean_accuracies(halves, 4)["ideal"] == pytest.approx((17 / 20 + 1 / 20) / 2)
    assert summaries.percentiles(halves, 4)["ideal"][2] == pytest.approx(6.5)
    assert summaries.percentiles(halves, 4)["ideal"][4] > 100
    assert summaries.times(halves, 4) == {"fixed": 1.5}
    assert summaries.claims(halves, 4) == {
        "trusted_right": 1,
        "trusted_wrong": 1,
        "untrusted_right": 1,
        "untrusted_wrong": 1,
    }


def test_json_to_stdout_and_refusals(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    told = []
    monkeypatch.setattr(table2, "run", lambda *arguments: told.append(arguments) or {"rows": {}})
    assert cli.main(["reproduce", "table2", "--json", "-", "--samples", "5", "7", "9", "--trials", "3"]) == 0
    assert json.loads(capsys.readouterr().out) == {"rows": {}}
    names, counts, trials = told[0][:3]
    assert (list(names), list(counts), trials) == (list(EXPERIMENTS), [5, 7, 9], 3)
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    for arguments, message in (
        (["--problem", "pnp"], "'--problem'"),
        (["--samples", "0"], "'--samples'"),
        (["--samples", "10", "1000000"], "'--samples': Input should be less than or equal to 1000"),
        (["20", "30"], "unexpected argument 20; numbers of samples follow --samples"),
        (["--trials", "0"], "'--trials'"),
        (["--workers", "0"], "'--workers'"),
        (["--resume"], "needs --json FILE"),
        (["--resume", "--json", "-"], "needs --json FILE"),
        (["--json", "no/x.json"], "'--json': no/x.json: the folder"),
        (["--picture", "x.bmp"], "'--picture'"),
    ):
        assert cli.main(["reproduce", "table2", *arguments]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.count("\n") == 1
        assert message in captured.err
    assert os.listdir() == []


def test_wrong_arguments():
    for arguments, message in (
        ({"problems": ["pnp"]}, "problems must be some of"),
        ({"samples": []}, "samples must be numbers of at least 1"),
        ({"samples": [0, 5]}, "samples must be numbers of at least 1"),
        ({"trials": 0}, "trials must be at least 1"),
        ({"workers": 0}, "workers must be"),
    ):
        with pytest.raises(ValueError, match=message):
            table2.run(**arguments)
