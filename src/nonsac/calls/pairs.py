"""Registration of matched 3D points."""

from __future__ import annotations

from typing import Unpack

from numpy.typing import ArrayLike

from nonsac.calls.arguments import warn_dropped_rows
from nonsac.calls.rows import rows_of_arrays, rows_of_source
from nonsac.estimators.named import chosen_estimator
from nonsac.kernels.ahead import compile_for
from nonsac.layouts import PAIRS
from nonsac.method.pipeline import run
from nonsac.method.settings import KeywordsAndEstimator, Settings, shows_settings
from nonsac.problems import Registration
from nonsac.result import Result
from nonsac.sources.contract import Source


@shows_settings()
def register_pairs(
    source: ArrayLike | Source,
    target: ArrayLike | None = None,
    *,
    scale: float | None = 1.0,
    weights: ArrayLike | None = None,
    **settings: Unpack[KeywordsAndEstimator],
) -> Result:
    """Register matched 3D points: row i of `source` is hypothesised to match row i of `target`.

    Parameters
    ----------
    source, target : (n, 3) array
        Rows with NaN or infinity are dropped.

        Or `source` alone: a source of rows (see `nonsac.open_source`) with the columns x1 y1 z1 x2 y2 z2 and perhaps a
        weight, in this order; if it has columns of these names, they are picked by them.
    scale : float or None
        The known scale between the clouds, 1 for a rigid motion; None estimates it.
    weights : (n,) array, optional
        How much each match counts, not negative, in any unit.
    noise : float, optional
        Standard deviation of a right match per coordinate, in the unit of the data; measured if it is left out. Rows
        with a residual below 5 `noise` are inliers.
    {others}
        As in `nonsac.estimate`; the default estimator is the paper's variant of PCR-99 (Sec. 4.3), or the published
        one if the scale is free. The rule decides the answer only with refine="none".

    Returns
    -------
    Result
        `T` maps the source into the target's frame.

    Raises
    ------
    ValueError, TypeError
        If the arrays are not (n, 3) numbers of equal length, or another argument is out of its range.
    """
    problem = Registration(scale)
    chosen = Settings.of("register_pairs", settings).fitting(problem)
    estimator = chosen_estimator(chosen.estimator, problem)
    if isinstance(source, Source):
        rows = rows_of_source(source, PAIRS, "source", target=target, weights=weights)
    else:
        arrays = {"source": source, "target": target}
        hint = ". For unmatched clouds use register_clouds."
        rows = rows_of_arrays("register_pairs", arrays, PAIRS.widths, weights, hint)
    compile_for("register_pairs", chosen.noise)
    result = run(rows.through([None, None]), problem, estimator, chosen)
    warn_dropped_rows(result, "with NaN or infinite coordinates", stacklevel=2)
    return result
