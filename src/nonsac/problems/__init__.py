"""What is estimated. A problem owns the mathematics and knows nothing of where its rows lie."""

from nonsac.problems.absolute_pose import AbsolutePose
from nonsac.problems.contract import Problem, residual_dimension
from nonsac.problems.registration import Registration
from nonsac.problems.relative_pose import RelativePose
from nonsac.problems.special_case import Simpler
from nonsac.problems.weighted import Weighted

__all__ = ["AbsolutePose", "Problem", "Registration", "RelativePose", "Simpler", "Weighted", "residual_dimension"]
