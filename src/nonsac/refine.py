"""Improving on the selected hypothesis, and judging what came out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from nonsac.fitting import biweight_costs, reweighted_fit
from nonsac.noise import measured_noise
from nonsac.problems import Problem, residual_dimension
from nonsac.result import Alternative, Array, Hypothesis, Status, threshold_of
from nonsac.verdict import Residuals, judge_rows

_LARGER = 1.5
_VERY_DIFFERENT = 3.0


class Rows(Protocol):
    """Reads the rows that all samples hold together, each once, and as many more as are asked for."""

    def __call__(self, at_least: int = 0) -> Array: ...


@dataclass(frozen=True)
class Refinement:
    """The improved model, what supports it, and whether to trust it.

    `noise` and `threshold` are given where the refiner has its own, and `measured_noise` where it measured what the
    inliers show. `remarks` name special cases of the data, such as "planar".
    """

    model: Array
    status: Status
    confidence: float
    num_inliers: int
    num_rows: int
    alternatives: tuple[Alternative, ...] = ()
    noise: float | None = None
    threshold: float | None = None
    covariance: Array | None = None
    measured_noise: float | None = None
    remarks: tuple[str, ...] = ()


@runtime_checkable
class Refiner(Protocol):
    """Improves the winner, given all hypotheses and the union of their samples' rows.

    Where it has an attribute `joint` that is true, the last hypothesis comes from a joint search (see `Estimator`).
    """

    def refine(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], winner: int, union: Rows, threshold: float
    ) -> Refinement: ...


@dataclass(frozen=True)
class AsSelected:
    """The selected hypothesis as it is, for studies of the rules; judged on the union of the samples."""

    known_noise: bool = True

    def refine(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], winner: int, union: Rows, threshold: float
    ) -> Refinement:
        return judged(problem, hypotheses, hypotheses[winner].model, union(), threshold, self.known_noise)


@dataclass(frozen=True)
class UnionRefit:
    """Score the hypotheses on the union of all samples, fit the best few there, and keep the best fit.

    A hypothesis is thereby compared on rows that it was not fitted to. In the end the winner may be fitted to yet more
    rows, because that is where its accuracy comes from, and costs little.

    Parameters
    ----------
    candidates : int
        How many hypotheses are fitted.
    iterations : int
        Reweighted least-squares steps for each, at most.
    polish_rows : int
        Rows that the winner is fitted to in the end, at least; all rows where there are fewer.
    known_noise : bool
        Whether the threshold is that of a known noise, which the verdict then makes use of.
    """

    candidates: int = 4
    iterations: int = 20
    polish_rows: int = 0
    known_noise: bool = True
    joint: ClassVar[bool] = True

    def refine(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], winner: int, union: Rows, threshold: float
    ) -> Refinement:
        rows = union()
        models = np.stack([h.model for h in hypotheses if h.found])
        costs = biweight_costs(problem, models, rows, threshold)
        chosen = models[np.argsort(costs, kind="stable")[: self.candidates]]
        fitted = [reweighted_fit(problem, model, rows, threshold, self.iterations) for model in chosen]
        both = np.concatenate([chosen, np.stack(fitted)])
        best = both[int(np.argmin(biweight_costs(problem, both, rows, threshold)))]
        best = self._best_twin(problem, self._converged(problem, best, rows, threshold), rows, threshold)
        more = union(self.polish_rows)
        if len(more) > len(rows):
            best = self._converged(problem, best, more, threshold)
        residuals = Residuals.of(problem, best, more)
        noise = measured_noise(residuals, threshold, residual_dimension(problem))
        if threshold_of(noise) < threshold / _LARGER:  # rows between the two are no inliers, and only disturb
            best = self._converged(problem, best, more, max(threshold_of(noise), 1e-3 * threshold))
            residuals = Residuals.of(problem, best, more)
        return judged(problem, hypotheses, best, more, threshold, self.known_noise, residuals)

    def _best_twin(self, problem: Problem, model: Array, rows: Array, threshold: float) -> Array:
        """The model, or one of those that a special case of the data allows besides, whichever fits best."""
        if not hasattr(problem, "simpler_models"):
            return model
        for _ in range(3):
            inliers = rows[problem.residuals(model[None], rows)[0] < threshold]
            if len(inliers) < problem.minimal_size:
                break
            twins = [other for simpler in problem.simpler_models(model, inliers, threshold) for other in simpler.others]
            both = np.stack([model, *(self._converged(problem, twin, rows, threshold) for twin in twins)])
            best = int(np.argmin(biweight_costs(problem, both, rows, threshold)))
            if best == 0:
                break
            model = both[best]
        return model

    def _converged(self, problem: Problem, model: Array, rows: Array, threshold: float) -> Array:
        """The model fitted again, to the rows that are near it now, until that gains nothing."""
        cost = biweight_costs(problem, model[None], rows, threshold)[0]
        for _ in range(5):
            fitted = reweighted_fit(problem, model, rows, threshold, self.iterations)
            before, cost = cost, biweight_costs(problem, fitted[None], rows, threshold)[0]
            if not cost < before:
                break
            model = fitted
            if before - cost < 1e-6 * before:
                break
        return model


def by_name(name: object) -> Refiner:
    """The refiner with this name: "union", "polish" or "none"."""
    refiners: dict[str, Refiner] = {
        "union": UnionRefit(),
        "polish": UnionRefit(polish_rows=100_000),
        "none": AsSelected(),
    }
    if not isinstance(name, str) or name not in refiners:
        raise ValueError(f'refine must be "union", "polish", "none" or a Refiner, got {name!r}')
    return refiners[name]


def judged(
    problem: Problem,
    hypotheses: Sequence[Hypothesis],
    model: Array,
    rows: Array,
    threshold: float,
    known_noise: bool = True,
    residuals: Residuals | None = None,
) -> Refinement:
    """A model with its inliers among `rows`, what their noise is, and the verdict on it."""
    tested = sum(h.tested for h in hypotheses)
    residuals = residuals or Residuals.of(problem, model, rows)
    verdict = judge_rows(problem, model, rows, threshold, tested, known_noise, residuals)
    noise = measured_noise(residuals, threshold, residual_dimension(problem))
    inliers = rows[residuals.of_rows < threshold]
    trusted = verdict.status in (Status.OK, Status.AMBIGUOUS)
    covariance = None
    if hasattr(problem, "covariance") and trusted:
        covariance = problem.covariance(model, inliers, threshold)
    return Refinement(
        model,
        verdict.status,
        verdict.confidence,
        len(inliers),
        len(rows),
        alternatives=verdict.alternatives,
        covariance=covariance,
        measured_noise=noise,
        remarks=(*verdict.remarks, *(_on_noise(5.0 * noise / threshold) if trusted or verdict.remarks else ())),
    )


def _on_noise(ratio: float) -> tuple[str, ...]:
    """Where the measured noise is another than the given one."""
    if ratio > _VERY_DIFFERENT:
        return (f"noise is larger than given, by a factor of {ratio:.2g}",)
    if ratio < 1.0 / _VERY_DIFFERENT:
        return (f"noise is smaller than given, by a factor of {1.0 / max(ratio, 1e-9):.2g}",)
    return ()
