"""Checks of your own problem, estimator, rule, refiner or source against the contracts, for your tests.

Each function raises AssertionError with a sentence that says what was found and what the contract asks for. They are
what this package's own parts are tested with.

Examples
--------
>>> points = np.column_stack([np.linspace(-1, 1, 50), 0.5 * np.linspace(-1, 1, 50) + 0.2])
>>> nonsac.testing.check_problem(Line(), points)
"""

from __future__ import annotations

import difflib
import pickle
import warnings
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.calls.estimate import estimate
from nonsac.estimators.contract import Estimator
from nonsac.layouts import Array, Rows
from nonsac.method.refine import Refiner
from nonsac.method.scoring import ScoringRule
from nonsac.problems.contract import ContractBroken, Problem, refitted, solved
from nonsac.problems.noise import Noise
from nonsac.problems.special_case import SpecialCase
from nonsac.result import Hypothesis, Status
from nonsac.sources.array import ArraySource
from nonsac.sources.contract import Source

__all__ = ["check_estimator", "check_problem", "check_refiner", "check_rule", "check_source"]

_SAMPLES = 20

Part = TypeVar("Part")
Rest = ParamSpec("Rest")


class _Refused(Exception):
    """A part does not do what its contract says."""


def _refusing(check: Callable[Concatenate[Part, Rest], None]) -> Callable[Concatenate[Part, Rest], None]:
    """A check that refuses what raises, too, in a sentence that names it."""

    @wraps(check)
    def checked(part: Part, /, *rest: Rest.args, **named: Rest.kwargs) -> None:
        try:
            check(part, *rest, **named)
        except (_Refused, ContractBroken) as error:
            raise AssertionError(str(error)) from error.__cause__
        except Exception as error:
            raise AssertionError(_raised(type(part).__name__, error)) from error

    return checked


def _raised(what: str, error: Exception) -> str:
    return " ".join(f"{what} raised {type(error).__name__}: {error}".split())


@_refusing
def check_problem(problem: Problem, rows: ArrayLike, *, tolerance: float = 1e-6) -> None:
    """Check a problem on rows of one model.

    Parameters
    ----------
    problem : Problem
    rows : (n, D) array
        Different rows of one and the same model without noise, at least ten more than `problem.minimal_size`, and in
        general position: no line along an axis, say.
    tolerance : float
        What counts as zero for residuals, as a share of those of rows that do not belong to the model.

    Raises
    ------
    AssertionError
        If the problem does not do what `nonsac.Problem` says.
    """
    name, table = type(problem).__name__, np.array(rows, np.float64, order="C")
    _expect(isinstance(problem, Problem), f"{name} is not derived from nonsac.Problem")
    _check_names(problem)
    size = problem.minimal_size + 10
    expected = f"rows must have the shape (n, {problem.width}) with n of at least {size}, got {table.shape}"
    _expect(table.ndim == 2 and table.shape[1] == problem.width and len(table) >= size, expected)
    _check_background(problem, table)
    model, unit = _check_solver(problem, table, tolerance)
    _check_residuals(problem, model, table)
    _check_lengths(problem, model, table)
    _check_counts(problem, model, table, unit)
    _check_fits(problem, model, table, tolerance * unit)
    _check_distance(problem, model)
    _check_average(problem, model, table, tolerance * unit)
    _check_words(problem, model, table, tolerance * unit)
    copy = _travelled(problem)
    same = np.array_equal(copy.residuals(model[None], table), problem.residuals(model[None], table))
    _expect(same, f"{name} gives other residuals after a journey to another process (pickle)")


@_refusing
def check_estimator(estimator: Estimator, problem: Problem, rows: ArrayLike, noise: float) -> None:
    """Check a core estimator on rows in which it should find a model.

    Parameters
    ----------
    estimator : Estimator
    problem : Problem
        One that it can work on.
    rows : (n, D) array
        A sample with inliers enough for it.
    noise : float
        Standard deviation of an inlier.

    Raises
    ------
    AssertionError
        If the estimator does not do what `nonsac.Estimator` says.
    """
    name, table, level = type(estimator).__name__, Rows(np.array(rows, np.float64, order="C")), Noise.given(noise)
    _expect(isinstance(estimator, Estimator), f"{name} is not derived from nonsac.Estimator")
    estimator.check(problem)
    before = table.values.copy()
    found = _estimated(estimator, problem, table, level)
    _expect(np.array_equal(table.values, before), f"{name}.estimate changes the rows that it is given")
    _expect(found.found, f"{name}.estimate finds no model in these rows")
    _expect(found.threshold == level.threshold, f"{name}.estimate gives another threshold than noise.threshold")
    _expect(  # no more than rows: some count points that several rows share
        np.ndim(found.residuals) == 1 and len(found.residuals) <= len(table),
        f"{name}.estimate gives residuals of the shape {np.shape(found.residuals)} for {len(table)} rows",
    )
    _expect(found.num_inliers > problem.minimal_size, f"{name}.estimate finds a model without support")
    _expect(found.tested is None or found.tested >= 1, f"{name} tells that it tested {found.tested} models")
    again = _estimated(estimator, problem, table, level)
    _expect(np.array_equal(found.model, again.model), f"{name} gives another model for the same random numbers")
    away = _estimated(_travelled(estimator), problem, table, level)
    _expect(np.array_equal(found.model, away.model), f"{name} gives another model in another process (pickle)")
    copies = _estimated(estimator, problem, Rows(np.repeat(table.values[:1], 50, axis=0)), level)
    _expect(not copies.found, f"{name} finds a model in copies of one row, which determine none")
    _estimated(estimator, problem, table[: problem.minimal_size], level)
    weighted = Rows(table.values, np.linspace(0.5, 1.5, len(table)))
    _expect(_estimated(estimator, problem, weighted, level).found, f"{name} finds no model if rows have weights")
    larger = estimator.with_budget(3)
    _expect(type(larger) is type(estimator), f"{name}.with_budget gives a {type(larger).__name__}")


@_refusing
def check_rule(rule: ScoringRule, problem: Problem) -> None:
    """Check a scoring rule on random hypotheses of a problem.

    Raises
    ------
    AssertionError
        If the rule does not do what `nonsac.ScoringRule` says.
    """
    name = type(rule).__name__
    _expect(isinstance(rule, ScoringRule), f"{name} is not derived from nonsac.ScoringRule")
    _expect(isinstance(rule.name, str) and bool(rule.name), f"{name}.name must be a string, got {rule.name!r}")
    _expect(_travelled(rule).name == rule.name, f"{name} has another name after a journey to another process (pickle)")
    for seed in range(_SAMPLES):
        hypotheses = _random_hypotheses(problem, np.random.default_rng(seed))
        scores = np.asarray(rule.scores(hypotheses, problem), np.float64)
        _expect(scores.shape == (len(hypotheses),), f"{name}.scores gave {scores.shape} for {len(hypotheses)} of them")
        _expect(not np.isnan(scores).any(), f"{name}.scores gave NaN; use -inf for what must not win")
        _expect(bool(np.isfinite(scores).any()), f"{name}.scores lets no hypothesis win")


@_refusing
def check_refiner(refiner: Refiner, problem: Problem, rows: ArrayLike, noise: float) -> None:
    """Check a refiner in the pipeline, on rows with many inliers.

    Raises
    ------
    AssertionError
        If the refiner does not do what `nonsac.Refiner` says, or the answer is not trusted.
    """
    name, table = type(refiner).__name__, np.array(rows, np.float64, order="C")
    _expect(isinstance(refiner, Refiner), f"{name} is not derived from nonsac.Refiner")
    refiner.check(problem)
    results = [
        estimate(ArraySource(table), problem, "ransac", noise=noise, refine=refiner, samples=2, workers=workers)
        for workers in (1, 2)
    ]
    first, second = results
    told = f"{first.status.value}, with a confidence of {first.confidence:.3g}"
    _expect(first.status is Status.OK, f"{name} gives an answer that is not trusted: {told}")
    _expect(first.model.shape == tuple(problem.model_shape), f"{name} gives a model of the shape {first.model.shape}")
    _expect(np.array_equal(first.model, second.model), f"{name} gives another model for another number of workers")
    _expect(0.0 <= first.confidence <= 1.0, f"{name} gives a confidence of {first.confidence}")
    _expect(0 < first.num_inliers <= first.num_rows, f"{name}: {first.num_inliers} inliers of {first.num_rows} rows")


@_refusing
def check_source(source: Source, rows: ArrayLike) -> None:
    """Check a source against all of its rows.

    Parameters
    ----------
    source : Source
    rows : (n, D) array
        What it should hold, in order; at least three rows.

    Raises
    ------
    AssertionError
        If the source does not do what `nonsac.Source` says.
    """
    name, table = type(source).__name__, np.asarray(rows, np.float64)
    _expect(isinstance(source, Source), f"{name} is not derived from nonsac.Source")
    _expect((len(source), source.width) == table.shape, f"{name} has {len(source)} x {source.width}, not {table.shape}")
    last = len(table) - 1
    for wanted in ([0], [last, 0], [2, 2, 1], list(range(len(table))), []):
        _check_taken(name, source, np.array(wanted, np.int64), table)
    taken = source.take(np.array([1, 2]))
    taken[:] = -1.0
    _check_taken(name, source, np.array([1, 2]), table)
    for number in (len(table), len(table) + 10**6, -1, -(10**6)):
        _expect(_refuses(source, number), f"{name}.take must raise IndexError for row {number}")
    for size in (1, 4, len(table) + 5):
        _check_chunks(name, list(source.chunks(size)), size, table)
    for start, stop in ((0, 2), (1, 1), (1, None), (2, len(table) + 5)):
        _check_chunks(name, list(source.chunks(2, start, stop)), 2, table[start:stop])
    _check_taken(f"{name}, after a journey to another process (pickle),", _travelled(source), np.array([2, 1]), table)


# --- parts -----------------------------------------------------------------------------------


def _expect(condition: bool, message: str) -> None:
    if not condition:
        raise _Refused(message)


def _travelled(part: Part) -> Part:
    """The part after a journey to another process."""
    try:
        copy: Part = pickle.loads(pickle.dumps(part))
    except Exception as error:
        name = type(part).__name__
        raise _Refused(_raised(f"{name} does not travel to other processes (pickle): it", error)) from error
    return copy


def _check_names(problem: Problem) -> None:
    """Refuse what looks like a method or an attribute of the contract, but is none and would never be used."""
    name, known = type(problem).__name__, [each for each in dir(Problem) if not each.startswith("_")]
    own = {each for kind in type(problem).__mro__ if Problem in kind.__mro__[1:] for each in vars(kind)}
    for each in sorted(own - {*known}):
        meant = [word for word in difflib.get_close_matches(each, known, cutoff=0.85) if word not in own]
        _expect(not meant, f"{name}.{each} is not part of nonsac.Problem: was `{''.join(meant[:1])}` meant?")


def _check_solver(problem: Problem, rows: Array, tolerance: float) -> tuple[Array, float]:
    """The model that explains all rows, and what residuals rows have that do not belong to it."""
    name, k = type(problem).__name__, problem.minimal_size
    rng = np.random.default_rng(0)
    samples = rows[np.stack([rng.choice(len(rows), k, replace=False) for _ in range(_SAMPLES)])]
    before = samples.copy()
    models = solved(problem, samples)
    _expect(np.array_equal(samples, before), f"{name}.solve_minimal changes the samples that it is given")
    _expect(len(models) > 0, f"{name}.solve_minimal gives no model for samples of rows of one model")
    finite = models[np.isfinite(models).reshape(len(models), -1).all(axis=1)]
    _expect(len(finite) > 0, f"{name}.solve_minimal gives models of NaN or infinity only")
    largest = _residuals(problem, finite, rows).max(axis=1)
    best = finite[int(np.argmin(largest))]
    others = _residuals(problem, best[None], problem.background(rows, 1000, rng))[0]
    unit = float(np.median(others[np.isfinite(others)]))
    _expect(
        bool(largest.min() <= tolerance * unit),
        f"no model of {name}.solve_minimal explains all rows: the best one has residuals up to {largest.min():.3g}, "
        f"rows that do not belong to it have {unit:.3g}",
    )
    return best, unit


def _check_residuals(problem: Problem, model: Array, rows: Array) -> None:
    name, (before, models) = type(problem).__name__, (rows.copy(), np.stack([model, 0.5 * model + 0.1, model]))
    together = _residuals(problem, models, rows)
    _expect(np.array_equal(rows, before), f"{name}.residuals changes the rows that it is given")
    each = np.vstack([_residuals(problem, one[None], rows) for one in models])
    _expect(np.allclose(together, each), f"{name}.residuals of several models are not those of each by itself")
    try:
        nothing = problem.residuals(models, rows[:0])
    except Exception as error:
        raise _Refused(_raised(f"{name}.residuals fails for no rows: it", error)) from error
    _expect(nothing.shape == (3, 0), f"{name}.residuals gave {nothing.shape} for 3 models and no rows")


def _check_lengths(problem: Problem, model: Array, rows: Array) -> None:
    """Residuals double if rows go twice as far from a model; of squares it is four times as much."""
    name, away = type(problem).__name__, problem.background(rows, len(rows), np.random.default_rng(4)) - rows
    once, twice = (_residuals(problem, model[None], rows + step * away)[0] for step in (1e-3, 2e-3))
    growth = float(np.median(twice[once > 0.0] / once[once > 0.0]))
    _expect(
        1.5 < growth < 2.5,
        f"{name}.residuals grow by a factor of {growth:.3g} if rows go twice as far from a model; they are lengths, "
        "no squares",
    )


def _residuals(problem: Problem, models: Array, rows: Array) -> Array:
    name, residuals = type(problem).__name__, problem.residuals(models, rows)
    _expect(isinstance(residuals, np.ndarray), f"{name}.residuals gave a {type(residuals).__name__}, not an array")
    shape = (len(models), len(rows))
    _expect(
        residuals.shape == shape, f"{name}.residuals gave {residuals.shape} for {shape[0]} models and {shape[1]} rows"
    )
    _expect(not (residuals < 0.0).any(), f"{name}.residuals gave negative numbers; they are lengths")
    return residuals


def _check_counts(problem: Problem, model: Array, rows: Array, unit: float) -> None:
    name, rng = type(problem).__name__, np.random.default_rng(1)
    mixed = np.vstack([rows, problem.background(rows, 2 * (len(rows) // 2), rng)])
    weights = rng.uniform(0.5, 1.5, len(mixed))
    models = np.stack([model, model])
    residuals = problem.residuals(models, mixed)
    threshold = 0.5 * unit
    clear = (np.abs(residuals - threshold) > 1e-2 * threshold).all(axis=0)  # single precision may be used
    mixed, weights, inliers = mixed[clear], weights[clear], residuals[:, clear] < threshold
    counts = problem.count_inliers(models, mixed, threshold)
    _expect(np.array_equal(counts, inliers.sum(axis=1)), f"{name}.count_inliers is not the number of small residuals")
    weighed = problem.count_inliers(models, mixed, threshold, weights)
    _expect(np.allclose(weighed, inliers @ weights), f"{name}.count_inliers does not add up the weights")


def _check_fits(problem: Problem, model: Array, rows: Array, zero: float) -> None:
    name, rng = type(problem).__name__, np.random.default_rng(2)
    weights = rng.uniform(0.1, 1.0, len(rows))
    few = np.zeros(len(rows))
    few[rng.choice(len(rows), problem.minimal_size, replace=False)] = 1.0
    beside = np.where(few[:, None] > 0.0, rows, problem.background(rows, len(rows), rng))
    cases = (
        ("weighted rows", rows, weights),
        ("as few rows as a minimal sample", rows, few),
        ("rows beside others without a weight", beside, few),
    )
    for what, table, chosen in cases:
        fitted = refitted(problem, model, table, chosen)
        largest = problem.residuals(fitted[None], rows[chosen > 0.0])[0].max() if np.isfinite(fitted).all() else 0.0
        _expect(bool(largest <= zero), f"{name}.refit to {what} leaves residuals up to {largest:.3g}")
    fitted = refitted(problem, model, rows, weights)
    _expect(bool(np.isfinite(fitted).all()), f"{name}.refit to exact rows gives no model")
    robust = problem.fit_robustly(model, rows, weights, 1e6 * zero, 5)
    largest = problem.residuals(robust[None], rows)[0].max()
    _expect(bool(largest <= zero), f"{name}.fit_robustly leaves residuals up to {largest:.3g}")
    noise = Noise.given(zero)
    _expect(problem.determined(fitted, rows, noise), f"{name}.determined is false for many exact rows")
    _expect(bool(problem.determined(problem.no_model, rows, noise)), f"{name}.determined is false for a model of NaN")


def _check_distance(problem: Problem, model: Array) -> None:
    name, models = type(problem).__name__, np.stack([model, _turned(model, 1), _turned(model, 2)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            table = np.asarray(problem.distance(models[:, None], models[None, :]))
            nowhere = problem.distance(model, problem.no_model)
        except Exception as error:
            raise _Refused(_raised(f"{name}.distance", error)) from error
    _expect(table.shape == (3, 3), f"{name}.distance does not broadcast: {table.shape} for (3, 1) and (1, 3) models")
    _expect(np.allclose(np.diag(table), 0.0, atol=1e-5), f"{name}.distance of a model to itself is not 0")
    _expect(bool((table != 0.0).any()), f"{name}.distance of different models is 0")
    _expect(np.allclose(table, table.T, equal_nan=True), f"{name}.distance is not symmetric")
    _expect(bool(np.isnan(nowhere).all()), f"{name}.distance to no model must be NaN")


def _check_average(problem: Problem, model: Array, rows: Array, zero: float) -> None:
    name, models = type(problem).__name__, np.stack([model] * 3)
    for given in (rows, rows[:0]):
        average = problem.average(models, given)
        _expect(np.shape(average) == np.shape(model), f"{name}.average gave a model of the shape {np.shape(average)}")
        largest = _residuals(problem, average[None], rows).max()
        _expect(bool(largest <= zero), f"{name}.average of three equal models is another one")


def _turned(model: Array, seed: int) -> Array:
    """Another model: the numbers of this one, moved a little."""
    return model + 0.01 * np.abs(model).max() * np.random.default_rng(seed).standard_normal(model.shape)


def _check_background(problem: Problem, rows: Array) -> None:
    name = type(problem).__name__
    first, second = (problem.background(rows, 500, np.random.default_rng(3)) for _ in range(2))
    _expect(first.shape == (500, problem.width), f"{name}.background gave {first.shape} instead of (500, D)")
    _expect(bool(np.isfinite(first).all()), f"{name}.background gave rows that are not finite")
    _expect(np.array_equal(first, second), f"{name}.background gives other rows for the same random numbers")


def _check_words(problem: Problem, model: Array, rows: Array, zero: float) -> None:
    name, noise = type(problem).__name__, Noise.given(max(zero, 1e-300))
    for case in problem.special_cases(model, rows, noise):
        _expect(isinstance(case, SpecialCase), f"{name}.special_cases gave a {type(case).__name__}")
        _expect(
            case.explains.shape == (len(rows),), f"{name}.special_cases: `explains` must have one value for each row"
        )
    T: Any = problem.transform(model)
    _expect(T is None or np.shape(T) == (4, 4), f"{name}.transform gave {np.shape(T)} instead of (4, 4)")
    covariance: Any = problem.covariance(model, rows, noise)
    square = covariance is None or (np.ndim(covariance) == 2 and len(set(np.shape(covariance))) == 1)
    _expect(square, f"{name}.covariance gave {np.shape(covariance)} instead of (p, p)")
    _expect(isinstance(problem.describe(model), str), f"{name}.describe must give a string")


def _estimated(estimator: Estimator, problem: Problem, rows: Rows, noise: Noise) -> Hypothesis:
    name = type(estimator).__name__
    found = estimator.estimate(problem, rows, noise, np.random.default_rng(0))
    _expect(isinstance(found, Hypothesis), f"{name}.estimate gave a {type(found).__name__}, not a nonsac.Hypothesis")
    shape = tuple(problem.model_shape)
    _expect(np.shape(found.model) == shape, f"{name}.estimate gave a model of {np.shape(found.model)}, not {shape}")
    return found


def _random_hypotheses(problem: Problem, rng: np.random.Generator) -> Sequence[Hypothesis]:
    """Six, of which one has no model and one no inlier."""
    models = rng.standard_normal((6, *problem.model_shape))
    models[2] = np.nan
    residuals = np.abs(rng.standard_normal((6, 50)))
    residuals[[2, 4]] = np.inf
    return [
        Hypothesis(model, each, 1.0, sample) for sample, (model, each) in enumerate(zip(models, residuals, strict=True))
    ]


def _check_taken(name: str, source: Source, wanted: NDArray[np.int64], table: Array) -> None:
    taken: Any = source.take(wanted)
    _expect(np.array_equal(taken, table[wanted].reshape(-1, table.shape[1])), f"{name} takes other rows than asked for")
    fresh = taken.dtype == np.float64 and taken.flags.c_contiguous and taken.flags.writeable
    _expect(fresh, f"{name}.take must give a fresh, writable, C-order float64 array")


def _check_chunks(name: str, chunks: list[Array], size: int, table: Array) -> None:
    fresh = all(c.dtype == np.float64 and c.flags.c_contiguous and c.flags.writeable for c in chunks)
    _expect(fresh, f"{name}.chunks must give fresh, writable, C-order float64 arrays")
    _expect(all(len(c) == size for c in chunks[:-1]), f"{name}.chunks({size}) gives chunks of other sizes")
    together = np.vstack([np.empty((0, table.shape[1])), *chunks])
    _expect(np.array_equal(together, table), f"{name}.chunks are not all rows in order")


def _refuses(source: Source, number: int) -> bool:
    try:
        source.take(np.array([number]))
    except IndexError:
        return True
    return False
