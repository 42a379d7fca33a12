"""Least squares made robust by degrees: from a fit to all rows to one that far rows have no part in."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from nonsac.estimators.contract import Estimator
from nonsac.estimators.ransac import gathered, minimal_samples
from nonsac.estimators.scores import Truncated
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, refitted, solved
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis
from nonsac.values.numeric import as_real, as_whole, shown

_BINARY = 1e-6


class Schedule(ABC):
    """How weights follow from residuals, and how they become robust; residuals are in units of the threshold."""

    @abstractmethod
    def first(self, largest: float) -> float:
        """The control with which all rows count nearly alike, if this is the largest of their squared residuals."""

    @abstractmethod
    def weights(self, squares: Array, control: float) -> Array:
        """The weights of rows with these squared residuals, from 0 to 1."""

    @abstractmethod
    def next(self, control: float, factor: float) -> float:
        """A control that is more robust by a factor, or as robust as it gets."""

    @abstractmethod
    def is_done(self, control: float, weights: Array, before: Array) -> bool:
        """Whether the fit with this control, and these weights after those before, was the last."""


@dataclass(frozen=True)
class TruncatedLeastSquares(Schedule):
    """GNC-TLS (Yang et al. 2020, eq. 14 and Remark 5): the control is mu, and grows until all weights are 0 or 1."""

    def first(self, largest: float) -> float:
        return 1.0 / max(2.0 * largest - 1.0, 1e-12)

    def weights(self, squares: Array, control: float) -> Array:
        lower, upper = control / (control + 1.0), (control + 1.0) / control
        between = np.sqrt(control * (control + 1.0) / np.clip(squares, lower, upper)) - control
        return np.where(squares <= lower, 1.0, np.where(squares >= upper, 0.0, np.clip(between, 0.0, 1.0)))

    def next(self, control: float, factor: float) -> float:
        return control * factor

    def is_done(self, control: float, weights: Array, before: Array) -> bool:
        return bool((np.minimum(weights, 1.0 - weights) < _BINARY).all())


@dataclass(frozen=True)
class GemanMcClure(Schedule):
    """GNC-GM (Yang et al. 2020, eq. 12 and Remark 5): the control is mu, and falls to 1."""

    def first(self, largest: float) -> float:
        return max(2.0 * largest, 1.0)

    def weights(self, squares: Array, control: float) -> Array:
        return np.square(control / (squares + control))

    def next(self, control: float, factor: float) -> float:
        return max(control / factor, 1.0)

    def is_done(self, control: float, weights: Array, before: Array) -> bool:
        return control <= 1.0


@dataclass(frozen=True)
class Shrinking(Schedule):
    """Reweighted least squares for a truncated loss, the truncation c of which shrinks to the threshold.

    min(r^2, c^2) is concave in r^2, so that a fit to the rows within c minimises a bound of it that touches it at the
    model before; and it falls with c. So the loss never rises: the argument of Peng, Kuemmerle and Vidal, "On the
    convergence of IRLS and its variants in outlier-robust estimation", CVPR 2023. The control is c^2.
    """

    def first(self, largest: float) -> float:
        return max(largest, 1.0)

    def weights(self, squares: Array, control: float) -> Array:
        return (squares <= control).astype(np.float64)

    def next(self, control: float, factor: float) -> float:
        return max(control / factor, 1.0)

    def is_done(self, control: float, weights: Array, before: Array) -> bool:
        return control <= 1.0 and np.array_equal(weights, before)


@dataclass(frozen=True)
class Graduated(Estimator):
    """Graduated non-convexity (Yang, Antonante, Tzoumas and Carlone, "Graduated non-convexity for robust spatial
    perception: from non-minimal solvers to global outlier rejection", RA-L 2020) over any problem's least-squares fit.

    It begins with the least-squares model of all rows; then weights and fits take turns while the loss becomes robust.
    Without samples, it is fast, and breaks down at about 70 to 80 % of outliers in registration (docs/cores.md), and
    sooner if the fit needs a start near the model: fits of camera poses do.

    Fits that need a start begin at the best of some minimal samples. Rows count by their weights.

    Parameters
    ----------
    schedule : Schedule
        How weights follow from residuals.
    factor : float
        Of the control from one fit to the next, above 1; 1.4 as published.
    starts : int
        Minimal samples, of which the one with the least truncated loss is where the first fit begins.
    most : int
        Fits at most.
    """

    schedule: Schedule
    factor: float = 1.4
    starts: int = 100
    most: int = 100

    def __post_init__(self) -> None:
        if not isinstance(self.schedule, Schedule):
            raise TypeError(f"schedule must be an object of a class derived from Schedule, got {shown(self.schedule)}")
        if not 1.0 < as_real(self.factor) < np.inf:
            raise ValueError(f"factor must be a number above 1, got {shown(self.factor)}")
        for name, least in (("starts", 1), ("most", 2)):
            whole = as_whole(getattr(self, name))
            if whole is None or whole < least:
                raise ValueError(f"{name} must be a whole number of at least {least}, got {shown(getattr(self, name))}")

    def estimate(self, problem: Problem, rows: Rows, noise: Noise, rng: np.random.Generator) -> Hypothesis:
        start, tested = self._start(problem, rows, noise.threshold, rng)
        model, fits = self._graduated(problem, start, rows, noise.threshold)
        found = np.isfinite(model).all()
        residuals = problem.residuals(model[None], rows.values)[0] if found else np.full(len(rows), np.inf)
        return Hypothesis(model if found else problem.no_model, residuals, noise.threshold, tested=tested + fits)

    def with_budget(self, factor: int) -> Self:
        return replace(self, starts=self.starts * factor)

    def _start(self, problem: Problem, rows: Rows, threshold: float, rng: np.random.Generator) -> tuple[Array, int]:
        """The best model of some minimal samples, and how many there were."""
        if len(rows) < problem.minimal_size:
            return problem.no_model, 0
        numbers = minimal_samples(len(rows), problem.minimal_size, self.starts, rng, rows.mean_weights)
        models = solved(problem, gathered(rows.values, numbers))
        best = Truncated().best(problem, models, rows, threshold) if len(models) else None
        return (problem.no_model if best is None else models[best[0]]), len(models)

    def _graduated(self, problem: Problem, start: Array, rows: Rows, threshold: float) -> tuple[Array, int]:
        """The last model of fits that become robust, and how many there were; NaN if one is not determined."""
        weights, control = np.ones(len(rows)), 0.0
        model = refitted(problem, start, rows.values, rows.times(weights))
        for fits in range(1, self.most):
            if not np.isfinite(model).all():
                return model, fits
            squares, before = np.square(problem.residuals(model[None], rows.values)[0] / threshold), weights
            finite, weights = np.isfinite(squares), np.zeros(len(rows))
            if fits == 1:
                control = self.schedule.first(float(squares[finite].max(initial=0.0)))
            else:
                control = self.schedule.next(control, self.factor)
            weights[finite] = self.schedule.weights(squares[finite], control)
            model = refitted(problem, model, rows.values, rows.times(weights))
            if self.schedule.is_done(control, weights, before):
                break
        return model, fits + 1


def gnc_tls(problem: Problem) -> Graduated:
    """Graduated non-convexity with truncated least squares."""
    return Graduated(TruncatedLeastSquares())


def gnc_gm(problem: Problem) -> Graduated:
    """Graduated non-convexity with Geman and McClure's loss."""
    return Graduated(GemanMcClure())


def irls(problem: Problem) -> Graduated:
    """Reweighted least squares with a truncation that shrinks."""
    return Graduated(Shrinking())
