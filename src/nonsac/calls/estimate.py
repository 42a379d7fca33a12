"""The pipeline itself, for any source, problem and core estimator."""

from __future__ import annotations

from typing import Unpack

from nonsac.calls.arguments import check_object, check_source
from nonsac.calls.rows import source_of_rows
from nonsac.estimators.contract import Estimator
from nonsac.estimators.external import Call
from nonsac.estimators.named import chosen_estimator
from nonsac.method.pipeline import run
from nonsac.method.search import Stop
from nonsac.method.settings import Keywords, Settings, shows_settings
from nonsac.problems.contract import Problem, check_attributes
from nonsac.result import Result
from nonsac.sources.contract import Source


@shows_settings("estimator", refine="union")
def estimate(
    source: Source,
    problem: Problem,
    estimator: str | Estimator | Call | None = None,
    *,
    stop: Stop | None = None,
    **settings: Unpack[Keywords],
) -> Result:
    """Estimate a model from any amount of dirty data.

    Draws non-minimal samples, runs the core estimator on each, selects one hypothesis by the scoring rule, refines it
    and says how far to trust it. Memory is set by the samples, not by the source.

    Parameters
    ----------
    source : Source
        The rows, with the columns of the problem's layout: found by name if the source names its columns, else taken
        in order. A column `weight`, or one more without a name, is a weight, not negative, in any unit. A row of twice
        the weight counts as if it were there twice; the verdict counts rows, not weights.
    problem : Problem
        The mathematics, for instance `Registration()`.
    estimator : str, Estimator or callable, optional
        Finds a model in one sample: a name ("ransac", "pcr99"), an object such as `Ransac(500)`, or a function (see
        `External`). By default that of the problem.
    stop : callable, optional
        Called as `stop(hypotheses, problem)` after each sample; if it returns true, sampling ends.
    {settings}

    Returns
    -------
    Result

    Raises
    ------
    ValueError, TypeError
        If an argument is out of its range; the message names it. Bad data do not raise: they end in a status.
    """
    check_object("problem", problem, Problem)
    check_attributes(problem)
    check_source("source", source)
    core = chosen_estimator(estimator, problem)
    chosen = Settings.of("estimate", settings, **{"refine": "union"}).fitting(problem)
    if stop is not None and not callable(stop):
        raise TypeError(f"stop must be a function of (hypotheses, problem), or None, got {stop!r}")
    return run(source_of_rows(source, problem.layout, "source"), problem, core, chosen, stop)
