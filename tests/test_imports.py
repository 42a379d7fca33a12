"""What `import nonsac` costs, and that kernels compile once. Each runs in a process of its own."""

import importlib
import json
import os
import pkgutil
import subprocess
import sys

import pytest

import nonsac
from nonsac.kernels.ahead import SIGNATURES, signature_of


def run(code, **environment):
    """What the code prints as JSON; warnings are errors there, too."""
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_every_exported_name_exists():
    assert sorted(nonsac.__all__) == nonsac.__all__
    for name in nonsac.__all__:
        assert hasattr(nonsac, name)


@pytest.mark.parametrize("package", ["nonsac", "nonsac.problems", "nonsac.estimators", "nonsac.sources"])
def test_exported_names_say_where_they_come_from(package):
    module = importlib.import_module(package)
    for name in module.__all__:
        assert getattr(module, name).__name__.split(".")[-1] == name


IMPORT = """
import json, sys, time
start = time.perf_counter()
from numba.core.dispatcher import Dispatcher
compiled = []
compile = Dispatcher.compile
Dispatcher.compile = lambda self, sig: compiled.append(self.__name__) or compile(self, sig)
import nonsac
seconds = time.perf_counter() - start
print(json.dumps({"seconds": seconds, "compiled": compiled, "modules": sorted(sys.modules)}))
"""


def test_import_compiles_nothing_and_is_quick():
    told = run(IMPORT)
    assert told["compiled"] == []
    assert told["seconds"] < 3.0
    heavy = {"matplotlib", "pyplot", "typer", "rich", "trimesh", "open3d", "laspy", "pandas", "pyarrow", "fsspec"}
    assert not heavy & {name.split(".")[0] for name in told["modules"]}


def test_what_reads_files_of_others_is_imported_when_used():
    code = """
import importlib, json, pkgutil, sys
import nonsac.sources
for module in pkgutil.iter_modules(nonsac.sources.__path__):
    importlib.import_module(f"nonsac.sources.{module.name}")
print(json.dumps(sorted(sys.modules)))
"""
    assert not {"h5py", "laspy", "pyarrow", "zarr", "fsspec"} & {name.split(".")[0] for name in run(code)}


USE = """
import json, pkgutil, importlib
import numpy as np
import nonsac, nonsac.kernels
from nonsac.kernels._jit import Kernel

def kernels():
    for module in pkgutil.iter_modules(nonsac.kernels.__path__):
        for name, value in vars(importlib.import_module(f"nonsac.kernels.{module.name}")).items():
            if isinstance(value, Kernel) and value.__module__.endswith(module.name):
                yield f"{module.name}.{name}", value

pairs = nonsac.simulate.registration(3000, 0.8, 0.01, rng=0)
for scale, estimator in ((1.0, None), (1, None), (2, nonsac.Pcr99()), (np.float32(1), None), (None, None),
                         (None, nonsac.Pcr99(rank="sum")),
                         (1, nonsac.Pcr99("distance", rank="sum", tolerance=1, max_drawn=5000)),
                         (1.0, nonsac.Pcr99("distance", order="random", tolerance=1, max_drawn=5000))):
    nonsac.register_pairs(pairs.source, pairs.target, noise=0.01, scale=scale, estimator=estimator, samples=2)
from nonsac.estimators.named import ESTIMATORS
few = pairs.source[:400], np.asfortranarray(pairs.target[:400], np.float32)
for name, named in ESTIMATORS.items():
    if named.fits(nonsac.Registration()) and named.needs is None and not named.weighted:
        nonsac.register_pairs(*few, noise=0.01, estimator=name, samples=1)
nonsac.register_pairs(*few, noise=0.01, scale=None, estimator="teaser", samples=1)
frozen = pairs.source.astype(np.float32)
frozen.flags.writeable = False
nonsac.register_pairs(frozen, np.asfortranarray(pairs.target), noise=1, samples=2)
nonsac.register_pairs(frozen, np.asfortranarray(pairs.target), noise=0.01, refine="full")
nonsac.register_pairs(pairs.source, pairs.target, noise=0.01, scale=None, weights=[1, 2] * 1500, refine="full")
clouds = nonsac.simulate.demo_scans(0)
nonsac.register_clouds(clouds.source, clouds.target, samples=2)
nonsac.register_clouds(np.asfortranarray(clouds.source, np.float32), clouds.target, samples=2)
matches = nonsac.simulate.relative_pose(3000, 0.5, 0.001, rng=0)
nonsac.relative_pose(matches.points1, matches.points2, noise=0.001, samples=2)
nonsac.relative_pose(matches.points1, matches.points2)
nonsac.Problem.count_on_ladder(nonsac.RelativePose(), np.eye(3, 4)[None], np.ones((9, 4)), np.array([1.0, 2.0]))
nonsac.relative_pose(matches.points1.astype(np.float32), np.asfortranarray(matches.points2), (1, 1, 0, 0), noise=1e-3)
nonsac.relative_pose(matches.points1, matches.points2, noise=1e-3, weights=np.arange(3000), refine="none")
nonsac.relative_pose(matches.points1, matches.points2, (1, 1, 0, 0), weights=np.arange(3000), refine="full")
points = nonsac.simulate.absolute_pose(3000, 0.5, 0.001, rng=0)
nonsac.absolute_pose(points.points2d, points.points3d, noise=0.001, samples=2, refine="full")
nonsac.absolute_pose(points.points2d, points.points3d)
nonsac.absolute_pose(points.points2d.astype(np.float32), points.points3d, (1, 1, 0, 0), noise=1e-3, weights=[1] * 3000)
nonsac.estimate(nonsac.ArraySource(np.hstack([points.points2d, points.points3d])), nonsac.AbsolutePose(),
                nonsac.Ransac(500), noise=0.001)
weighted = np.hstack([pairs.source, pairs.target, np.arange(3000.0)[:, None]])
for estimator in (None, "ransac", lambda values, threshold, seed: pairs.T[:3]):
    nonsac.estimate(nonsac.ArraySource(weighted), nonsac.Registration(), estimator, noise=0.01, sample_size=500)
    nonsac.estimate(nonsac.ArraySource(weighted[:, :6]), nonsac.Registration(None), estimator, refine="full")
print(json.dumps({
    "signatures": {name: [str(s) for s in kernel.entry.signatures] for name, kernel in kernels()},
    "called": sorted({name for _, kernel in kernels() for name in kernel.py_func.__code__.co_names}),
}))
"""


@pytest.mark.slow
def test_kernels_compile_for_one_signature():
    """Whatever dtype, memory order or number type a caller uses: each further signature costs seconds."""
    told = run(USE)
    signatures = told["signatures"]
    assert len(signatures) > 10
    # What only other kernels call has none.
    unused = {name for name, found in signatures.items() if not found and name.split(".")[1] not in told["called"]}
    assert unused == set()
    assert {name: found for name, found in signatures.items() if len(found) > 1} == {}
    ahead = {name: [str(signature_of(name))] for name in SIGNATURES}
    assert {name: found for name, found in signatures.items() if found} == ahead


def test_every_module_imports():
    modules = [m.name for m in pkgutil.walk_packages(nonsac.__path__, "nonsac.")]
    quiet = [name for name in modules if not name.endswith("__main__")]
    code = "import importlib, json\n" + "\n".join(f"importlib.import_module({n!r})" for n in quiet) + "\nprint('true')"
    assert run(code) is True
