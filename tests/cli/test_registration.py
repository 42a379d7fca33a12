"""Registration on the command line."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import nonsac
from cli_samples import said
from nonsac import io, simulate


@pytest.fixture(scope="module")
def elephant():
    return simulate.demo_scans(0, points=2000)


@pytest.fixture
def scans(folder, elephant):
    """Two scans that register: the names of their files, and the truth."""
    io.write_cloud("source.ply", elephant.source)
    io.write_cloud("target.npy", elephant.target)
    return "source.ply", "target.npy", elephant.T


@pytest.fixture
def matches(folder):
    """Half of these pairs are right; the file has six columns."""
    pairs = simulate.registration(400, 0.5, 0.01, 0)
    np.save("pairs.npy", np.hstack([pairs.source, pairs.target]))
    return pairs


@pytest.fixture
def noise_file(folder):
    """Pairs without any truth in them."""
    np.save("noise.npy", np.random.default_rng(1).random((300, 6)))
    return "noise.npy"


# --- results -----------------------------------------------------------


def test_clouds_with_all_outputs(scans, run):
    source, target, truth = scans
    outputs = ("--output", "T.txt", "--save-aligned", "aligned.ply", "--picture", "both.png")
    code, out, err = run("register-clouds", source, target, *outputs)
    assert (code, said(err)) == (0, [])
    T = io.read_transform("T.txt")
    assert nonsac.evaluation.rotation_error(T[:3, :3], truth[:3, :3]) < 1.0
    moved = io.read_cloud(source) @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_array_equal(io.read_cloud("aligned.ply"), moved)
    assert Path("both.png").read_bytes()[:4] == b"\x89PNG"
    assert out.startswith("Result(ok")
    assert "in the unit of the data" in out
    for name in ("T.txt", "aligned.ply", "both.png"):
        assert f"wrote {name}" in out


def test_json_is_all_of_stdout_and_the_same_as_the_library_says(scans, run, elephant):
    code, out, err = run("register-clouds", *scans[:2], "--json", "--output", "T.txt", "--seed", 3, "--workers", 1)
    assert (code, said(err)) == (0, [])
    result = nonsac.register_clouds(elephant.source, elephant.target, rng=3)
    T = json.loads(out)["T"]
    assert json.loads(out)["success"]
    np.testing.assert_array_equal(T, result.T)
    np.testing.assert_array_equal(T, io.read_transform("T.txt"))


@pytest.mark.parametrize(("noise", "remark"), [(0.05, "noise is smaller than given"), (0.001, "noise is larger")])
def test_a_wrong_noise_is_remarked_on_with_its_factor(matches, run, noise, remark):
    _, out, _ = run("register-pairs", "pairs.npy", "--noise", noise)
    [line] = [line for line in out.splitlines() if "remark: noise" in line]
    assert line.startswith(f"  remark: {remark}")
    assert float(line.split("by a factor of ")[1]) > 3.0


def test_samples_and_sample_size_are_passed_on(scans, run):
    _, out, _ = run("register-clouds", *scans[:2], "--json", "--samples", 2, "--sample-size", 1500)
    assert len(json.loads(out)["hypotheses"]) == 2
    assert json.loads(out)["info"]["sample_size"] == 1500


def test_pairs_in_one_file_or_two(matches, run):
    code, out, _ = run("register-pairs", "pairs.npy", "--noise", 0.01, "--json")
    assert code == 0
    one = json.loads(out)
    np.testing.assert_allclose(one["T"], matches.T, atol=0.02)
    io.write_cloud("a.ply", matches.source)
    io.write_cloud("b.ply", matches.target)
    code, out, _ = run("register-pairs", "a.ply", "b.ply", "--noise", 0.01, "--json")
    assert code == 0
    assert json.loads(out)["T"] == one["T"]


@pytest.mark.parametrize(("scale", "found"), [("free", 2.0), ("2", 2.0)])
def test_scale(folder, run, scale, found):
    pairs = simulate.registration(400, 0.3, 0.01, 0, scale=2.0)
    np.savez("pairs.npz", source=pairs.source, target=pairs.target)
    code, out, _ = run("register-pairs", "pairs.npz", "--noise", 0.01, "--scale", scale, "--json")
    assert code == 0
    assert json.loads(out)["scale"] == pytest.approx(found, rel=0.01)


def test_save_inliers_of_pairs(matches, run):
    code, _, _ = run("register-pairs", "pairs.npy", "--noise", 0.01, "--save-inliers", "mask.npy")
    assert code == 0
    mask = np.load("mask.npy")
    np.testing.assert_array_equal(mask, nonsac.register_pairs(matches.source, matches.target, noise=0.01).inliers)
    assert (mask == matches.inliers).mean() > 0.98


def test_dropped_rows_are_one_line_on_stderr(matches, run):
    rows = np.load("pairs.npy")
    rows[3, 1] = np.nan
    np.save("pairs.npy", rows)
    code, _, err = run("register-pairs", "pairs.npy", "--noise", 0.01, "--save-inliers", "mask.txt")
    assert code == 0
    mask = np.loadtxt("mask.txt")
    assert len(mask) == 400
    assert not mask[3]
    assert said(err) == ["nonsac: warning: dropped 1 sampled rows with NaN or infinite coordinates"]


def test_a_guess_is_written_and_called_untrusted(noise_file, run):
    code, out, err = run(
        "register-pairs",
        noise_file,
        "--noise",
        0.01,
        "--output",
        "T.txt",
        "--picture",
        "p.svg",
        "--json",
        "--picture-hypotheses",
        "h.svg",
    )
    assert code == 1
    assert json.loads(out)["status"] == "low_support"
    lines = said(err)
    assert lines[0].startswith("nonsac: NOT TRUSTED (low_support): ")
    assert lines[1:] == ["nonsac: T.txt holds T, and T is a guess that is NOT TRUSTED"]
    assert io.read_transform("T.txt").shape == (4, 4)
    for picture in ("p.svg", "h.svg"):
        assert "NOT TRUSTED: low support" in Path(picture).read_text()


def test_without_an_answer_no_transform_is_written(scans, run):
    Path("two.xyz").write_text("0 0 0\n1 1 1\n")
    outputs = ("--output", "T.txt", "--save-aligned", "a.ply", "--picture", "p.png")
    code, out, err = run("register-clouds", "two.xyz", scans[1], *outputs, "--json")
    assert code == 1
    assert json.loads(out)["status"] == "too_few"
    assert err.count("NOT WRITTEN: no answer was found") == 2
    assert sorted(os.listdir()) == ["p.png", "source.ply", "target.npy", "two.xyz"]


def test_nothing_to_draw(scans, run):
    Path("nan.xyz").write_text("nan nan nan\n" * 5)
    code, _, err = run("register-clouds", "nan.xyz", scans[1], "--picture", "p.png")
    assert code == 1
    assert "p.png is NOT WRITTEN" in err
    assert not os.path.exists("p.png")


@pytest.mark.slow
def test_demo(folder, run):
    code, out, _ = run("demo", "--picture", "elephant.png", "--save-scans", "scans", "--json", "--seed", 1)
    assert code == 0
    report = json.loads(out)
    assert report["error"]["rotation_deg"] < 0.5
    assert report["error"]["translation"] < 0.01
    np.testing.assert_array_equal(io.read_transform("scans/T.txt"), report["truth"]["T"])
    assert len(io.read_cloud("scans/source.ply")) == len(io.read_cloud("scans/target.ply"))
    assert os.path.getsize("elephant.png") > 10_000


def test_demo_for_people_and_when_it_fails(folder, run, monkeypatch):
    _, out, _ = run("demo")
    assert "off the truth by 0.0" in out
    assert os.listdir() == ["demo.png"]
    two_points = simulate.CloudPair(np.eye(3)[:2], np.eye(3)[:2], np.eye(4), 1.0)
    monkeypatch.setattr(simulate, "demo_scans", lambda seed: two_points)
    code, out, _ = run("demo")
    assert code == 1
    assert "Result(too_few" in out


# --- refusals ----------------------------------------------------------


def test_input_files_that_cannot_be_used(scans, refused):
    source, target, _ = scans
    content = Path(source).read_bytes()
    Path("cut.ply").write_bytes(content[: len(content) // 2])
    Path("cloud.foo").write_bytes(content)
    np.save("columns.npy", np.ones((3, 50)))
    assert "none.ply: no such file" in refused("register-clouds", "none.ply", target)
    assert "cut.ply: the file is truncated" in refused("register-clouds", source, "cut.ply")
    assert "cloud.foo: unknown suffix" in refused("register-clouds", "cloud.foo", target)
    assert "columns.npy: holds an array of shape (3, 50)" in refused("register-clouds", source, "columns.npy")


def test_pairs_of_unequal_length(scans, refused):
    Path("short.xyz").write_text("0 0 0\n1 1 1\n")
    message = refused("register-pairs", "source.ply", "short.xyz", "--noise", 1)
    assert "source.ply: holds 2000 points and short.xyz holds 2" in message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--save-aligned", "a.foo"], "'--save-aligned': a.foo: unknown suffix '.foo'"),
        (["--save-aligned", "none/a.ply"], "'--save-aligned': none/a.ply: the folder"),
        (["--output", "none/T.txt"], "'--output': none/T.txt: the folder"),
        (["--output", "T.ply"], "'--output': T.ply: T is written as text"),
        (["--output", "."], "'--output': .: is a folder"),
        (["--picture", "p.jpg"], "'--picture': path is 'p.jpg'; expected a picture"),
        (["--output", "T.txt", "--save-aligned", "./T.txt"], "T.txt is already used for --output"),
        (["--save-aligned", "source.ply"], "source.ply is already used for SOURCE"),
        (["--sede", "1"], "No such option"),
        (["--samples", "0"], "'--samples': '0' is not a whole number of at least 1"),
        (["--samples", "auto"], "'--samples': 'auto' is not a whole number of at least 1"),
        (["--sample-size", "2"], "'--sample-size': '2' is not a whole number of at least 3"),
        (["--seed", "-1"], "'--seed': '-1' is not a whole number of at least 0"),
        (["--workers", "0"], "'--workers': '0' is neither a number of at least 1 nor an address (tcp://host:8786)"),
        (["--estimator", "ransac"], "No such option: --estimator"),
        (["--rule", "tlp_0.1"], "No such option: --rule"),
    ],
)
def test_options_are_refused_before_any_work(scans, refused, monkeypatch, options, message):
    monkeypatch.setattr("nonsac.calls.clouds.register_clouds", None)
    assert message in refused("register-clouds", *scans[:2], *options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--noise", "-1"], "'--noise': '-1' is not a positive number"),
        (["--noise", "nan"], "'--noise': 'nan' is not a positive number"),
        (["--noise", "much"], "'--noise': 'much' is not a positive number"),
        (["--noise", "1", "--scale", "0"], "'--scale': '0' is neither a positive number nor 'free'"),
        (["--noise", "1", "--scale", "fre"], "'--scale': 'fre' is neither a positive number nor 'free'"),
    ],
)
def test_options_of_pairs(matches, refused, options, message):
    assert message in refused("register-pairs", "pairs.npy", *options)


def test_a_write_that_fails_after_the_work_leaves_the_result_on_stdout(matches, run, monkeypatch):
    def full_disk(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    code, out, err = run("register-pairs", "pairs.npy", "--noise", 0.01, "--json", "--output", "T.txt")
    assert code == 2
    assert json.loads(out)["success"]
    assert said(err) == [
        "nonsac: T.txt: cannot be written (No space left on device); check the folder and its free space"
    ]
    assert os.listdir() == ["pairs.npy"]


def test_interrupted(scans, run, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("nonsac.calls.clouds.register_clouds", interrupted)
    assert run("register-clouds", *scans[:2], "--output", "T.txt") == (130, "", "nonsac: interrupted\n")
    assert not os.path.exists("T.txt")
