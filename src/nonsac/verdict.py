"""Whether an answer is to be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from nonsac.problems import Problem
from nonsac.result import Array, Status

_LARGEST_CHANCE = 1e-6
_SHUFFLED_ROWS = 20_000


@dataclass(frozen=True)
class Verdict:
    status: Status
    confidence: float


def judge_rows(problem: Problem, model: Array, rows: Array, threshold: float, tested: int) -> Verdict:
    """Could a model with this many inliers come up by chance, and do its inliers determine it?

    The chance level is measured on the same rows with their pairing shuffled: the marginal distributions stay, the
    matches are gone. The number of inliers beyond a minimal sample, under a binomial law with that rate and
    corrected for the number of models that were compared (Bonferroni), gives the probability that data without
    any matches would have produced such an answer. The confidence is one minus it.
    """
    inliers = problem.residuals(model[None], rows)[0] < threshold
    trials = len(rows) - problem.minimal_size
    beyond = int(inliers.sum()) - problem.minimal_size
    if beyond <= 0:
        return Verdict(Status.LOW_SUPPORT, 0.0)
    if not problem.determined(model, rows[inliers], threshold):
        return Verdict(Status.DEGENERATE, 0.0)
    rate = chance_rate(problem, model, rows, threshold)
    chance = float(np.exp(min(0.0, binom.logsf(beyond - 1, trials, rate) + np.log(max(tested, 1)))))
    return Verdict(Status.OK if chance < _LARGEST_CHANCE else Status.LOW_SUPPORT, 1.0 - chance)


def chance_rate(problem: Problem, model: Array, rows: Array, threshold: float) -> float:
    """Share of inliers among the rows when no row keeps its own second half; half a count is added to be safe."""
    n = len(rows)
    rng = np.random.default_rng(n)
    repeats = max(8, _SHUFFLED_ROWS // n)
    hits = 0
    for _ in range(repeats):
        order = rng.permutation(n)
        partner = np.empty(n, np.int64)
        partner[order] = np.roll(order, 1)
        shuffled = np.hstack([rows[:, : problem.split], rows[partner, problem.split :]])
        hits += int((problem.residuals(model[None], shuffled)[0] < threshold).sum())
    return (hits + 0.5) / (repeats * n + 1)


def judge_overlap(support: int, others: np.ndarray, total: int) -> Verdict:
    """Do enough points of two raw clouds coincide, and do clearly fewer coincide under any other answer?

    Parameters
    ----------
    support : int
        Points, of both clouds, that lie in the other cloud's surface.
    others : (k,) int
        The same for clearly different answers, best first.
    total : int
        Points of both clouds.
    """
    share = support / total
    runner_up = float(others[0]) / max(support, 1) if len(others) else 0.0
    if share < 0.1:
        return Verdict(Status.LOW_SUPPORT, 0.0)
    if runner_up > 0.85:
        return Verdict(Status.AMBIGUOUS, 0.0)
    return Verdict(Status.OK, 1.0 - runner_up)
