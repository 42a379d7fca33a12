"""Table 3 on a small cloud, with as few trials as show that it works."""

import json
import os
from io import StringIO

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nonsac import cli, io, simulate
from nonsac.method.scoring import paper_rules
from nonsac.reproduce import table3
from nonsac.result import Hypothesis, Result, Status


@pytest.fixture(scope="module")
def cloud():
    scans = simulate.demo_scans(0, points=1500)
    return np.concatenate([scans.source @ scans.T[:3, :3].T + scans.T[:3, 3], scans.target])


@pytest.fixture(scope="module")
def files(cloud, tmp_path_factory):
    """What `nonsac reproduce table3` writes."""
    folder = tmp_path_factory.mktemp("table3")
    io.write_cloud(folder / "elephant.ply", cloud)
    options = ["--trials", "2", "--workers", "1", "--quiet"]
    outputs = ["--json", str(folder / "report.json"), "--picture", str(folder / "fig2.png")]
    code = cli.main(["reproduce", "table3", "--cloud", str(folder / "elephant.ply"), *options, *outputs])
    assert code == 0
    return folder


@pytest.fixture(scope="module")
def report(files):
    return json.loads((files / "report.json").read_text())


def test_rows_are_those_of_the_paper_in_its_order(report):
    names = ["ideal", *(rule.name for rule in paper_rules()), "refined"]
    assert list(report["rows"]) == list(report["errors"]) == list(report["median_rotation_deg"]) == names
    assert list(table3.PAPER) == list(report["reweighted"]["rows"]) == names[:-1]


def test_the_published_fit_comes_first_and_reweighted_ones_are_of_the_same_samples(report):
    assert report["settings"]["estimator"]["refit"] == "once"
    assert report["settings"]["reweighted"]["refit"] == "weighted"
    published, reweighted = (part["errors"] for part in (report, report["reweighted"]))
    assert set(published["ideal"]).isdisjoint(reweighted["ideal"])
    assert np.median(reweighted["ideal"]) < 20.0


def test_numbers_follow_from_the_errors(report):
    for rule, errors in report["errors"].items():
        assert len(errors) == 2
        expected = [np.mean([np.mean(np.array(errors) < k) for k in range(1, t + 1)]) for t in (5, 10, 15, 20)]
        assert report["rows"][rule] == pytest.approx(expected)
        assert report["median_rotation_deg"][rule] == pytest.approx(np.median(errors))
        assert all(errors[t] >= report["errors"]["ideal"][t] for t in range(2) if rule != "refined")
    assert set(report["times"]) == {"hypotheses", "refined"}
    for stage, seconds in report["times"].items():
        assert len(seconds) == 2
        assert report["seconds_per_trial"][stage] == pytest.approx(np.median(seconds))


def test_settings_say_how_it_was_run_and_nothing_of_the_folders(report, files):
    settings = report["settings"]
    assert settings["cloud"] == "elephant.ply"
    assert (settings["trials"], settings["seed"], settings["samples"], settings["sample_size"]) == (2, 0, 10, 10_000)
    assert (settings["points"], settings["overlap"], settings["noise"]) == (500, 0.5, 0.01)
    assert str(files) not in json.dumps(report)


def test_our_pipeline_finds_the_motion_and_claims_are_counted(report):
    assert max(report["errors"]["refined"]) < 5
    assert 0 <= report["claimed"]["wrong"] <= report["claimed"]["success"] <= 2


def test_workers_change_the_times_only(report, cloud):
    seen = []
    again = table3.run(cloud, trials=2, workers=2, progress=lambda *done: seen.append(done))
    for key in ("rows", "errors", "median_rotation_deg", "claimed", "reweighted"):
        assert again[key] == report[key]
    assert seen == [(1, 2), (2, 2)]


def test_the_name_that_it_had_before_still_works(capsys):
    assert cli.main(["reproduce", "table4", "--help"]) == 0
    assert "--cloud" in capsys.readouterr().out


def test_picture_and_no_leftovers(files):
    assert (files / "fig2.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(os.listdir(files)) == ["elephant.ply", "fig2.png", "report.json"]


def test_the_table_fits_a_terminal_of_80_columns(report):
    from rich.console import Console

    console = Console(width=80, record=True, file=StringIO())
    console.print(*table3.tables(report))
    text = console.export_text()
    for rule in report["rows"]:
        assert f" {rule} " in text
    assert "paper (MATLAB, i7-7700HQ): about 30 s" in text
    assert "0.75" in text


def test_each_rule_selects_its_own_hypothesis():
    angles, inliers = [10.0, 0.0, 20.0, 21.0], [30, 5, 10, 8]
    hypotheses = []
    for angle, count in zip(angles, inliers, strict=True):
        model = np.eye(3, 4)
        model[:, :3] = Rotation.from_euler("z", angle, degrees=True).as_matrix()
        hypotheses.append(Hypothesis(model, np.where(np.arange(50) < count, 0.1, 9.0), threshold=1.0))
    result = Result(np.eye(3, 4), Status.OK, 1.0, 1, 1, 1.0, 1.0, hypotheses=tuple(hypotheses))
    pair = simulate.CloudPair(np.eye(3), np.eye(3), np.eye(4), 1.0)
    errors = table3._errors_of_rules(result, pair)
    assert errors["ideal"] == 0
    assert errors["most_inliers"] == pytest.approx(10)
    assert errors["tlp_0.1"] == pytest.approx(10)
    assert errors["closest_pair"] == pytest.approx(20)


def test_failed_trials_are_none_in_the_file_and_180_degrees_in_the_median():
    failed = table3.Trial({"ideal": float("nan"), "refined": 1.0}, {"ideal": 1.0}, {"hypotheses": 1.0}, False)
    wrong = table3.Trial({"ideal": 2.0, "refined": 90.0}, {"ideal": 3.0}, {"hypotheses": 1.0}, True)
    report = table3._report([failed, wrong, wrong], {})
    assert report["errors"]["ideal"] == [None, 2.0, 2.0]
    assert report["median_rotation_deg"]["ideal"] == 2.0
    assert report["claimed"] == {"success": 2, "wrong": 2}
    json.dumps(report, allow_nan=False)


def test_json_to_stdout_and_refusals(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(table3, "run", lambda *_: {"rows": {}})
    io.write_cloud("small.ply", np.random.default_rng(0).random((100, 3)))
    assert cli.main(["reproduce", "table3", "--cloud", "small.ply", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out) == {"rows": {}}
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    for arguments, message in (
        (["--cloud", "small.ply"], "cloud has 100 points; expected at least 750"),
        ([], "Missing option '--cloud'"),
        (["--cloud", "none.ply"], "none.ply: no such file"),
        (["--cloud", "small.ply", "--trials", "0"], "'--trials'"),
        (["--cloud", "small.ply", "--json", "no/x.json"], "'--json': no/x.json: the folder"),
        (["--cloud", "small.ply", "--picture", "x.bmp"], "'--picture'"),
    ):
        assert cli.main(["reproduce", "table3", *arguments]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.count("\n") == 1
        assert message in captured.err
    assert os.listdir() == ["small.ply"]


def test_trials_below_one(cloud):
    with pytest.raises(ValueError, match="trials must be at least 1"):
        table3.run(cloud, trials=0)
