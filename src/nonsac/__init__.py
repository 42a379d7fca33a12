"""Robust geometric estimation from data too large or too dirty for anything else."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from nonsac.values.version import VERSION

if TYPE_CHECKING:
    from nonsac import evaluation, io, plot, simulate, testing
    from nonsac.calls.clouds import register_clouds
    from nonsac.calls.compare import compare
    from nonsac.calls.comparison import Compared, Comparison
    from nonsac.calls.estimate import estimate
    from nonsac.calls.jobs import Job, WorkerDied, estimate_many
    from nonsac.calls.localization import Localization
    from nonsac.calls.localize import localize
    from nonsac.calls.pairs import register_pairs
    from nonsac.calls.poses import absolute_pose, relative_pose
    from nonsac.calls.verification import Verification
    from nonsac.calls.verify import verify
    from nonsac.cameras.camera import Camera
    from nonsac.estimators import Estimator, External, Pcr99, Ransac
    from nonsac.files.errors import InputError
    from nonsac.layouts import Layout, Rows
    from nonsac.method import scoring
    from nonsac.method.planning import Plan, plan
    from nonsac.method.refine import Refinement, Refiner
    from nonsac.method.scoring import ScoringRule
    from nonsac.problems import (
        AbsolutePose,
        ContractBroken,
        Noise,
        Problem,
        Registration,
        RelativePose,
        SpecialCase,
        Streaming,
    )
    from nonsac.result import Alternative, FailedEstimation, Hypothesis, Remark, Result, Status
    from nonsac.sources import (
        About,
        AllPairsSource,
        ArraySource,
        Hdf5Source,
        JoinedSource,
        LasSource,
        MappedSource,
        NpySource,
        ParquetSource,
        RawSource,
        Source,
        StreamSource,
        ZarrSource,
    )
    from nonsac.sources.open import open_source

__version__ = VERSION

__all__ = [
    "About",
    "AbsolutePose",
    "AllPairsSource",
    "Alternative",
    "ArraySource",
    "Camera",
    "Compared",
    "Comparison",
    "ContractBroken",
    "Estimator",
    "External",
    "FailedEstimation",
    "Hdf5Source",
    "Hypothesis",
    "InputError",
    "Job",
    "JoinedSource",
    "LasSource",
    "Layout",
    "Localization",
    "MappedSource",
    "Noise",
    "NpySource",
    "ParquetSource",
    "Pcr99",
    "Plan",
    "Problem",
    "Ransac",
    "RawSource",
    "Refinement",
    "Refiner",
    "Registration",
    "RelativePose",
    "Remark",
    "Result",
    "Rows",
    "ScoringRule",
    "Source",
    "SpecialCase",
    "Status",
    "StreamSource",
    "Streaming",
    "Verification",
    "WorkerDied",
    "ZarrSource",
    "absolute_pose",
    "compare",
    "estimate",
    "estimate_many",
    "evaluation",
    "io",
    "localize",
    "open_source",
    "plan",
    "plot",
    "register_clouds",
    "register_pairs",
    "relative_pose",
    "scoring",
    "simulate",
    "testing",
    "verify",
]

_HOMES = {
    "nonsac.calls.clouds": ("register_clouds",),
    "nonsac.calls.compare": ("compare",),
    "nonsac.calls.comparison": ("Compared", "Comparison"),
    "nonsac.calls.jobs": ("Job", "WorkerDied", "estimate_many"),
    "nonsac.calls.localization": ("Localization",),
    "nonsac.calls.localize": ("localize",),
    "nonsac.calls.pairs": ("register_pairs",),
    "nonsac.calls.poses": ("absolute_pose", "relative_pose"),
    "nonsac.calls.verification": ("Verification",),
    "nonsac.calls.verify": ("verify",),
    "nonsac.cameras.camera": ("Camera",),
    "nonsac.estimators": ("Estimator", "External", "Pcr99", "Ransac"),
    "nonsac.layouts": ("Layout", "Rows"),
    "nonsac.files.errors": ("InputError",),
    "nonsac.calls.estimate": ("estimate",),
    "nonsac.method.planning": ("Plan", "plan"),
    "nonsac.method.refine": ("Refinement", "Refiner"),
    "nonsac.method.scoring": ("ScoringRule",),
    "nonsac.problems": (
        "AbsolutePose",
        "ContractBroken",
        "Noise",
        "Problem",
        "Registration",
        "RelativePose",
        "SpecialCase",
        "Streaming",
    ),
    "nonsac.result": ("Alternative", "FailedEstimation", "Hypothesis", "Remark", "Result", "Status"),
    "nonsac.sources": (
        "About",
        "AllPairsSource",
        "ArraySource",
        "Hdf5Source",
        "JoinedSource",
        "LasSource",
        "MappedSource",
        "NpySource",
        "ParquetSource",
        "RawSource",
        "Source",
        "StreamSource",
        "ZarrSource",
    ),
    "nonsac.sources.open": ("open_source",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}
_MODULES = {
    "evaluation": "nonsac.evaluation",
    "io": "nonsac.io",
    "plot": "nonsac.plot",
    "scoring": "nonsac.method.scoring",
    "simulate": "nonsac.simulate",
    "testing": "nonsac.testing",
}


def __getattr__(name: str) -> Any:
    """Import on first use: it takes a while, for which `nonsac --help` need not wait for."""
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    if name in _MODULES:
        return import_module(_MODULES[name])
    raise AttributeError(f"module 'nonsac' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
