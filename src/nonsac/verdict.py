"""Whether an answer is to be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import betainc

from nonsac.problems import Problem
from nonsac.result import Array, Status

_LARGEST_CHANCE = 1e-6
_SHUFFLED_ROWS = 40_000


@dataclass(frozen=True)
class Verdict:
    status: Status
    confidence: float


def judge_rows(problem: Problem, model: Array, rows: Array, threshold: float, tested: int) -> Verdict:
    """Could a model with this many inliers come up by chance, and do its inliers determine it?

    The chance level is measured on the same rows with their pairing shuffled: the marginal distributions stay, the
    matches are gone. The number of inliers beyond a minimal sample, under a binomial law with that rate and
    corrected for the number of models that were compared (Bonferroni), gives the probability that data without
    any matches would have produced such an answer; below one in a million it is trusted. Inliers that share a point
    count once, because they are no independent evidence. The confidence is 0.5 at that bound and approaches 1 with
    the logarithm of the probability; it orders answers, and is not calibrated yet.
    """
    inliers = problem.residuals(model[None], rows)[0] < threshold
    trials = len(rows) - problem.minimal_size
    beyond = _distinct_count(problem, rows[inliers]) - problem.minimal_size
    if beyond <= 0:
        return Verdict(Status.LOW_SUPPORT, 0.0)
    if not problem.determined(model, rows[inliers], threshold):
        return Verdict(Status.DEGENERATE, 0.0)
    rate = chance_rate(problem, model, rows, threshold)
    tail = float(betainc(beyond, trials - beyond + 1, rate))  # of the binomial law: P(X >= beyond)
    chance = min(1.0, tail * max(tested, 1))
    confidence = 1.0 - float(chance ** (np.log(0.5) / np.log(_LARGEST_CHANCE)))
    return Verdict(Status.OK if chance < _LARGEST_CHANCE else Status.LOW_SUPPORT, confidence)


def _distinct_count(problem: Problem, rows: Array) -> int:
    """Rows that do not share a point with another one, in either half."""
    halves = (rows[:, : problem.split], rows[:, problem.split :])
    return min(len(np.unique(half, axis=0)) for half in halves)


def chance_rate(problem: Problem, model: Array, rows: Array, threshold: float) -> float:
    """Share of inliers among the rows when no row keeps its own second half; half a count is added to be safe."""
    n = len(rows)
    rng = np.random.default_rng(n)
    repeats = -(-_SHUFFLED_ROWS // n)
    hits = 0
    for _ in range(repeats):
        order = rng.permutation(n)
        shuffled = rows[order]
        shuffled[:, problem.split :] = np.roll(shuffled[:, problem.split :], 1, axis=0)
        hits += int((problem.residuals(model[None], shuffled)[0] < threshold).sum())
    return (hits + 0.5) / (repeats * n + 1)


def judge_overlap(support: int, others: np.ndarray, total: int, surfaces: bool = True) -> Verdict:
    """Do enough points of two raw clouds coincide, and do clearly fewer coincide under any other answer?

    An answer is trusted where at least 15 % of the points support it, and the best clearly different answer has
    less than 0.85 of its support; less is allowed below a share of 0.22, where even unrelated clouds may meet. The
    bounds lie between right and wrong answers on real scans (`docs/verdict.md`). The confidence falls from 1 without
    any other answer to 0.5 at the bound; it orders answers, and is not calibrated yet.

    Parameters
    ----------
    support : int
        Points, of both clouds, that lie in the other cloud's surface.
    others : (k,) int
        The same for clearly different answers, best first.
    total : int
        Points of both clouds.
    surfaces : bool
        Whether both clouds are surfaces at all; if not, their normals and this comparison mean nothing.
    """
    share = support / total
    if share < 0.15 or not surfaces:
        return Verdict(Status.LOW_SUPPORT, 0.0)
    runner_up = float(others[0]) / support if len(others) else 0.0
    allowed = 0.85 - 4.0 * max(0.0, 0.22 - share)
    if runner_up <= allowed:
        return Verdict(Status.OK, 1.0 - 0.5 * (runner_up / allowed) ** 4)
    confidence = 0.5 * (allowed / runner_up) ** 4
    return Verdict(Status.LOW_SUPPORT if share < 0.22 else Status.AMBIGUOUS, confidence)
