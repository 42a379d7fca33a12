"""Robust geometric estimation from data too large or too dirty for anything else."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nonsac import evaluation, scoring, simulate
    from nonsac.api import register_clouds, register_pairs
    from nonsac.batch import Job, WorkerDied, estimate_many
    from nonsac.camera import Camera
    from nonsac.estimators import OrientedPairs, Pcr99, Ransac
    from nonsac.pipeline import estimate
    from nonsac.planning import Plan, plan
    from nonsac.poses import absolute_pose, relative_pose
    from nonsac.problems import AbsolutePose, OrientedRegistration, Registration, RelativePose, Weighted
    from nonsac.result import Alternative, FailedEstimation, Hypothesis, Result, Status
    from nonsac.sources import (
        AllPairsSource,
        ArraySource,
        Hdf5Source,
        JoinedSource,
        LasSource,
        MappedSource,
        NpySource,
        ParquetSource,
        RawSource,
        StreamSource,
        ZarrSource,
    )
    from nonsac.sources.open import open_source

__version__ = version("nonsac")

__all__ = [
    "AbsolutePose",
    "AllPairsSource",
    "Alternative",
    "ArraySource",
    "Camera",
    "FailedEstimation",
    "Hdf5Source",
    "Hypothesis",
    "Job",
    "JoinedSource",
    "LasSource",
    "MappedSource",
    "NpySource",
    "OrientedPairs",
    "OrientedRegistration",
    "ParquetSource",
    "Pcr99",
    "Plan",
    "Ransac",
    "RawSource",
    "Registration",
    "RelativePose",
    "Result",
    "Status",
    "StreamSource",
    "Weighted",
    "WorkerDied",
    "ZarrSource",
    "absolute_pose",
    "estimate",
    "estimate_many",
    "evaluation",
    "open_source",
    "plan",
    "register_clouds",
    "register_pairs",
    "relative_pose",
    "scoring",
    "simulate",
]

_HOMES = {
    "nonsac.api": ("register_clouds", "register_pairs"),
    "nonsac.batch": ("Job", "WorkerDied", "estimate_many"),
    "nonsac.camera": ("Camera",),
    "nonsac.estimators": ("OrientedPairs", "Pcr99", "Ransac"),
    "nonsac.pipeline": ("estimate",),
    "nonsac.planning": ("Plan", "plan"),
    "nonsac.poses": ("absolute_pose", "relative_pose"),
    "nonsac.problems": ("AbsolutePose", "OrientedRegistration", "Registration", "RelativePose", "Weighted"),
    "nonsac.result": ("Alternative", "FailedEstimation", "Hypothesis", "Result", "Status"),
    "nonsac.sources": (
        "AllPairsSource",
        "ArraySource",
        "Hdf5Source",
        "JoinedSource",
        "LasSource",
        "MappedSource",
        "NpySource",
        "ParquetSource",
        "RawSource",
        "StreamSource",
        "ZarrSource",
    ),
    "nonsac.sources.open": ("open_source",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import on first use: numba and SciPy take a second, which `nonsac --help` need not wait for."""
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    if name in __all__:
        return import_module(f"nonsac.{name}")
    raise AttributeError(f"module 'nonsac' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
