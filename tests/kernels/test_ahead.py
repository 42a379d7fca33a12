"""Kernels compiled before they are called: all that a call needs, on all cores, and nothing twice."""

import json
import os
import subprocess
import sys

import pytest

from nonsac.kernels import ahead

CALLS = """
import json, sys
import nonsac
from nonsac.kernels import ahead

call, more = sys.argv[1], json.loads(sys.argv[2])
if call == "register_clouds":
    data = nonsac.simulate.demo_scans(0, points=1500)
    points = data.source, data.target
elif call == "register_pairs":
    data = nonsac.simulate.registration(1500, 0.5, 0.01, rng=0)
    points = data.source, data.target
elif call == "relative_pose":
    data = nonsac.simulate.relative_pose(1500, 0.5, 0.001, rng=0)
    points = data.points1, data.points2
else:
    data = nonsac.simulate.absolute_pose(1500, 0.5, 0.001, rng=0)
    points = data.points2d, data.points3d
getattr(nonsac, call)(*points, **more)
used = {name for name in ahead.SIGNATURES if ahead.entry_of(name).signatures}
print(json.dumps(sorted(used)))
"""


@pytest.mark.parametrize("noise", [None, 0.01])
@pytest.mark.parametrize("call", list(ahead.NEEDED))
@pytest.mark.slow
def test_what_a_call_needs(call, noise):
    """The default call uses nothing else; a list that names too much makes its first use slower."""
    more = {} if noise is None or call == "register_clouds" else {"noise": noise}
    command = [sys.executable, "-c", CALLS, call, json.dumps(more)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    needed = set(ahead.NEEDED[call] if more else ahead.NEEDED[call] + ahead.NEEDED_WITHOUT_NOISE.get(call, ()))
    assert set(json.loads(done.stdout)) <= needed
    assert len(needed - set(json.loads(done.stdout))) <= 1


SIDE_BY_SIDE = """
import sys
from nonsac.kernels import ahead
ahead._cores = lambda: 2
names = ["losses.mirror", "pose_fit.move", "pose_math.rotate", "losses.likely_inliers"]
told = []
ahead.compile_side_by_side(names, lambda done, total: told.append((done, total)))
ahead.compile_side_by_side(names, lambda done, total: told.append("again"))
print(len(told), all(total == 4 for _, total in told))
"""


def test_each_kernel_is_compiled_by_one_process(tmp_path):
    """The kernels that the caller did not compile are on disk, by somebody else."""
    done = subprocess.run(
        [sys.executable, "-c", SIDE_BY_SIDE],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    count, right = done.stdout.split()
    assert 1 <= int(count) <= 4
    assert right == "True"
    assert len(list(tmp_path.rglob("*.nbc"))) == 4


def test_what_is_claimed_is_left_alone(tmp_path):
    compiled = []
    (tmp_path / "losses.mirror").touch()
    names = ["losses.mirror", "pose_math.rotate"]
    ahead.compile_unclaimed(tmp_path, names, lambda done, total: compiled.append((done, total)))
    assert compiled == [(1, 2)]
    ahead.compile_unclaimed(tmp_path / "gone", names, lambda done, total: compiled.append((done, total)))
    assert compiled == [(1, 2)]


def test_workers_and_other_programs_start_no_helpers(monkeypatch):
    started = []
    monkeypatch.setattr(ahead, "compile_side_by_side", started.append)
    monkeypatch.setattr(ahead, "_looked_after", set())
    monkeypatch.setattr(ahead.multiprocessing, "parent_process", lambda: "a parent")
    ahead.compile_for("register_pairs")
    assert started == []
    monkeypatch.setattr(ahead.multiprocessing, "parent_process", lambda: None)
    ahead.compile_for("register_pairs", 0.1)
    ahead.compile_for("register_pairs", 0.1)
    assert len(started) == 1
    ahead.compile_for("register_pairs")
    assert len(started) == 2
    for program, python in (("/usr/bin/python3.12", True), ("/opt/blender/blender", False), ("", False)):
        monkeypatch.setattr(sys, "executable", program)
        assert ahead._can_help() is python
