"""PROSAC: rows of the highest weight are drawn first, and the others come in by and by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.usac import Consensus, Sampler, Usac
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, background
from nonsac.values import special
from nonsac.values.numeric import as_real, as_whole, shown

_BACKGROUND = 1000
_NEVER = 2**62
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Progressive(Sampler):
    """Samples from ever larger sets of the rows with the highest weights (Chum and Matas, "Matching with PROSAC",
    CVPR 2005).

    The t-th sample holds the last row of the n(t) best ones, and others of them; n(t) grows so that after `horizon`
    samples all sets of rows have been drawn as often as RANSAC would have drawn them (Sec. 2.1). Weights are ranks:
    only their order matters for the drawing. Without weights there is no order; that of a file means nothing.

    The search ends when, in one of the sets of the best rows, the inliers of the best model are too many to be there by
    chance (non-randomness), and a larger number of them would have been found (maximality, Sec. 2.2). The share of
    inliers that a wrong model has, given as a constant in the paper, is measured on rows that no model holds for.

    Parameters
    ----------
    horizon : int
        T_N, 200,000 as published.
    chance : float
        Of inliers being there by chance, 0.05 as published.
    least : int
        Rows in the smallest set at which the search may end: 20, as in USAC. The chance is one for each set.
    """

    horizon: int = 200_000
    chance: float = 0.05
    least: int = 20

    def __post_init__(self) -> None:
        for name in ("horizon", "least"):
            whole = as_whole(getattr(self, name))
            if whole is None or whole < 1:
                raise ValueError(f"{name} must be a whole number of at least 1, got {shown(getattr(self, name))}")
        if not 0.0 < as_real(self.chance) < 1.0:
            raise ValueError(f"chance must be between 0 and 1, got {shown(self.chance)}")

    needs_weights = True

    def why_not(self, rows: Rows) -> str:
        return "PROSAC draws rows in the order of their weights, and these have none" if rows.weights is None else ""

    def draw(self, rows: Rows, size: int, before: int, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        ends = rows.kept(self, ("growth", size), lambda: growth(len(rows), size, self.horizon))
        best = size + np.searchsorted(ends, np.arange(before + 1, before + count + 1))
        drawn, growing = np.empty((count, size), np.int64), best <= len(rows)
        drawn[growing, -1] = best[growing] - 1
        drawn[growing, :-1] = _distinct_below(best[growing] - 1, size - 1, rng)
        drawn[~growing] = _distinct_below(np.full(np.count_nonzero(~growing), len(rows)), size, rng)
        return self._ranked(rows)[drawn]

    def needed(self, consensus: Consensus, model: Array, confidence: float) -> int:
        rows, problem = consensus.rows, consensus.problem
        some = background(problem, rows, _BACKGROUND)
        wrong = problem.residuals(model[None], some)[0] < consensus.threshold
        share = max(float(wrong.mean()), 1.0 / _BACKGROUND)
        inliers = np.cumsum((consensus.ratios(model) < 1.0)[self._ranked(rows)], dtype=np.int64)
        return samples_needed(inliers, problem.minimal_size, share, confidence, self.chance, self.least)

    def _ranked(self, rows: Rows) -> NDArray[np.int64]:
        """Row numbers, the highest weight first."""
        weights = np.zeros(len(rows)) if rows.weights is None else rows.weights
        return rows.kept(self, "ranked", lambda: np.argsort(-weights, kind="stable"))


def growth(rows: int, size: int, horizon: int) -> NDArray[np.int64]:
    """After how many samples the set of the n best rows is done, for n = size, ..., rows (T'_n, Sec. 2.1)."""
    best = np.arange(size, rows + 1)
    shares = np.ones(len(best))
    for i in range(size):
        shares *= (best - i) / (rows - i)
    return np.cumsum(np.concatenate([[1.0], np.ceil(np.diff(horizon * shares) - _ROUNDING)])).astype(np.int64)


def samples_needed(
    inliers: NDArray[np.int64], size: int, share: float, confidence: float, chance: float, least: int
) -> int:
    """The least number of samples that is enough in one of the sets of the best rows (Sec. 2.2).

    Parameters
    ----------
    inliers : (N,) int
        Of the best model, among the n best rows for n = 1, ..., N.
    size : int
        Rows of a minimal sample.
    share : float
        Of rows that are inliers of a wrong model.
    confidence : float
        With which a set with more inliers would have been found.
    chance : float
        Below which so many inliers are not there by chance (eq. 7 to 9).
    least : int
        Rows of the smallest set.
    """
    rows = np.arange(1, len(inliers) + 1)
    fair = (rows >= max(least, size + 1)) & (inliers > size)
    rows, inliers = rows[fair], inliers[fair]
    told = special.bdtrc(inliers - size - 1.0, rows - size, share) < chance
    rows, inliers = rows[told], inliers[told]
    if not len(rows):
        return _NEVER
    all_inliers = np.ones(len(rows))
    for j in range(size):
        all_inliers *= (inliers - j) / (rows - j)
    likeliest = float(all_inliers.max())
    if likeliest >= 1.0:
        return 1
    return int(min(np.ceil(np.log(1.0 - confidence) / np.log1p(-likeliest)), _NEVER))


def _distinct_below(tops: NDArray[np.int64], size: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """For each top, so many different numbers below it, all sets alike (Floyd's method; Bentley 1987)."""
    drawn = np.empty((len(tops), size), np.int64)
    for i in range(size):
        last = tops - size + i
        number = np.floor(rng.random(len(tops)) * (last + 1)).astype(np.int64)
        drawn[:, i] = np.where((drawn[:, :i] == number[:, None]).any(axis=1), last, number)
    return drawn


def prosac(problem: Problem) -> Usac:
    """PROSAC as published, by the number of inliers."""
    return Usac(sampler=Progressive())
