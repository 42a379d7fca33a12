"""The program as a whole: help, version, compiling, progress, misuse."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import nonsac
from cli_samples import said, subprocess_nonsac
from nonsac import cli, simulate
from nonsac.cli.session import compiling_noted, progress_bar
from nonsac.kernels import ahead


def test_warmup(run, monkeypatch):
    told = []
    monkeypatch.setattr(ahead, "compile_side_by_side", lambda names, progress: told.extend(names))
    code, out, err = run("warmup")
    assert (code, said(err)) == (0, [])
    assert out == "all kernels are compiled\n"
    assert told == list(ahead.SIGNATURES)


def test_help_and_version(run):
    assert run("--version") == (0, f"nonsac {nonsac.__version__}\n", "")
    for arguments in ((), ("--help",), ("reproduce",), ("register-pairs", "--help")):
        code, out, err = run(*arguments)
        assert (code, err) == (0, "")
        assert "Usage: nonsac" in out


SHARED = {"--samples", "--sample-size", "--seed", "--workers", "--output", "--picture", "--json", "--quiet", "--help"}
ROWS = SHARED | {
    "--noise",
    "--save-inliers",
    "--max-samples",
    "--max-uncertainty",
    "--time-limit",
    "--columns",
    "--dataset",
}
ROWS |= {"--picture-hypotheses", "--draw", "--max-memory", "--estimator", "--rule", "--refine"}
OPTIONS = {
    "register-clouds": SHARED | {"--save-aligned"},
    "register-pairs": ROWS | {"--scale", "--save-aligned"},
    "relative-pose": ROWS
    | {"--image1", "--image2", "--camera1", "--camera2", "--photo1", "--photo2", "--write-geometry"},
    "absolute-pose": ROWS | {"--image", "--camera", "--photo"},
    "plan": {"--problem", "--columns", "--dataset", "--samples", "--sample-size", "--draw", "--json"} | {"--help"},
    "demo": {"--picture", "--seed", "--workers", "--save-scans", "--json", "--quiet", "--help"},
    "batch": {"--output", "--call", "--workers", "--time-limit", "--resume", "--overwrite", "--quiet", "--help"},
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
@pytest.mark.slow
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


def test_progress_tells_how_long_it_takes(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    with progress_bar(quiet=False, unit="samples") as progress:
        progress(1, 2)
    assert "left" in capsys.readouterr().err


def test_the_short_option_of_help(run):
    for command in ([], ["register-pairs"], ["reproduce", "table2"]):
        assert run(*command, "-h") == run(*command, "--help")


def test_shells_can_complete():
    words = {"_NONSAC_COMPLETE": "complete_bash", "COMP_WORDS": "nonsac register-", "COMP_CWORD": "1"}
    done = subprocess_nonsac(env=os.environ | words)
    assert done.stdout.split() == ["register-clouds", "register-pairs"]


class Unforeseen(Exception):
    pass


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (Unforeseen("what"), "nonsac: unexpected error: Unforeseen: what"),
        (MemoryError("Unable to allocate 3 TiB"), "nonsac: not enough memory (Unable to allocate 3 TiB)"),
    ],
)
def test_an_unexpected_error_has_an_exit_code_of_its_own(folder, monkeypatch, capsys, error, said):
    def fails(*_, **__):
        raise error

    monkeypatch.setattr("nonsac.simulate.to_file", fails)
    arguments = ["simulate", "registration", "-n", "10", "--outlier-ratio", "0", "--noise", "0", "--output", "a.npy"]
    assert cli.main(arguments) == 3
    assert capsys.readouterr().err == f"{said} (--debug shows where)\n"
    for debugged in ([*arguments, "--debug"], ["--debug", *arguments]):
        assert cli.main(debugged) == 3
        err = capsys.readouterr().err
        assert err.startswith("Traceback")
        assert err.endswith(f"{said}\n")


@pytest.fixture
def pairs(folder):
    pairs = simulate.registration(500, 0.5, 0.01, 0)
    np.savez("pairs.npz", source=pairs.source, target=pairs.target)


REGISTER = "register-pairs pairs.npz --output T.txt --save-inliers i.npy"


@pytest.mark.parametrize("command", ["--help", REGISTER, f"{REGISTER} --json"])
@pytest.mark.slow
def test_a_reader_that_leaves_changes_nothing(pairs, folder, command):
    """Neither the exit code nor the files."""
    script = f"set -o pipefail; {sys.executable} -m nonsac {command} | true"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=120)
    assert (done.returncode, said(done.stderr)) == (0, [])
    written = {path.name for path in folder.iterdir()} - {"pairs.npz"}
    assert written == (set() if command == "--help" else {"T.txt", "i.npy"})


def test_quiet_is_quiet(pairs, run):
    assert "wrote T.txt" in run(*REGISTER.split())[1]
    code, out, err = run(*REGISTER.split(), "--quiet")
    assert (code, err) == (0, "")
    assert "wrote" not in out


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is full")
def test_a_full_disk_behind_stdout_is_told():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "nonsac", "--version"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (2, "nonsac: [Errno 28] No space left on device\n")


SLOW = """
import signal, sys, threading
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where the tests run under nohup
from nonsac import cli, simulate
from nonsac.files.atomic import write_atomically

def write(path, *_, **__):
    def writer(temporary):
        temporary.write_bytes(b"half")
        print("at work", flush=True)
        threading.Event().wait(60)
    write_atomically(path, writer)

simulate.to_file = write
sys.exit(cli.main("simulate registration -n 9 --outlier-ratio 0 --noise 0 --output a.npy".split()))
"""


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.slow
def test_told_to_end_it_leaves_nothing_behind(folder, number):
    with subprocess.Popen([sys.executable, "-c", SLOW], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"at work\n"
        assert len(list(folder.iterdir())) == 1
        process.send_signal(number)
        assert process.wait(60) == 128 + number
        assert process.stderr.read() == b"nonsac: told to end\n"
    assert list(folder.iterdir()) == []


def test_a_link_to_an_input_is_no_output(pairs, refused):
    os.link("pairs.npz", "T.txt")
    assert "T.txt is already used for PAIRS" in refused("register-pairs", "pairs.npz", "--output", "T.txt")


def test_other_misuse(folder, refused):
    assert "No such command 'register'" in refused("register")
    assert "Missing argument" in refused("register-clouds")
    assert "'--picture'" in refused("demo", "--picture", "demo.gif")
    Path("file").write_text("")
    assert "file: File exists" in refused("demo", "--save-scans", "file", "--picture", "demo.png")
