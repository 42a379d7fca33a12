"""The paper's rules for choosing one of m hypotheses (Lee, Vandewalle and Civera, Sec. 3.2), and one by averaging.

A rule gives every hypothesis a score, the larger the better, and the best one is selected; ties go to the earlier
sample. Two slips in the paper's text are resolved as its formulas and results imply: the pair cost is *maximised*,
and the sum of the TLP cost runs over the rows of the hypothesis' own sample.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.contract import Estimator
from nonsac.layouts import Array
from nonsac.method.averaging import AVERAGES, check_kind
from nonsac.problems.contract import ContractBroken, Problem
from nonsac.result import Hypothesis


class ScoringRule(ABC):
    """Scores hypotheses against each other; the highest score wins. Derive a class from it to add a rule.

    `name` and `scores` are needed; `plan` has a default.
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """How the rule is called in files and on the command line."""

    @abstractmethod
    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        """One score for each hypothesis, -inf for those that must not win."""

    def plan(self, samples: int | None, estimator: Estimator) -> tuple[int | None, Estimator]:
        """How many samples to draw, and the estimator for each; `samples` is None for samples="auto".

        By default as they are; a rule that spends the budget in its own way, as `FixedSample` does, changes them.
        """
        return samples, estimator


def select(rule: ScoringRule, hypotheses: Sequence[Hypothesis], problem: Problem) -> tuple[int, Array]:
    """The best hypothesis' index and the scores of all; hypotheses without a model never beat one with."""
    scores = np.array(rule.scores(hypotheses, problem), np.float64)
    if scores.shape != (len(hypotheses),):
        raise ContractBroken(
            f"{type(rule).__name__}.scores gave the shape {scores.shape} for {len(hypotheses)} hypotheses: return one "
            "number for each"
        )
    found = np.array([h.found for h in hypotheses])
    scores[~found | np.isnan(scores)] = -np.inf
    if not np.isfinite(scores).any() and found.any():  # no pair or no inliers to go by
        scores[found] = _inlier_counts(hypotheses)[found]
    return int(np.argmax(scores)), scores


@dataclass(frozen=True)
class Ideal(ScoringRule):
    """The hypothesis closest to the truth: for studies, as an upper bound of what selection can reach."""

    truth: Array
    name: str = "ideal"

    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        errors = problem.distance(_models(hypotheses), self.truth[:3] if self.truth.shape == (4, 4) else self.truth)
        return np.nan_to_num(-errors, nan=-np.inf)


@dataclass(frozen=True)
class MostInliers(ScoringRule):
    """The hypothesis with the most inliers in its own sample."""

    name: str = "most_inliers"

    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        return _inlier_counts(hypotheses)


@dataclass(frozen=True)
class FixedSample(ScoringRule):
    """One sample only, searched with the budget of all m: a way of sampling rather than a rule (Sec. 3.2, item 2)."""

    name: str = "fixed"

    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        return _inlier_counts(hypotheses)

    def plan(self, samples: int | None, estimator: Estimator) -> tuple[int | None, Estimator]:
        """One sample, and the estimator with `samples` times the budget."""
        if samples is None:
            raise ValueError("samples must be a number with the rule fixed, which spends their budget on one sample")
        return 1, estimator.with_budget(samples)


@dataclass(frozen=True)
class ClosestPair(ScoringRule):
    """Of the two models closest to each other, the one with more inliers."""

    name: str = "closest_pair"

    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        distances = _distances(hypotheses, problem)
        best = np.unravel_index(np.argmin(distances), distances.shape)
        return _restricted(_inlier_counts(hypotheses), best)


@dataclass(frozen=True)
class ClosestTriplet(ScoringRule):
    """Of the three models with the smallest largest distance between two of them, the one with the most inliers."""

    name: str = "closest_triplet"

    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        counts = _inlier_counts(hypotheses)
        m = len(hypotheses)
        if m < 3:
            return counts
        distances = _distances(hypotheses, problem)
        largest = np.full((m, m, m), np.inf)
        i, j, k = (index.ravel() for index in np.meshgrid(*[np.arange(m)] * 3, indexing="ij"))
        ordered = (i < j) & (j < k)
        i, j, k = i[ordered], j[ordered], k[ordered]
        largest[i, j, k] = np.maximum(np.maximum(distances[i, j], distances[i, k]), distances[j, k])
        return _restricted(counts, np.unravel_index(np.argmin(largest), largest.shape))


@dataclass(frozen=True)
class MinimumQuantile(ScoringRule):
    """The smallest quantile of the inlier residuals: 0.5 is the median, 0.75 the upper quartile."""

    quantile: float

    @property
    def name(self) -> str:
        known = {0.5: "minimum_median", 0.75: "minimum_q3"}
        return known.get(self.quantile, f"minimum_quantile_{self.quantile:g}")

    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        inliers = [h.inlier_residuals for h in hypotheses]
        return np.array([-np.quantile(r, self.quantile) if r.size else -np.inf for r in inliers])


@dataclass(frozen=True)
class MinimumMean(ScoringRule):
    """The smallest mean of the inlier residuals."""

    name: str = "minimum_mean"

    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        inliers = [h.inlier_residuals for h in hypotheses]
        return np.array([-r.mean() if r.size else -np.inf for r in inliers])


@dataclass(frozen=True)
class PairCost(ScoringRule):
    """Of the pair (i, j) that maximises max(n_i, n_j) / d_ij^k, the model with more inliers (Eq. 1).

    Two equal models (d = 0) win over all pairs of unequal ones; among several such pairs the inliers decide.
    """

    k: float

    @property
    def name(self) -> str:
        return f"pair_{self.k:g}"

    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        counts = _inlier_counts(hypotheses)
        distances = _distances(hypotheses, problem)
        with np.errstate(divide="ignore"):
            logs = np.log(np.maximum(counts[:, None], counts[None, :]))
        costs = logs - self.k * np.log(np.maximum(distances, np.finfo(np.float64).tiny))
        best = np.unravel_index(np.argmax(costs), costs.shape)
        return _restricted(counts, best)


@dataclass(frozen=True)
class TruncatedLp(ScoringRule):
    """The smallest sum of min(|r|^p, threshold^p) over the rows of the hypothesis' own sample (Eq. 2)."""

    p: float = 0.1

    @property
    def name(self) -> str:
        return f"tlp_{self.p:g}"

    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        rows = max(len(h.residuals) for h in hypotheses)
        return -np.array([self._cost(h, rows) for h in hypotheses])

    def _cost(self, h: Hypothesis, rows: int) -> float:
        """Rows that a sample lacks count as outliers, as residuals of NaN do."""
        truncated = np.fmin(np.abs(h.residuals), h.threshold) ** self.p
        return float(truncated.sum() + (rows - len(truncated)) * h.threshold**self.p)


@dataclass(frozen=True)
class NearestToAverage(ScoringRule):
    """The hypothesis nearest to a robust average of all of them (none of the paper's rules, but of its Table 1).

    Hypotheses are held against each other only, never against rows. With refine="average" the answer is the average
    itself.

    Parameters
    ----------
    kind : "l1", "trimmed" or "truncated"
        Which average (see `nonsac.method.averaging`).
    """

    kind: str = "truncated"

    def __post_init__(self) -> None:
        check_kind(self.kind)

    @property
    def name(self) -> str:
        return f"{self.kind}_average"

    def scores(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
        models, found = _models(hypotheses), np.array([h.found for h in hypotheses])
        if not found.any():
            return np.full(len(models), -np.inf)
        average = AVERAGES[self.kind](problem, models[found], np.empty((0, problem.width)))
        return np.nan_to_num(-problem.distance(models, average[None]), nan=-np.inf)


PAIR_COST_EXPONENTS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
TRUNCATED_LP_EXPONENTS = (0.01, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)


def paper_rules() -> tuple[ScoringRule, ...]:
    """The rules of Table 3, rows 2 to 20, in its order (row 1 is `Ideal`, which needs the truth)."""
    return (
        MostInliers(),
        ClosestPair(),
        ClosestTriplet(),
        MinimumMean(),
        MinimumQuantile(0.5),
        MinimumQuantile(0.75),
        *(PairCost(k) for k in PAIR_COST_EXPONENTS),
        *(TruncatedLp(p) for p in TRUNCATED_LP_EXPONENTS),
    )


def by_name(name: object) -> ScoringRule:
    """The rule with this name in files and on the command line: `most_inliers`, `pair_0.1`, `tlp_0.1`, ..."""
    named = (*paper_rules(), FixedSample(), *map(NearestToAverage, AVERAGES))
    for rule in named:
        if isinstance(name, str) and rule.name == name:
            return rule
    kind, _, exponent = str(name).partition("_")
    if kind in ("pair", "tlp"):
        try:
            value = float(exponent)
        except ValueError:
            value = float("nan")
        if 0 < value < float("inf"):
            return PairCost(value) if kind == "pair" else TruncatedLp(value)
    known = ", ".join(rule.name for rule in named)
    raise ValueError(f"rule must be one of {known} or a rule object, got {name!r}")


def scored(hypotheses: Sequence[Hypothesis], scores: Array) -> tuple[Hypothesis, ...]:
    return tuple(replace(h, score=float(s)) for h, s in zip(hypotheses, scores, strict=True))


def _models(hypotheses: Sequence[Hypothesis]) -> Array:
    return np.stack([h.model for h in hypotheses])


def _inlier_counts(hypotheses: Sequence[Hypothesis]) -> Array:
    return np.array([h.num_inliers for h in hypotheses], np.float64)


def _distances(hypotheses: Sequence[Hypothesis], problem: Problem) -> Array:
    """Distances between all models (m, m); infinite to themselves and to hypotheses without a model."""
    models = _models(hypotheses)
    distances = problem.distance(models[:, None], models[None, :])
    distances = np.where(np.isfinite(distances), distances, np.inf)
    np.fill_diagonal(distances, np.inf)
    return distances


def _restricted(scores: Array, allowed: Sequence[Any] | NDArray[np.intp]) -> Array:
    """The scores of the allowed hypotheses, -inf for the others."""
    result = np.full_like(scores, -np.inf)
    indices = np.asarray(allowed)
    result[indices] = scores[indices]
    return result
