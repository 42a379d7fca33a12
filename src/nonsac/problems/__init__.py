"""What is estimated. A problem owns the mathematics and knows nothing of where its rows lie."""

from nonsac.problems.absolute_pose import AbsolutePose
from nonsac.problems.contract import ContractBroken, Problem
from nonsac.problems.noise import Noise
from nonsac.problems.normal_equations import Streaming
from nonsac.problems.registration import Registration
from nonsac.problems.relative_pose import RelativePose
from nonsac.problems.special_case import SpecialCase

__all__ = [
    "AbsolutePose",
    "ContractBroken",
    "Noise",
    "Problem",
    "Registration",
    "RelativePose",
    "SpecialCase",
    "Streaming",
]
