"""The rules that keep the bits of an answer the same in every process."""

import importlib
import os
import pkgutil
import subprocess
import sys

import nonsac.kernels
from nonsac.kernels._jit import Kernel


def all_kernels():
    """All kernels, by name."""
    found = {}
    for module in pkgutil.iter_modules(nonsac.kernels.__path__):
        for name, value in vars(importlib.import_module(f"nonsac.kernels.{module.name}")).items():
            if isinstance(value, Kernel):
                found[value.__module__, name] = value
    return found


def test_what_other_kernels_call_is_not_reordered():
    kernels = all_kernels()
    reordered = {value for value in kernels.values() if value.flags.get("fastmath")}
    assert len(reordered) > 5
    for (module, _), caller in kernels.items():
        called = {kernels.get((module, name)) for name in caller.py_func.__code__.co_names}
        assert not called & reordered, f"{caller} calls a reordered kernel"


POSE = """
import nonsac
views = nonsac.simulate.relative_pose(n=3000, outlier_ratio=0.7, noise=0.0025, rng=0)
result = nonsac.relative_pose(views.points1, views.points2, noise=0.0025, refine="full")
print(result.T.tobytes().hex(), result.covariance.tobytes().hex())
"""


def test_a_process_that_compiles_gives_the_same_bits(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    runs = [
        subprocess.run([sys.executable, "-c", POSE], env=environment, capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert len(runs[0].stdout) > 100
    assert runs[0].stdout == runs[1].stdout
