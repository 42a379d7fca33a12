"""Improving on the selected hypothesis, and judging what came out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, Self, runtime_checkable

import numpy as np

from nonsac.method.mixture import mixture_fit
from nonsac.method.noise import measured_noise
from nonsac.method.verdict import Residuals, Verdict, judge_rows
from nonsac.problems.contract import Problem, residual_dimension
from nonsac.problems.fits import biweight_costs, reweighted_fit
from nonsac.result import Alternative, Array, Hypothesis, Status, homogeneous

_NEARLY = 0.98
_COVARIANCE_ROWS = 5000
_RIVAL_ROWS, _NEARLY_AS_MUCH = 20_000, 0.8
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
    Where it has an attribute `all_rows` that is true, a trusted answer is fitted to all rows of the source in the end.
    Where it has a method `with_unknown_noise()`, what that gives refines where no noise was given.
    """

    def refine(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], winner: int, union: Rows, threshold: float
    ) -> Refinement: ...


@dataclass(frozen=True)
class AsSelected:
    """The selected hypothesis as it is, for studies of the rules; judged on the union of the samples."""

    known_noise: bool = True

    def with_unknown_noise(self) -> Self:
        return replace(self, known_noise=False)

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
    all_rows : bool
        Whether a trusted winner is then fitted to all rows of the source (`nonsac.method.full_pass`).
    known_noise : bool
        Whether the threshold is that of a known noise, which the verdict then makes use of.
    """

    candidates: int = 4
    iterations: int = 20
    polish_rows: int = 0
    all_rows: bool = False
    known_noise: bool = True
    joint: ClassVar[bool] = True

    def with_unknown_noise(self) -> Self:
        return replace(self, known_noise=False)

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
            best = reweighted_fit(problem, best, more, threshold, self.iterations)
        best = self._finished(problem, best, more, threshold)
        return judged(problem, hypotheses, best, more, threshold, self.known_noise)

    def _finished(self, problem: Problem, model: Array, rows: Array, threshold: float) -> Array:
        """The model after a last fit, at the noise that its inliers show; as it was, where they lose by that."""
        residuals = Residuals.of(problem, model, rows)
        noise = min(measured_noise(residuals, threshold, residual_dimension(problem)), threshold / 5.0)
        if not noise > 0.0:
            return model
        fitted = mixture_fit(problem, model, rows, residuals, noise)
        support = len(rows) - biweight_costs(problem, np.stack([model, fitted]), rows, threshold)
        return fitted if support[1] > _NEARLY * support[0] else model

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
    """The refiner with this name: "union", "polish", "full" or "none"."""
    refiners: dict[str, Refiner] = {
        "union": UnionRefit(),
        "polish": UnionRefit(polish_rows=100_000),
        "full": UnionRefit(polish_rows=30_000, all_rows=True),
        "none": AsSelected(),
    }
    if not isinstance(name, str) or name not in refiners:
        raise ValueError(f'refine must be "union", "polish", "full", "none" or a Refiner, got {name!r}')
    return refiners[name]


def judged(
    problem: Problem,
    hypotheses: Sequence[Hypothesis],
    model: Array,
    rows: Array,
    threshold: float,
    known_noise: bool = True,
) -> Refinement:
    """A model with its inliers among `rows`, what their noise is, and the verdict on it."""
    tested = sum(h.tested for h in hypotheses)
    residuals = Residuals.of(problem, model, rows)
    verdict = judge_rows(problem, model, rows, threshold, tested, known_noise, residuals)
    if verdict.status is Status.OK:
        verdict = _beside_rival(problem, hypotheses, residuals, rows, threshold, known_noise, verdict)
    noise = measured_noise(residuals, threshold, residual_dimension(problem))
    inliers = rows[residuals.of_rows < threshold]
    trusted = verdict.status in (Status.OK, Status.AMBIGUOUS)
    covariance = None
    weighted = hasattr(problem, "row_weights")  # a covariance would have to know what weights mean
    if hasattr(problem, "covariance") and trusted and not weighted:  # of some rows, as it falls with their number
        some = _some(inliers, _COVARIANCE_ROWS)
        covariance = problem.covariance(model, some, threshold) * (len(some) / len(inliers))
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


def _beside_rival(
    problem: Problem,
    hypotheses: Sequence[Hypothesis],
    residuals: Residuals,
    rows: Array,
    threshold: float,
    known_noise: bool,
    verdict: Verdict,
) -> Verdict:
    """The verdict in view of the best other answer, which must explain rows that this one does not, beyond chance.

    Another motion of the same scene is one. Where it has nearly as much support, nothing tells which is meant.
    """
    explained = residuals.of_rows < threshold
    rest = rows[~explained]
    some = _some(rest, _RIVAL_ROWS)
    models = np.stack([h.model for h in hypotheses if h.found])
    if len(some) <= problem.minimal_size:
        return verdict
    first = models[int(np.argmin(biweight_costs(problem, models, some, threshold)))]
    rival = reweighted_fit(problem, first, some, threshold, 20)
    if np.median(problem.residuals(rival[None], rows[explained])[0]) < 3.0 * threshold:
        return verdict  # the same answer, and inliers beyond the threshold
    tested = sum(h.tested for h in hypotheses)
    of_rival = Residuals.of(problem, rival, some)
    if judge_rows(problem, rival, some, threshold, tested, known_noise, of_rival).status is not Status.OK:
        return verdict
    share = of_rival.support(threshold) * len(rest) / len(rows)
    alternatives = (*verdict.alternatives, Alternative(homogeneous(rival), share))
    if share < _NEARLY_AS_MUCH * residuals.support(threshold):
        return replace(verdict, alternatives=alternatives)
    return replace(verdict, status=Status.AMBIGUOUS, confidence=min(verdict.confidence, 0.5), alternatives=alternatives)


def _some(rows: Array, most: int) -> Array:
    """A part of the rows, in their order, the same each time."""
    if len(rows) <= most:
        return rows
    return rows[np.sort(np.random.default_rng(len(rows)).choice(len(rows), most, replace=False))]


def _on_noise(ratio: float) -> tuple[str, ...]:
    """Where the measured noise is another than the given one."""
    if ratio > _VERY_DIFFERENT:
        return (f"noise is larger than given, by a factor of {ratio:.2g}",)
    if ratio < 1.0 / _VERY_DIFFERENT:
        return (f"noise is smaller than given, by a factor of {1.0 / max(ratio, 1e-9):.2g}",)
    return ()
