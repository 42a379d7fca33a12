"""The core estimators by name."""

from __future__ import annotations

from collections.abc import Callable

from nonsac.estimators.contract import Estimator
from nonsac.estimators.external import External
from nonsac.estimators.pcr99 import Pcr99
from nonsac.estimators.ransac import Ransac
from nonsac.problems.contract import Problem
from nonsac.problems.registration import Registration


def ransac(problem: Problem) -> Estimator:
    """RANSAC with local optimisation and early stopping.

    With a small baseline nearly every relative pose has nearly all inliers, and a good one needs a longer search.
    """
    least = 1000 if problem.minimal_size > 4 else 100
    return Ransac(20_000, confidence=0.9999, local_optimisation=True, least_iterations=least)


def pcr99(problem: Problem) -> Estimator:
    """The paper's variant of PCR-99 (Sec. 4.3), or the published one if the scale is free."""
    free = isinstance(problem, Registration) and problem.scale is None
    return Pcr99() if free else Pcr99.for_pairs()


ESTIMATORS: dict[str, Callable[[Problem], Estimator]] = {"ransac": ransac, "pcr99": pcr99}


def default_estimator(problem: Problem) -> str:
    """The name of the estimator that is used if none is given."""
    return "pcr99" if isinstance(problem, Registration) else "ransac"


def chosen_estimator(estimator: object, problem: Problem) -> Estimator:
    """The estimator that was given: as an object, a name, a function (see `External`), or None for the default.

    Raises
    ------
    TypeError, ValueError
        If it is none of these, or cannot work on the problem.
    """
    if estimator is None:
        estimator = default_estimator(problem)
    if isinstance(estimator, str):
        if estimator not in ESTIMATORS:
            raise ValueError(f"estimator must be one of {', '.join(ESTIMATORS)}, or an object, got {estimator!r}")
        chosen = ESTIMATORS[estimator](problem)
    elif isinstance(estimator, Estimator):
        chosen = estimator
    elif callable(estimator) and not isinstance(estimator, type):
        chosen = External(estimator)
    else:
        raise TypeError(
            "estimator must be a name, a function of (values, threshold, seed), or an object of a class derived from "
            f"nonsac.Estimator, got {_told(estimator)}"
        )
    chosen.check(problem)
    return chosen


def _told(value: object) -> str:
    return f"the class {value.__name__}" if isinstance(value, type) else type(value).__name__
