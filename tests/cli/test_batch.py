"""nonsac batch: what it reads, what it writes, and runs that are killed."""

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import nonsac
from cli_samples import FIRST, SECOND, matrix, said, scene, subprocess_nonsac, two_views, write_hloc, write_table
from nonsac import simulate
from nonsac.cli.batch import _write_parquet
from nonsac.cli.batch_run import Item, Summarise
from nonsac.running import journal
from plane import Plane
from waiting import wait_until


def write_pairs(name, rng, outliers=0.5):
    pairs = simulate.registration(120, outliers, 0.01, rng)
    np.save(name, np.hstack([pairs.source, pairs.target]))
    return pairs


def write_manifest(rows, name="pairs.csv"):
    columns = list(dict.fromkeys(column for row in rows for column in row))
    lines = [",".join(columns)] + [",".join(str(row.get(column, "")) for column in columns) for row in rows]
    Path(name).write_text("\n".join(lines) + "\n")
    return name


def results(name="out.jsonl"):
    return [json.loads(line) for line in Path(name).read_text().splitlines()]


@pytest.fixture
def four(folder):
    """A right pair, pure outliers, a file that is missing, and a right one again."""
    for number, outliers in ((0, 0.5), (1, 1.0), (3, 0.5)):
        write_pairs(f"{number}.npy", number, outliers)
    rows = [{"name": f"pair {k}", "call": "register-pairs", "pairs": f"{k}.npy", "noise": 0.01} for k in range(4)]
    return write_manifest(rows)


def test_one_line_for_each_pair_in_order(run, four):
    code, out, err = run("batch", four, "--output", "out.jsonl", "--workers", "1")
    assert (code, out) == (1, "")
    assert said(err)[-1] == ("nonsac: 4 pairs: 2 trusted, 1 not trusted (1 low_support), 1 failed; wrote out.jsonl")
    lines = results()
    assert [line["name"] for line in lines] == ["pair 0", "pair 1", "pair 2", "pair 3"]
    assert [line["status"] for line in lines] == ["ok", "low_support", None, "ok"]
    assert [line["success"] for line in lines] == [True, False, False, True]
    assert lines[2]["error"] == "2.npy: no such file; check the path"
    assert lines[2]["T"] is None
    rows = np.load("0.npy")
    result = nonsac.register_pairs(rows[:, :3], rows[:, 3:], noise=0.01)
    assert lines[0]["T"] == result.T.tolist()
    assert (lines[0]["num_inliers"], lines[0]["num_rows"]) == (result.num_inliers, 120)
    assert (lines[0]["confidence"], lines[0]["error"]) == (result.confidence, None)
    assert not Path("out.jsonl.partial").exists()


def test_all_trusted_is_exit_0_and_quiet_says_nothing(run, folder):
    write_pairs("0.npy", 0)
    Path("pairs.jsonl").write_text(
        '{"pairs": "0.npy", "noise": 0.01, "samples": 2}\n\n{"pairs": "0.npy", "scale": "free"}\n'
    )
    arguments = ("batch", "pairs.jsonl", "--call", "register-pairs", "--output", "out.jsonl", "--workers", "1")
    code, out, err = run(*arguments, "--quiet")
    assert (code, out, said(err)) == (0, "", [])
    assert [line["name"] for line in results()] == ["1", "2"]
    code, out, err = run(*arguments, "--overwrite")
    assert said(err) == ["nonsac: 2 pairs: 2 trusted, 0 not trusted, 0 failed; wrote out.jsonl"]


def test_parquet_holds_the_same(run, four):
    parquet = pytest.importorskip("pyarrow.parquet")
    run("batch", four, "--output", "out.jsonl", "--workers", "1")
    run("batch", four, "--output", "out.parquet", "--workers", "1")
    table = parquet.read_table("out.parquet").to_pylist()
    for row, line in zip(table, results(), strict=True):
        flat = line["T"] and np.ravel(line["T"]).tolist()
        assert row == line | {"T": flat}


def test_models_that_are_no_motions_are_written_as_they_are(tmp_path, rng):
    parquet = pytest.importorskip("pyarrow.parquet")

    class Flat(nonsac.Job):
        """A plane, as a call would find it that gives no T."""

        def run(self, time_limit=None):
            rows = rng.uniform(-1, 1, (400, 3))
            rows[:200, 2] = 0.5
            return nonsac.estimate(nonsac.ArraySource(rows), Plane(), noise=0.01)

    record = Summarise(None)(Item(Flat("register_pairs", np.zeros((9, 3)), np.zeros((9, 3)), name="a")))
    assert record["success"]
    assert record["T"] is None
    np.testing.assert_allclose(np.abs(record["model"]), [0, 0, 1, 0.5], atol=1e-12)
    _write_parquet(tmp_path / "out.parquet", iter([record]))
    assert parquet.read_table(tmp_path / "out.parquet").to_pylist() == [record]


def test_every_call_with_files_beside_the_manifest(run, folder):
    views, points = two_views(), scene()
    scans = simulate.demo_scans(0, points=1500)
    sub = folder / "sub"
    sub.mkdir()
    os.chdir(sub)
    write_table("m.csv", views.rows, "x1 y1 x2 y2")
    write_table("p.csv", points.rows, "u v X Y Z")
    hloc = write_hloc(views)
    np.save("a.npy", scans.source)
    np.save("b.npy", scans.target)
    Path("K.txt").write_text(matrix(FIRST))
    second = str(SECOND)
    write_manifest(
        [
            {"call": "relative-pose", "matches": "m.csv", "camera1": "K.txt", "camera2": second, "noise": 0.5},
            {
                "call": "relative_pose",
                "matches": hloc[0],
                "second": hloc[1],
                "image1": "db/one.jpg",
                "image2": "two.jpg",
            }
            | {"camera1": "K.txt", "camera2": second, "noise": 0.5, "seed": 3},
            {"call": "absolute-pose", "points": "p.csv", "camera": "K.txt", "noise": 0.5, "sample_size": 200},
            {"call": "register-clouds", "source": "a.npy", "target": "b.npy", "samples": 2},
        ]
    )
    os.chdir(folder)
    code, _, err = run("batch", "sub/pairs.csv", "--output", "out.jsonl", "--workers", "1", "--time-limit", "600")
    assert "register-clouds takes no time limit" in err
    assert code == 0, results()
    table, from_hloc, pnp, _ = results()
    K = nonsac.Camera("PINHOLE", FIRST.params)
    weights = views.weights
    assert table["T"] == views.solved(K, SECOND, noise=0.5).T.tolist()
    alone = views.in_single_precision().solved(K, SECOND, noise=0.5, rng=3, weights=weights)
    np.testing.assert_allclose(from_hloc["T"], alone.T, atol=1e-3)
    assert pnp["T"] == points.solved(K, noise=0.5, sample_size=200).T.tolist()


def test_estimators_and_rules_are_columns(run, folder):
    pairs = write_pairs("0.npy", 0)
    chosen = [
        {"estimator": "ransac"},
        {"estimator": "pcr99", "scale": "free"},
        {"rule": "most_inliers", "refine": "none", "samples": "5", "sample-size": "40"},
        {"estimator": "ransac", "rule": "tlp_0.5", "refine": "none", "samples": "5", "sample-size": "40"},
        {},
    ]
    manifest = write_manifest([{"call": "register-pairs", "pairs": "0.npy", "noise": "0.01"} | row for row in chosen])
    run("batch", manifest, "--output", "out.jsonl", "--workers", "1")
    few = {"noise": 0.01, "refine": "none", "samples": 5, "sample_size": 40}
    expected = [
        nonsac.register_pairs(pairs.source, pairs.target, **settings)
        for settings in (
            {"noise": 0.01, "estimator": "ransac"},
            {"noise": 0.01, "estimator": "pcr99", "scale": None},
            few | {"rule": "most_inliers"},
            few | {"estimator": "ransac", "rule": "tlp_0.5"},
            {"noise": 0.01},
        )
    ]
    assert [line["T"] for line in results()] == [result.T.tolist() for result in expected]
    assert [line["status"] for line in results()] == [result.status for result in expected]


def test_an_estimator_of_another_library_is_an_option_and_a_column(run, folder):
    pytest.importorskip("kiss_matcher", reason="needs the extra kiss-matcher")
    pairs = write_pairs("0.npy", 0)
    expected = nonsac.register_pairs(pairs.source, pairs.target, noise=0.01, estimator="kiss-matcher").T.tolist()
    settings = {"noise": "0.01", "estimator": "kiss-matcher"}
    manifest = write_manifest([{"call": "register-pairs", "pairs": "0.npy"} | settings])
    run("batch", manifest, "--output", "out.jsonl", "--workers", "1")
    assert [line["T"] for line in results()] == [expected]
    code, out, _ = run("register-pairs", "0.npy", "--noise", "0.01", "--estimator", "kiss-matcher", "--json")
    assert code == 0
    assert json.loads(out)["T"] == expected


def test_warnings_of_a_pair_are_in_its_line(run, folder):
    rows = write_table("m.npy", two_views().rows, "")
    code, _, err = run(
        "batch",
        write_manifest([{"matches": rows}]),
        "--call",
        "relative-pose",
        "--output",
        "out.jsonl",
        "--workers",
        "1",
    )
    assert code == 1
    assert "warning" not in err
    assert any("look like pixels" in remark for remark in results()[0]["remarks"])


def test_pairs_of_a_scene_share_the_noise_that_the_first_ones_measure(run, folder):
    for number in range(20):
        write_pairs(f"{number}.npy", number)
    rows = [{"call": "register-pairs", "pairs": f"{k}.npy", "scene": "hall"} for k in range(18)]
    rows += [{"call": "register-pairs", "pairs": "18.npy"}]
    rows += [{"call": "register-pairs", "pairs": "19.npy", "scene": "hall", "noise": "0.012"}]
    rows += [{"call": "register-pairs", "pairs": "0.npy", "scene": "too few pairs"}]
    manifest = write_manifest(rows)
    run("batch", manifest, "--output", "out.jsonl", "--workers", "1")
    noises = [line["noise"] for line in results()]
    shared = np.median(noises[:16])
    assert noises[16:18] == [shared, shared]
    assert shared == pytest.approx(0.01, rel=0.1)
    assert len({*noises[:16], shared}) > 10
    alone = np.load("18.npy")
    assert noises[18] == nonsac.register_pairs(alone[:, :3], alone[:, 3:]).noise
    assert noises[19:] == [0.012, noises[0]]
    run("batch", manifest, "--output", "two.jsonl", "--workers", "2")
    assert Path("two.jsonl").read_bytes() == Path("out.jsonl").read_bytes()


def test_a_stop_before_or_after_the_noise_is_known_changes_nothing(run, folder, monkeypatch):
    for number in range(3):
        write_pairs(f"{number}.npy", number)
    rows = [{"call": "register-pairs", "pairs": f"{k % 3}.npy", "scene": "hall"} for k in range(20)]
    manifest = write_manifest(rows)
    run("batch", manifest, "--output", "whole.jsonl", "--workers", "1")
    summarise = Summarise.__call__
    for stop in (4, 18):
        count = iter(range(stop))

        def stops(task, item, count=count):
            if next(count, None) is None:
                raise KeyboardInterrupt
            return summarise(task, item)

        with monkeypatch.context() as patch:
            patch.setattr(Summarise, "__call__", stops)
            assert run("batch", manifest, "--output", "out.jsonl", "--workers", "1")[0] == 130
        assert not Path("out.jsonl").exists()
        run("batch", manifest, "--output", "out.jsonl", "--workers", "1", "--resume")
        assert Path("out.jsonl").read_bytes() == Path("whole.jsonl").read_bytes()
        Path("out.jsonl").unlink()


REFUSED = {
    "call,source,target,scene\nregister-clouds,a.ply,b.ply,hall": "register-clouds is given no noise, so that there is",
    "call,pairs,noise,noise\nregister-pairs,a.npy,1,2": "pairs.csv, line 1: names the column 'noise' twice; keep one",
    "call,pairs,max-samples,max_samples\nregister-pairs,a.npy,1,2": "line 1: names the column 'max_samples' twice",
    "call,pairs,nois\nregister-pairs,a.npy,1": "pairs.csv, line 2: there is no column 'nois'; the columns are name,",
    "call,pairs\nregister-pairs,a.npy\nregister,b.npy": "line 3: the call 'register' is none of relative-pose,",
    "pairs\na.npy": "line 2: names no call: fill the column 'call', or give --call",
    "call,pairs,noise\nregister-pairs,,1": "line 2: register-pairs needs a file in the column 'pairs'",
    "call,source\nregister-clouds,a.npy": "line 2: register-clouds needs a file in the column 'target'",
    "call,pairs,image1\nregister-pairs,a.npy,x": "line 2: register-pairs has no 'image1'; it has pairs, second,",
    "call,pairs,noise\nregister-pairs,a.npy,-1": "line 2: noise: '-1' is not a positive number",
    "call,pairs,noise\nregister-pairs,a.npy,x": "line 2: noise: 'x' is not a positive number",
    "call,pairs,scale\nregister-pairs,a.npy,any": "line 2: scale: 'any' is neither",
    "call,pairs,samples\nregister-pairs,a.npy,0": "line 2: samples: '0' is neither",
    "call,pairs,seed\nregister-pairs,a.npy,-1": "line 2: seed: '-1' is not a whole number of at least 0",
    "call,pairs,refine\nregister-pairs,a.npy,best": "line 2: refine: 'best' is not one of union, polish, full, none",
    "call,pairs,estimator\nregister-pairs,a.npy,lmeds": "line 2: estimator: 'lmeds' is not one of ransac, pcr99",
    "call,matches,estimator\nrelative-pose,a.npy,pcr99": "line 2: estimator: 'pcr99' is not for relative-pose (",
    "call,pairs,rule\nregister-pairs,a.npy,best": "line 2: rule: must be one of most_inliers, closest_pair,",
    "call,source,target,rule\nregister-clouds,a.npy,b.npy,tlp_1": "line 2: register-clouds has no 'rule'; it has",
    "call,pairs,workers\nregister-pairs,a.npy,2": "line 2: there is no column 'workers'; the columns are name, call,",
    "call,pairs,rng\nregister-pairs,a.npy,2": "line 2: there is no column 'rng'; the columns are name, call,",
    "call,matches,camera1\nrelative-pose,a.npy,none.txt": "line 2: camera1: 'none.txt' is neither a file nor a camera",
    "call,pairs\nregister-pairs,a.npy,b.npy": "line 2: has more cells than the header has names",
    "call,pairs": "holds no pairs",
}


@pytest.mark.parametrize("text", REFUSED)
def test_a_wrong_manifest_is_refused_before_the_work(refused, folder, text):
    Path("pairs.csv").write_text(text + "\n")
    assert REFUSED[text] in refused("batch", "pairs.csv", "--output", "out.jsonl")


def test_other_misuse(refused, folder, four):
    assert "end the name in one of these" in refused("batch", four, "--output", "out.csv")
    assert "does not exist; create it first" in refused("batch", four, "--output", "no/out.jsonl")
    assert "none.csv" in refused("batch", "none.csv", "--output", "out.jsonl")
    for text in ("0", "-1", "inf", "soon"):
        message = refused("batch", four, "--output", "out.jsonl", "--time-limit", text)
        assert f"'--time-limit': '{text}' is not a positive number" in message
    assert "end the name in one of these" in refused("batch", "0.npy", "--output", "out.jsonl")
    Path("pairs.jsonl").write_text('{"pairs": "a.npy"}\n{"pairs"\n')
    out = ("--output", "out.jsonl")
    assert "line 2: is no JSON" in refused("batch", "pairs.jsonl", "--call", "register-pairs", *out)
    assert "is the manifest" in refused("batch", "pairs.jsonl", "--output", "./pairs.jsonl")
    Path("pairs.jsonl").write_text('{"pairs": ' + "[" * 100_000 + "\n")
    assert "line 1: is nested too deeply" in refused("batch", "pairs.jsonl", "--call", "register-pairs", *out)
    Path("pairs.jsonl").write_text('{"pairs": ["a.npy"]}\n')
    assert "line 1: write one object" in refused("batch", "pairs.jsonl", "--call", "register-pairs", *out)


def test_a_pair_that_fails_is_said_at_once(run, four):
    for quiet in ((), ("--quiet",)):
        _, _, err = run("batch", four, "--output", "out.jsonl", "--workers", "1", "--overwrite", *quiet)
        assert said(err)[0] == "nonsac: pair 2: failed: 2.npy: no such file; check the path"


def test_what_is_complete_is_not_replaced_unasked(run, refused, four):
    arguments = ("batch", four, "--output", "out.jsonl", "--workers", "1")
    assert run(*arguments)[0] == 1
    before = Path("out.jsonl").read_bytes()
    assert "'--output': out.jsonl is there already; --overwrite replaces it" in refused(*arguments)
    Path("out.jsonl").write_text("another")
    assert run(*arguments, "--overwrite")[0] == 1
    assert Path("out.jsonl").read_bytes() == before


def test_a_link_to_an_input_is_an_input(refused, four):
    os.link("1.npy", "data.jsonl")
    os.link(four, "manifest.jsonl")
    os.symlink("0.npy", "soft.jsonl")
    overwrite = ("--workers", "1", "--overwrite")
    for name, what in (
        ("data.jsonl", "is read for the pair 'pair 1'"),
        ("manifest.jsonl", "is the manifest"),
        ("soft.jsonl", "is read for the pair 'pair 0'"),
    ):
        assert f"{name} {what}" in refused("batch", four, "--output", name, *overwrite)


# --- runs that are stopped -----------------------------------------------------------------


@pytest.fixture
def many(folder):
    """200 pairs, of which some cannot be read and some are wrong."""
    for rng in range(20):
        write_pairs(f"{rng}.npy", rng, 0.97 if rng % 9 == 4 else 0.5)
    Path("text.npy").write_text("no array")
    names = ["none.npy" if k == 90 else "text.npy" if k == 110 else f"{k % 20}.npy" for k in range(200)]
    return write_manifest([{"pairs": name, "noise": 0.01, "seed": k} for k, name in enumerate(names)])


def command(manifest, output, *more):
    return ("batch", manifest, "--call", "register-pairs", "--output", output, *more)


def lines_in(path):
    return path.read_bytes().count(b"\n") if path.exists() else 0


@pytest.mark.skipif(os.name != "posix", reason="SIGKILL is of POSIX")
@pytest.mark.slow
def test_a_run_that_was_killed_goes_on_to_the_same_file(many, folder):
    whole = subprocess_nonsac(*command(many, "whole.jsonl", "--workers", "2"))
    assert whole.returncode == 1, whole.stderr
    partial = folder / "out.jsonl.partial"
    arguments = [sys.executable, "-m", "nonsac", *command(many, "out.jsonl", "--workers", "2")]
    with subprocess.Popen(arguments, stderr=subprocess.DEVNULL) as process:
        wait_until(lambda: lines_in(partial) >= 20, process)
        process.kill()
    assert process.returncode == -signal.SIGKILL
    assert 20 <= lines_in(partial) <= 200
    assert not Path("out.jsonl").exists()
    with partial.open("ab") as file:
        file.write(b'{"name": "pair')  # as if killed while it wrote

    refused = subprocess_nonsac(*command(many, "out.jsonl"))
    assert refused.returncode == 2
    assert "go on there with resume (--resume)" in refused.stderr
    resumed = subprocess_nonsac(*command(many, "out.jsonl", "--resume", "--workers", "1"))
    assert resumed.returncode == 1
    assert resumed.stderr.splitlines()[-1].replace("out.", "whole.") == whole.stderr.splitlines()[-1]
    assert Path("out.jsonl").read_bytes() == Path("whole.jsonl").read_bytes()
    assert not partial.exists()
    assert [line["name"] for line in results()] == [str(k) for k in range(1, 201)]
    assert [k for k, line in enumerate(results()) if line["error"]] == [90, 110]


def test_a_full_disk_is_told_and_the_run_goes_on_later(run, four, folder, monkeypatch):
    """Every write after the third takes one byte of the line, then the disk is full."""

    class Full:
        def __init__(self, file):
            self.file, self.writes = file, 0

        def write(self, data):
            self.writes += 1
            if self.writes > 4:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return self.file.write(data if self.writes < 4 else data[:1])

        def close(self):
            self.file.close()

    arguments = ("batch", four, "--output", "out.jsonl", "--workers", "1")
    with monkeypatch.context() as patch:
        opened = journal._opened
        patch.setattr(journal, "_opened", lambda *path: Full(opened(*path)))
        code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    failed, kept, full = said(err)
    assert failed == "nonsac: pair 2: failed: 2.npy: no such file; check the path"
    assert kept == "nonsac: 2 of 4 pairs are kept in out.jsonl.partial; --resume goes on there"
    problem = "cannot be written (No space left on device); make room, then go on with resume (--resume)"
    assert full == f"nonsac: out.jsonl.partial: {problem}"
    assert not Path("out.jsonl").exists()
    assert run(*arguments, "--resume")[0] == 1
    resumed = Path("out.jsonl").read_bytes()
    run("batch", four, "--output", "whole.jsonl", "--workers", "1")
    assert Path("whole.jsonl").read_bytes() == resumed


def test_a_disk_that_is_full_at_the_end_loses_nothing(run, four, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    arguments = ("batch", four, "--output", "out.jsonl", "--workers", "1")
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        code, _, err = run(*arguments)
    assert code == 2
    assert "out.jsonl: cannot be written (No space left on device)" in said(err)[-1]
    assert sorted(path.name for path in Path().iterdir() if "out" in path.name) == ["out.jsonl.partial"]
    monkeypatch.setattr("nonsac.calls.jobs.Job.run", lambda *_: pytest.fail("nothing is left to do"))
    assert run(*arguments, "--resume")[0] == 1
    assert len(results()) == 4


@pytest.fixture
def interrupted(run, four, monkeypatch):
    """A run that Ctrl-C ended after two pairs: what it said."""
    original = nonsac.Job.run

    def interrupt(job, *limit):
        if job.name == "pair 2":
            raise KeyboardInterrupt
        return original(job, *limit)

    with monkeypatch.context() as patch:
        patch.setattr("nonsac.calls.jobs.Job.run", interrupt)
        code, _, err = run("batch", four, "--output", "out.jsonl", "--workers", "1")
    assert code == 130
    return said(err)


def test_ctrl_c_keeps_what_is_done(interrupted):
    assert interrupted == [
        "nonsac: 2 of 4 pairs are kept in out.jsonl.partial; --resume goes on there",
        "nonsac: interrupted",
    ]
    assert lines_in(Path("out.jsonl.partial")) == 3


@pytest.mark.parametrize("number", [0, 1])
def test_a_flipped_digit_does_not_get_into_the_output(run, four, interrupted, number):
    """The damaged record is dropped, and its pair done again; the others are kept."""
    path = Path("out.jsonl.partial")
    lines = path.read_bytes().splitlines(keepends=True)
    place = lines[1 + number].index(b'"T": [[') + 10
    lines[1 + number] = (
        lines[1 + number][:place] + bytes([lines[1 + number][place] ^ 1]) + lines[1 + number][place + 1 :]
    )
    path.write_bytes(b"".join(lines))
    code, _, err = run("batch", four, "--output", "out.jsonl", "--workers", "1", "--resume")
    assert code == 1
    told = "nonsac: warning: 1 of the pairs in out.jsonl.partial are damaged; what is missing is done again"
    assert said(err)[0] == told
    run("batch", four, "--output", "whole.jsonl", "--workers", "1")
    assert Path("out.jsonl").read_bytes() == Path("whole.jsonl").read_bytes()


def test_what_is_left_of_another_run_is_refused(run, four, interrupted):
    arguments = ("batch", four, "--output", "out.jsonl", "--workers", "1", "--resume")
    kept = Path("out.jsonl.partial").read_bytes()
    text = Path(four).read_text()

    def told(*more):
        code, _, err = run(*arguments, *more)
        assert code == 2
        return err

    assert "is of a run with --time-limit None, not 5.0; resume with the settings of that run" in told(
        "--time-limit", "5"
    )
    assert "is of a run with --time-limit None, not 1234567.891; resume" in told("--time-limit", "1234567.891")
    Path(four).write_text(text.replace("0.01", "0.02"))
    assert "is of a run with manifest " in told()
    assert Path("out.jsonl.partial").read_bytes() == kept
    Path(four).write_text(text)
    assert run(*arguments)[0] == 1
    assert "out.jsonl is complete, and nothing is left to resume" in told()


def test_nothing_to_resume_is_said(run, four):
    code, _, err = run("batch", four, "--output", "out.jsonl", "--workers", "1", "--resume")
    assert code == 1
    assert said(err)[0] == "nonsac: nothing to resume at out.jsonl.partial: starting anew"


def test_memory_and_the_last_fit_are_columns(run, tmp_path, monkeypatch, rng):
    monkeypatch.chdir(tmp_path)
    pairs = nonsac.simulate.registration(150_000, 0.5, 0.01, rng)
    np.save("rows.npy", np.hstack([pairs.source, pairs.target]))
    lines = ["name,pairs,noise,refine,max_memory", "a,rows.npy,0.01,full,", "b,rows.npy,0.01,polish,16 MB"]
    (tmp_path / "pairs.csv").write_text("\n".join(lines))
    code, *_ = run("batch", "pairs.csv", "--call", "register-pairs", "--output", "out.jsonl", "--workers", "1")
    assert code == 0
    a, b = map(json.loads, (tmp_path / "out.jsonl").read_text().splitlines())
    assert a["num_rows"] == 150_000
    assert 4000 <= b["num_rows"] < 22_000
    for cell, message in (
        ("best,", "'best' is not one of union, polish, full, none"),
        (",lots", "'lots' is no number"),
    ):
        (tmp_path / "pairs.csv").write_text(f"{lines[0]}\na,rows.npy,0.01,{cell}")
        code, _, err = run("batch", "pairs.csv", "--call", "register-pairs", "--output", "new.jsonl")
        assert code == 2
        assert message in err
