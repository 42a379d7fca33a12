"""`nonsac compare`."""

import json

import numpy as np
import pytest

import nonsac
from cli_samples import said
from nonsac import simulate
from nonsac.calls.comparison import Comparison
from nonsac.estimators.named import ESTIMATORS, Named

QUICK = ("--methods", "ransac", "--uses", "alone", "--repeats", "1", "--noise", "0.01")


def table(folder, name="pairs.csv", columns="x1,y1,z1,x2,y2,z2"):
    made = simulate.registration(1000, 0.4, 0.01, 2)
    np.savetxt(folder / name, np.hstack([made.source, made.target]), delimiter=",", header=columns, comments="")
    nonsac.io.write_transform(folder / "T.txt", made.T)
    return folder / name


def test_a_table_a_report_and_a_picture(run, folder):
    file = table(folder)
    told = ("--json", "a.json", "--picture", "a.svg")
    code, out, err = run("compare", file, "--truth", "T.txt", *told, *QUICK)
    assert code == 0
    assert not said(err)
    assert "register-pairs: 1,000 rows, 200 of them held out, judged at a noise of 0.01" in out
    assert "take ransac alone on samples of 800 rows: mAA 1.00, " in out
    assert "wrote a.json" in out
    found = Comparison.load(folder / "a.json")
    assert [row.method for row in found.rows] == ["ransac"]
    assert found.truth
    picture = (folder / "a.svg").read_text()
    assert "ransac" in picture
    assert "mAA (10 deg)" in picture


def test_json_on_stdout_is_alone_there(run, folder):
    code, out, _ = run("compare", table(folder), "--json", "-", *QUICK)
    assert code == 0
    held = json.loads(out)
    assert held["rows"][0]["outcome"] == "ok"
    assert held["rows"][held["best"]]["method"] == "ransac"
    assert not held["truth"]


def test_junk_exits_1(run, folder, rng):
    np.save(folder / "junk.npy", rng.random((1000, 6)))
    code, out, _ = run("compare", folder / "junk.npy", "--problem", "register-pairs", *QUICK)
    assert code == 1
    assert out.endswith("take none: no method gave an answer to be trusted on these data\n")


def test_simulated_data_have_a_truth(run, folder):
    code, out, _ = run("compare", "--problem", "register-pairs", "--simulate", "1000,0.4,0.01", *QUICK)
    assert code == 0
    assert "mAA 1.00" in out


def test_all_methods_are_listed(run, monkeypatch):
    monkeypatch.setitem(ESTIMATORS, "elsewhere", Named("x:y", "of others", ("RelativePose",), "no_such_module", "more"))
    code, out, _ = run("compare", "--list")
    lines = {line.split()[0]: line for line in out.splitlines()}
    assert code == 0
    assert set(lines) == set(ESTIMATORS)
    assert "installed" in lines["ransac"]
    assert 'not installed: pip install "nonsac[more]"' in lines["elsewhere"]
    code, out, _ = run("compare", "--list", "--problem", "register-pairs")
    assert "elsewhere" not in out
    assert "pcr99" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "name a file of matches, or give --simulate"),
        (("none.csv",), "none.csv"),
        (("pairs.csv", "--methods", "ransack"), "'ransack' is not one of ransac, "),
        (("pairs.csv", "--methods", "ransac,"), "a name is missing"),
        (("pairs.csv", "--sizes", "500,x"), "'x' is not a whole number of at least 3"),
        (("pairs.csv", "--noise", "0.5,-1"), "'-1' is not a positive number"),
        (("pairs.csv", "--uses", "both"), 'uses must hold "alone", "core" or both'),
        (("pairs.csv", "--max-memory", "much"), "max_memory must be a positive number of bytes"),
        (("pairs.csv", "--time-limit", "0"), "'0' is not a positive number"),
        (("pairs.csv", "--time-limit", "5,6"), "'5,6' is not a positive number"),
        (("pairs.csv", "--camera1", "1,1,0,0"), "register-pairs has no such option"),
        (("pairs.csv", "--truth", "pairs.csv"), "lines of four numbers"),
        (("pairs.csv", "--json", "pairs.csv"), "already used for DATA"),
        (("pairs.csv", "--picture", "a.gif"), ".png, .pdf or .svg"),
        (("pairs.csv", "--simulate", "100,0,1"), "the data are simulated"),
        (("--simulate", "100,0,1"), "say what is to be simulated"),
        (("--simulate", "100,0"), "is not three numbers"),
        (("--simulate", "100,2,1", "--problem", "register-pairs"), "outlier_ratio"),
        (("six.npy",), "fits absolute-pose and register-pairs by the number of its columns"),
    ],
)
def test_wrong_usage_is_refused(refused, folder, arguments, message):
    table(folder)
    np.save(folder / "six.npy", np.random.default_rng(0).random((100, 6)))
    assert message in refused("compare", *arguments)


@pytest.mark.slow
def test_the_problem_is_told_by_the_columns(run, folder):
    views = simulate.relative_pose(800, 0.3, 0.001, 0)
    np.savez(folder / "a.npz", points1=views.points1, points2=views.points2, T=views.T)
    out = run("compare", "a.npz", "--truth", "a.npz", "--methods", "ransac", "--repeats", "1")[1]
    assert "relative-pose: 800 rows" in out
    points = simulate.absolute_pose(800, 0.3, 0.001, 0)
    np.savez(folder / "b.npz", points2d=points.points2d, points3d=points.points3d)
    out = run("compare", "b.npz", "--methods", "ransac", "--repeats", "1", "--rules", "--samples", "3")[1]
    assert "absolute-pose: 800 rows" in out
    assert "most_inliers" in out
