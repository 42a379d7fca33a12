"""The rules that keep the bits of an answer the same in every process."""

import importlib
import os
import pkgutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

import nonsac.kernels
from nonsac.kernels import ahead, nearest_field
from nonsac.kernels._jit import Kernel, kernel


def all_kernels():
    """All kernels, by name."""
    found = {}
    for module in pkgutil.iter_modules(nonsac.kernels.__path__):
        for name, value in vars(importlib.import_module(f"nonsac.kernels.{module.name}")).items():
            if isinstance(value, Kernel):
                found[value.__module__, name] = value
    return found


def test_what_several_kernels_call_is_not_reordered():
    kernels = all_kernels()
    reordered = {value for value in kernels.values() if value.flags.get("fastmath")}
    assert len(reordered) > 5
    from_python = {ahead.entry_of(name).py_func for name in ahead.SIGNATURES}
    callers = {kernel: [] for kernel in reordered}
    for (module, _), caller in kernels.items():
        for name in caller.py_func.__code__.co_names:
            if kernels.get((module, name)) in reordered:
                callers[kernels[module, name]].append(caller)
    for called, found in callers.items():
        assert len(found) <= (0 if called.py_func in from_python else 1), f"{called} is called by {found}"
        assert reordered.issuperset(found)


def test_flags_are_not_those_of_the_caller():
    """Or the last bits would depend on what is compiled first: numba hands them down unless they are given."""
    source = vars(nearest_field)
    for name in ("_cell", "_square"):
        assert source[name].flags["fastmath"] is False


def test_threads_share_one_compiled_kernel(monkeypatch):
    """And none of them sees it before it has its place on disk."""
    made = kernel(lambda x: x + 3)
    slow = made._dispatcher
    monkeypatch.setattr(made, "_dispatcher", lambda: time.sleep(0.05) or slow())
    with ThreadPoolExecutor(4) as pool:
        entries = list(pool.map(lambda _: (id(made.entry), type(made.entry._cache)), range(4)))
    assert len(set(entries)) == 1


ANSWERS = """
import sys
import nonsac
from nonsac.kernels import ahead
if "backwards" in sys.argv:
    ahead.SIGNATURES = dict(reversed(ahead.SIGNATURES.items()))
    ahead._cores = lambda: 1
views = nonsac.simulate.relative_pose(n=3000, outlier_ratio=0.7, noise=0.0025, rng=0)
result = nonsac.relative_pose(views.points1, views.points2, noise=0.0025, refine="full")
print(result.T.tobytes().hex(), result.covariance.tobytes().hex())
scans = nonsac.simulate.demo_scans(0, points=1500)
print(nonsac.register_clouds(scans.source, scans.target, samples=4).T.tobytes().hex())
"""


@pytest.mark.slow
def test_bits_do_not_depend_on_who_compiles_and_in_which_order(tmp_path):
    runs = []
    for folder, order in (("first", "forwards"), ("first", "forwards"), ("second", "backwards")):
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / folder)}
        command = [sys.executable, "-c", ANSWERS, order]
        runs.append(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    assert len(runs[0]) > 100
    assert runs[0] == runs[1] == runs[2]
