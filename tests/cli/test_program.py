"""The program as a whole: help, version, compiling, progress, misuse."""

import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

import nonsac
from cli_samples import said, subprocess_nonsac
from nonsac.calls import poses
from nonsac.cli.session import compiling_noted, progress_bar


def test_warmup(run, monkeypatch):
    told = []
    for name in ("relative_pose", "absolute_pose"):
        call = getattr(poses, name)
        record = partial(
            lambda call, *points, **options: told.append(sorted(options)) or call(*points, **options), call
        )
        monkeypatch.setattr(poses, name, record)
    code, out, err = run("warmup")
    assert (code, said(err)) == (0, [])
    assert "compiled" in out
    assert told == [["noise"], ["noise", "refine", "weights"]] * 2


def test_help_and_version(run):
    assert run("--version") == (0, f"nonsac {nonsac.__version__}\n", "")
    for arguments in ((), ("--help",), ("reproduce",), ("register-pairs", "--help")):
        code, out, err = run(*arguments)
        assert (code, err) == (0, "")
        assert "Usage: nonsac" in out


SHARED = {"--samples", "--sample-size", "--seed", "--workers", "--output", "--picture", "--json", "--quiet", "--help"}
ROWS = SHARED | {"--noise", "--save-inliers", "--max-samples", "--time-limit", "--columns", "--dataset"}
ROWS |= {"--max-memory", "--estimator", "--rule", "--refine"}
OPTIONS = {
    "register-clouds": SHARED | {"--save-aligned"},
    "register-pairs": ROWS | {"--scale", "--save-aligned"},
    "relative-pose": ROWS
    | {"--image1", "--image2", "--camera1", "--camera2", "--photo1", "--photo2", "--write-geometry"},
    "absolute-pose": ROWS | {"--image", "--camera", "--photo"},
    "plan": {"--problem", "--columns", "--dataset", "--samples", "--sample-size", "--json", "--help"},
    "demo": {"--picture", "--seed", "--workers", "--save-scans", "--json", "--quiet", "--help"},
    "batch": {"--output", "--call", "--workers", "--time-limit", "--resume", "--quiet", "--help"},
    "simulate": {"--outlier-ratio", "--noise", "--output", "--seed", "--dtype", "--row-group", "--truth", "--quiet"}
    | {"--help"},
    "warmup": {"--help"},
}


@pytest.mark.parametrize("command", OPTIONS)
def test_help_lists_the_options(run, command):
    code, out, err = run(command, "--help")
    assert (code, err) == (0, "")
    listed = set(re.findall(r"^\W+(--[a-z0-9-]+)", out, re.MULTILINE))
    assert listed == OPTIONS[command]
    assert re.search(rf"^  {command} ", run("--help")[1].replace("│", " ").replace("| ", "  "), re.MULTILINE)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--help"], 0),
        (["relative-pose", "--help"], 0),
        (["batch", "--help"], 0),
        (["reproduce", "table2", "--help"], 0),
        (["register-pairs", "pairs.npy", "--sede", "1"], 2),
        (["register-pairs", "pairs.npy", "--noise", "much", "--estimator", "ransac"], 2),
        (["relative-pos"], 2),
    ],
)
def test_help_and_mistyped_options_import_nothing_heavy(arguments, code):
    program = f"import sys; from nonsac.cli import main; code = main({arguments}); print(); print(code, *sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    returned, *modules = done.stdout.splitlines()[-1].split()
    assert int(returned) == code
    assert (done.stdout.strip(" \n").startswith("Usage: nonsac"), done.stderr.count("\n")) == (code == 0, code // 2)
    loaded = {name.split(".")[0] for name in modules}
    assert "typer" in loaded
    assert not loaded & {"numba", "numpy", "scipy", "matplotlib", "h5py", "sqlite3", "pyarrow", "fsspec"}


def test_as_a_module_without_compiling(tmp_path):
    done = subprocess_nonsac("--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"nonsac {nonsac.__version__}\n", "")
    done = subprocess_nonsac("register-clouds", "none.ply", "none.ply", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "nonsac: none.ply: no such file; check the path\n"


def test_compiling_is_announced_once(capsys):
    numba = pytest.importorskip("numba")
    with compiling_noted(quiet=False):
        for number in (1, 1.0, 1j):
            numba.njit(lambda x: x + 1)(number)
    assert capsys.readouterr().err == "nonsac: compiling kernels (first run only) ...\n"
    with compiling_noted(quiet=True):
        numba.njit(lambda x: x + 2)(1)
    assert capsys.readouterr().err == ""


def test_progress_only_on_a_terminal(monkeypatch, capsys):
    with progress_bar(quiet=False, unit="samples") as progress:
        progress(1, 2)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    with progress_bar(quiet=False, unit="samples") as progress:
        progress(1, 2)
    captured = capsys.readouterr()
    assert "samples" in captured.err
    assert captured.out == ""


def test_other_misuse(folder, refused):
    assert "No such command 'register'" in refused("register")
    assert "Missing argument" in refused("register-clouds")
    assert "'--picture'" in refused("demo", "--picture", "demo.gif")
    Path("file").write_text("")
    assert "file: File exists" in refused("demo", "--save-scans", "file", "--picture", "demo.png")
