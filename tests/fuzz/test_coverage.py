"""Whoever adds a reader or a call is told to add it to the fuzzer, too."""

import inspect

import pytest

import nonsac
from fuzz import arguments, cases, formats
from nonsac import evaluation, plot, scoring, simulate
from nonsac import io as nio
from nonsac.io.clouds import READERS
from nonsac.sources.open import _OPENERS

# What takes no data of its own, or what other calls are fuzzed through.
_BY_OTHERS = {
    "About": "describes a source",
    "Alternative": "an answer",
    "Compared": "an answer",
    "Comparison": "an answer",
    "ContractBroken": "an error",
    "Estimator": "abstract",
    "FailedEstimation": "an error",
    "Hdf5Source": "by open_source, as a format",
    "Hypothesis": "an answer",
    "InputError": "an error",
    "LasSource": "by open_source, as a format",
    "Localization": "an answer",
    "Noise": "made by the pipeline",
    "ParquetSource": "by open_source, as a format",
    "Plan": "an answer",
    "Problem": "abstract",
    "Refinement": "an answer",
    "Refiner": "abstract",
    "Remark": "an answer",
    "Result": "an answer, by apply",
    "Rows": "made by the pipeline",
    "ScoringRule": "abstract",
    "Source": "abstract",
    "SpecialCase": "an answer",
    "Status": "an answer",
    "Streaming": "abstract",
    "Verification": "an answer",
    "WorkerDied": "an error",
    "ZarrSource": "by open_source, as a format",
    "compare": "starts processes; its files by open_matches and read_truth",
}
_KINDS_OF_FILES = {
    "Parquet file": "parquet",
    "Arrow file": "arrow",
    "NumPy array": "npy",
    "NumPy archive": "npz",
    "HDF5 file": "hdf5-chunked",
    "Zarr folder": "zarr-3",
    "LAS file": "laz",
    "text table": "text-tables",
}
_READERS = {
    "open_matches": "npy",
    "read_cloud": "ply-ascii",
    "read_colmap_pair": "colmap-database",
    "read_colmap_points": "colmap-text",
    "read_colmap_pose": "colmap-binary",
    "read_hloc": "hloc",
    "read_matches": "npz",
    "read_pairs": "text-tables",
    "read_points": "npz",
    "read_transform": "transform",
    "read_truth": "truth-json",
}
_NOT_FUZZED = {"picture_suffix", "render"}


@pytest.mark.parametrize("name", [name for name in nonsac.__all__ if not inspect.ismodule(getattr(nonsac, name))])
def test_public_names(name):
    assert name in arguments.CALLS or name in _BY_OTHERS


@pytest.mark.parametrize("module", [evaluation, plot, simulate], ids=lambda module: module.__name__)
def test_public_functions_of_modules(module):
    functions = {name for name in module.__all__ if inspect.isfunction(getattr(module, name))} - _NOT_FUZZED
    prefix = module.__name__.rpartition(".")[2]
    assert {f"{prefix}.{name}" for name in functions} <= set(arguments.CALLS)


def test_writers():
    assert {name for name in nio.__all__ if name.startswith(("write", "from"))} <= set(arguments.CALLS)
    assert scoring.by_name is not None
    assert "scoring.by_name" in arguments.CALLS


def test_readers():
    assert {name for name in nio.__all__ if name.startswith(("read", "open"))} == set(_READERS)
    assert set(_READERS.values()) <= set(formats.FORMATS)


def test_suffixes_of_clouds():
    seeds = [f.seeds() for name, f in formats.FORMATS.items() if not cases.KINDS[name].missing]
    suffixes = {"." + file.rpartition(".")[2] for made in seeds for files in made for file in files}
    assert set(READERS) <= suffixes | {".las", ".laz"}


def test_kinds_of_sources():
    assert set(_OPENERS) == set(_KINDS_OF_FILES)
    assert set(_KINDS_OF_FILES.values()) <= set(formats.FORMATS)
