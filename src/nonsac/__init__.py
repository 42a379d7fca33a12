"""Robust geometric estimation from data too large or too dirty for anything else."""

from __future__ import annotations

from importlib.metadata import version

from nonsac import evaluation, scoring, simulate
from nonsac.api import register_clouds, register_pairs
from nonsac.estimators import OrientedPairs, Pcr99
from nonsac.pipeline import estimate
from nonsac.problems import OrientedRegistration, Registration
from nonsac.result import Alternative, FailedEstimation, Hypothesis, Result, Status
from nonsac.sources import AllPairsSource, ArraySource

__version__ = version("nonsac")

__all__ = [
    "AllPairsSource",
    "Alternative",
    "ArraySource",
    "FailedEstimation",
    "Hypothesis",
    "OrientedPairs",
    "OrientedRegistration",
    "Pcr99",
    "Registration",
    "Result",
    "Status",
    "estimate",
    "evaluation",
    "register_clouds",
    "register_pairs",
    "scoring",
    "simulate",
]
