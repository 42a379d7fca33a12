"""PCR-99: three-point sampling ordered by pairwise consistency, prescreened by triplet consistency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.any_noise import Octaves
from nonsac.estimators.contract import Estimator
from nonsac.kernels.consistency import (
    count_consistent_distances,
    count_consistent_ratios,
    ranked_triplets,
    screened_triplets,
    sum_consistent_distances,
    sum_consistent_ratios,
)
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, solved
from nonsac.problems.fits import inlier_fit, reweighted_fit
from nonsac.problems.ladder import Ladder
from nonsac.problems.noise import Noise
from nonsac.problems.registration import Registration, centre
from nonsac.result import Hypothesis
from nonsac.values.numeric import as_real, as_whole, shown

_BATCH = 1000
_PROMISING = 10  # one in so many rows goes on to a joint search

# Consistent triplets, and how many were drawn to find them.
Triplets = Iterator[tuple[NDArray[np.int64], int]]


@dataclass(frozen=True)
class Pcr99(Estimator):
    """PCR-99 (Lee, Civera and Vandewalle, "PCR-99: a practical method for point cloud registration with 99 percent
    outliers", 2024) and the variants of it in the NONSAC paper, as settings of one class.

    Every row is scored by the number of other rows that it is pairwise consistent with. Triplets of rows are drawn
    best first, in order of the sum of their ranks, and only those whose three pairs are consistent become models.
    The model with the most inliers is refitted to them.

    The class methods give the published settings; no n x n matrix is ever held.

    Parameters
    ----------
    compare : "log_ratio" or "distance"
        Whether two rows are consistent when the logarithm of the ratio of their distances in the two clouds agrees
        (published; needed for an unknown scale), or when the distances themselves do (NONSAC, Sec. 4.3 and 4.4).
    order : "ranked" or "random"
        Triplets in order of rank sum, or uniformly at random.
    tolerance : float
        Of the consistency tests: of the log ratio, or a multiple of the inlier threshold for "distance".
    enough_inliers : float or None
        Stop when this share of the rows, and at least nine, are inliers. None never stops for it.
    refit : "weighted" or "once"
        After the least-squares fit to the winner's inliers, "weighted" goes on with reweighted fits (Tukey's biweight),
        which gives near rows more weight than those at the threshold; "once" stops there, as published.
    min_valid, max_valid, max_drawn : int
        Consistent triplets below which the search does not stop, at which it stops, and triplets drawn in all.
    rank : "count" or "sum"
        What a row is ranked by: the number of rows that it is consistent with; or the sum of the truncated differences
        of its log ratios or distances, as PCR-99's authors do.
    """

    compare: Literal["log_ratio", "distance"] = "log_ratio"
    order: Literal["ranked", "random"] = "ranked"
    tolerance: float = 0.1
    enough_inliers: float | None = 0.009
    refit: Literal["weighted", "once"] = "weighted"
    min_valid: int = 0
    max_valid: int = 100_000
    max_drawn: int = 10_000_000
    rank: Literal["count", "sum"] = "count"

    def __post_init__(self) -> None:
        for name in ("compare", "order", "rank", "refit"):
            if not isinstance(getattr(self, name), str):
                raise ValueError(f"{name} must be a word, got {shown(getattr(self, name))}")
        if self.compare not in ("log_ratio", "distance"):
            raise ValueError(f'compare must be "log_ratio" or "distance", got {self.compare!r}')
        if self.order not in ("ranked", "random"):
            raise ValueError(f'order must be "ranked" or "random", got {self.order!r}')
        if self.rank not in ("count", "sum"):
            raise ValueError(f'rank must be "count" or "sum", got {self.rank!r}')
        if self.refit not in ("weighted", "once"):
            raise ValueError(f'refit must be "weighted" or "once", got {self.refit!r}')
        if not 0 < as_real(self.tolerance) < np.inf:
            raise ValueError(f"tolerance must be positive, got {shown(self.tolerance)}")
        object.__setattr__(self, "tolerance", as_real(self.tolerance))  # other types would compile the kernels anew
        if self.enough_inliers is not None and not as_real(self.enough_inliers) >= 0:
            raise ValueError(f"enough_inliers must be None or a share of the rows, got {shown(self.enough_inliers)}")
        for name, least in (("min_valid", 0), ("max_valid", 1), ("max_drawn", 1)):
            number = as_whole(getattr(self, name))
            if number is None or number < least:
                raise ValueError(f"{name} must be a whole number of at least {least}, got {shown(getattr(self, name))}")
            object.__setattr__(self, name, number)

    @classmethod
    def for_pairs(cls) -> Pcr99:
        """The variant of Sec. 4.3: distances; 1,000 consistent or 10,000 drawn triplets."""
        return cls("distance", tolerance=0.4, enough_inliers=None, max_valid=1000, max_drawn=10_000)

    @classmethod
    def for_all_pairs(cls) -> Pcr99:
        """The variant of Sec. 4.4: distances; at least 0.09 % inliers and 1,000 consistent triplets."""
        return cls("distance", tolerance=0.4, enough_inliers=0.0009, min_valid=1000, max_valid=5000)

    def with_budget(self, factor: int) -> Self:
        """As in the paper's footnote: more triplets are drawn, but no more consistent ones are asked for."""
        return replace(self, max_drawn=self.max_drawn * factor)

    def check(self, problem: Problem) -> None:
        self._registration(problem)

    def _registration(self, problem: Problem) -> Registration:
        if not isinstance(problem, Registration):
            raise TypeError(f"Pcr99 estimates 3D registrations only, got {type(problem).__name__}")
        if self.compare == "distance" and problem.scale is None:
            raise ValueError('Pcr99 with compare="distance" needs a known scale; use compare="log_ratio"')
        return problem

    def estimate(self, problem: Problem, rows: Rows, noise: Noise, rng: np.random.Generator) -> Hypothesis:
        hypothesis, ranks = self._estimated(self._registration(problem), rows, noise.threshold, rng)
        return hypothesis if ranks is None else _with_promising(hypothesis, rows, ranks)

    def _estimated(
        self, problem: Registration, rows: Rows, threshold: float, rng: np.random.Generator
    ) -> tuple[Hypothesis, Array | None]:
        """The best model, and by what the rows were ranked, which can be compared with that of other samples."""
        # In units of the threshold, so that single precision serves any unit.
        columns = np.ascontiguousarray((rows.values - centre(rows.values)).T / threshold)
        if problem.scale is None:
            columns[:3] *= _size(columns[3:]) / _size(columns[:3])  # ratios are sought within e^4 of 1
        ranks = None if self.order == "random" else self._rank_scores(columns, problem)
        if ranks is not None and rows.mean_weights is not None:
            ranks *= rows.mean_weights
        triplets = self._triplets(problem, columns, ranks, rng)
        hypothesis = self._found(problem, rows, threshold, *self._search(problem, rows, threshold, triplets))
        return hypothesis, None if ranks is None else _standardised(ranks)

    def estimate_at_any_noise(self, problem: Problem, rows: Rows, rng: np.random.Generator) -> Hypothesis | None:
        """The model and the threshold that are together least likely by chance, of some thresholds to search with."""
        ladder = None if rows.weights is not None else Ladder.of(problem, rows, rng)
        if ladder is None:
            return None
        octaves = Octaves(problem, rows, ladder, lambda model, threshold: model)
        registration, tested, most = self._registration(problem), 0, np.full(len(rows), -np.inf)
        for threshold in ladder.coarse():
            found, ranks = self._estimated(registration, rows, threshold, rng)
            tested += found.tested or 0
            most = most if ranks is None else np.maximum(most, ranks)
            if found.found:
                octaves.keep(found.model)
        chosen = octaves.chosen()
        if chosen is None:
            return None
        model, threshold, score = chosen
        residuals = problem.residuals(model[None], rows.values)[0]
        hypothesis = Hypothesis(model, residuals, threshold, tested=tested, log_chance=-score)
        return hypothesis if self.order == "random" else _with_promising(hypothesis, rows, most)

    def search_jointly(
        self,
        problem: Problem,
        hypotheses: Sequence[Hypothesis],
        rows: Rows,
        noise: Noise,
        rng: np.random.Generator,
    ) -> Hypothesis | None:
        """The best model of the rows that are consistent with the most others in their samples, as many as in one.

        A sample with too few right rows still ranks them higher than most others.
        """
        pool = _most_promising(hypotheses)
        return None if pool is None else self._thorough.estimate(problem, pool, noise, rng)

    def search_jointly_at_any_noise(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], rng: np.random.Generator
    ) -> Hypothesis | None:
        """The same, of rows that are consistent with many others at some threshold."""
        pool = _most_promising(hypotheses)
        return None if pool is None else self._thorough.estimate_at_any_noise(problem, pool, rng)

    @property
    def _thorough(self) -> Pcr99:
        return replace(self, max_valid=3 * self.max_valid, max_drawn=3 * self.max_drawn)

    def _found(self, problem: Problem, rows: Rows, threshold: float, model: Array, tested: int) -> Hypothesis:
        """The hypothesis after a fit to the rows near a model."""
        if not np.isfinite(model).all():
            return Hypothesis(model, np.full(len(rows), np.inf), threshold, tested=tested)
        model = inlier_fit(problem, model, rows, threshold)
        if self.refit == "weighted":
            model = reweighted_fit(problem, model, rows, threshold, 10)
        return Hypothesis(model, problem.residuals(model[None], rows.values)[0], threshold, tested=tested)

    def _search(self, problem: Problem, rows: Rows, threshold: float, batches: Triplets) -> tuple[Array, int]:
        """The model with the most inliers, and how many triplets were looked at.

        Those that are not consistent count, too: a model was chosen over them.
        """
        best_model, best_count, valid, looked_at = problem.no_model, 0, 0, 0
        for triplets, drawn in batches:
            models = solved(problem, rows.values[triplets])
            if len(models):
                counts = problem.count_inliers(models, rows.values, threshold, rows.mean_weights)
                first = int(np.argmax(counts))
                if counts[first] > best_count:
                    best_model, best_count = models[first], counts[first]
            valid, looked_at = valid + len(triplets), looked_at + drawn
            if valid >= self.max_valid or (valid >= self.min_valid and self._enough(float(best_count), len(rows))):
                break
        return best_model, looked_at

    def _enough(self, inliers: float, rows: int) -> bool:
        return self.enough_inliers is not None and inliers >= max(9, self.enough_inliers * rows)

    def _triplets(
        self, problem: Registration, columns: Array, ranks: Array | None, rng: np.random.Generator
    ) -> Triplets:
        """Batches of consistent triplets of row numbers, (T, 3) each, in the order in which they are drawn."""
        screen = (self.compare == "log_ratio", problem.scale is not None, problem.scale or 1.0, self.tolerance)
        if ranks is None:
            yield from self._random_triplets(columns, screen, rng)
            return
        ranked = np.argsort(-ranks, kind="stable")
        columns = np.ascontiguousarray(columns[:, ranked])
        state = np.array([3, 0, 1, 0], np.int64)
        while True:
            found, before = np.empty((min(_BATCH, self.max_valid), 3), np.int64), state[3]
            count = ranked_triplets(columns, *screen, self.max_drawn, state, found)
            yield ranked[found[:count]], int(state[3] - before)
            if count < len(found):
                return

    def _random_triplets(
        self, columns: Array, screen: tuple[bool, bool, float, float], rng: np.random.Generator
    ) -> Triplets:
        n = columns.shape[1]
        drawn = 0
        while drawn < self.max_drawn:
            batch = rng.integers(n, size=(min(100 * _BATCH, self.max_drawn - drawn), 3))
            drawn += len(batch)
            found = np.empty_like(batch)
            # A row drawn twice has no distance to itself and is screened out.
            count = screened_triplets(columns, batch, *screen, found)
            for start in range(0, max(count, 1), _BATCH):
                yield found[start : min(start + _BATCH, count)], len(batch) if start == 0 else 0

    def _rank_scores(self, columns: Array, problem: Registration) -> Array:
        """With how many others each row is consistent, or by how much."""
        scale, by_distance = problem.scale or 1.0, self.compare == "distance"
        if self.rank == "sum":
            sums = np.empty(columns.shape[1])
            if by_distance:
                scaled = columns * np.array([scale] * 3 + [1.0] * 3)[:, None]
                sum_consistent_distances(scaled, self.tolerance, sums)
            else:
                sum_consistent_ratios(columns, problem.scale is not None, np.log(scale), self.tolerance, sums)
            return sums
        counts = np.empty(columns.shape[1], np.int32)
        if by_distance:
            shared = columns.astype(np.float32)
            shared[:3] *= np.float32(scale)
            count_consistent_distances(shared, np.float32(self.tolerance), counts)
        else:
            count_consistent_ratios(columns, problem.scale is not None, np.log(scale), self.tolerance, counts)
        return counts.astype(np.float64)


def default(problem: Problem) -> Pcr99:
    """The paper's variant of PCR-99 (Sec. 4.3), or the published one if the scale is free."""
    free = isinstance(problem, Registration) and problem.scale is None
    return Pcr99() if free else Pcr99.for_pairs()


def _standardised(scores: Array) -> Array:
    """Scores that can be compared between samples and thresholds: a few consistent rows are many for the finest."""
    return (scores - scores.mean()) / max(scores.std(), 1.0)


def _with_promising(hypothesis: Hypothesis, rows: Rows, scores: Array) -> Hypothesis:
    """With the rows of the highest scores."""
    first = np.argsort(-scores, kind="stable")[: max(3, len(rows) // _PROMISING)]
    return replace(hypothesis, promising=rows[first], rank_scores=scores[first])


def _most_promising(hypotheses: Sequence[Hypothesis]) -> Rows | None:
    """The rows of the highest scores in several samples, as many as in one."""
    ranked = [(h.promising, h.rank_scores) for h in hypotheses if h.promising is not None]
    if not ranked:
        return None
    scores = np.concatenate([scores for _, scores in ranked])
    size = max(len(h.residuals) for h in hypotheses)
    return Rows.joined([promising for promising, _ in ranked])[np.argsort(-scores, kind="stable")[:size]]


def _size(columns: Array) -> float:
    """Median distance of points (3, N) from their middle, the origin; 1 if more than half of them are there."""
    size = float(np.median(np.linalg.norm(columns, axis=0)))
    return size if size > 0.0 else 1.0
