"""Whether an answer is to be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, chdtr, ndtr

from nonsac.problems.contract import Problem, residual_dimension
from nonsac.result import Alternative, Array, Status, homogeneous

_LARGEST_CHANCE = 1e-6
_CLEAR_LEAD = 4.0


@dataclass(frozen=True)
class Verdict:
    """Whether to trust an answer, the answers that the same rows allow besides, and special cases for `info`."""

    status: Status
    confidence: float
    alternatives: tuple[Alternative, ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Residuals:
    """Of all rows, and of the same rows paired at random, for one model."""

    of_rows: Array
    by_chance: Array

    @classmethod
    def of(cls, problem: Problem, model: Array, rows: Array) -> Residuals:
        return cls(problem.residuals(model[None], rows)[0], chance_residuals(problem, model, rows))

    def support(self, threshold: float) -> float:
        """Share of the rows that are inliers beyond chance."""
        return np.count_nonzero(self.of_rows < threshold) / len(self.of_rows) - chance_rate(self.by_chance, threshold)


def judge_rows(
    problem: Problem,
    model: Array,
    rows: Array,
    threshold: float,
    tested: int,
    known_noise: bool = True,
    residuals: Residuals | None = None,
) -> Verdict:
    """Could a model with this many inliers come up by chance, or as a model that is right in part only?

    *Chance.* The chance level is measured on the same rows with their pairing shuffled: the marginal distributions
    stay, the matches are gone. The number of inliers beyond a minimal sample, under a binomial law with that rate and
    corrected for the number of models that were compared (Bonferroni), gives the probability that data without
    any matches would have produced such an answer; it must be below one in a million. Inliers that share a point
    count once, because they are no independent evidence.

    *Part of the truth.* A model near a wrong optimum has many true matches within the threshold, too, but these are
    spread over it, where those of the right model keep within two standard deviations of the noise. Either the inliers
    beyond chance show this, where the noise is known, or the search was so long that a better model, of which every
    minimal sample of true matches is a start, would have come up (`_certainty_of_search`).

    The confidence is the lesser of both, 0.5 at either bound. The first test is applied, too, to the inliers that a
    simpler model (a rotation without a baseline, a planar scene) does not explain. Where they are no more than chance,
    the data are of that simpler kind.
    """
    residuals = residuals or Residuals.of(problem, model, rows)
    inliers = rows[residuals.of_rows < threshold]
    if len(_distinct(inliers)) < len(inliers):  # copies are no evidence, and would be paired with each other
        rows = _distinct(rows)
        residuals = Residuals.of(problem, model, rows)
        inliers = rows[residuals.of_rows < threshold]
    if _distinct_count(problem, inliers) <= problem.minimal_size:
        return Verdict(Status.LOW_SUPPORT, 0.0)
    if not problem.determined(model, inliers, threshold):
        return Verdict(Status.DEGENERATE, 0.0)
    rate = chance_rate(residuals.by_chance, threshold)
    chance = min(1.0, _chance(problem, inliers, len(rows), rate) * max(tested, 1))
    confidence = 1.0 - float(chance ** (np.log(0.5) / np.log(_LARGEST_CHANCE)))
    if chance >= _LARGEST_CHANCE:
        return Verdict(Status.LOW_SUPPORT, confidence)
    whole = _certainty_of_search(residuals.support(threshold), tested, problem.minimal_size)
    if known_noise:
        whole = max(whole, _certainty_of_spread(residuals, threshold, residual_dimension(problem)))
    confidence = min(confidence, whole)
    if confidence < 0.5:
        return Verdict(Status.LOW_SUPPORT, confidence, remarks=("partly right",))
    remarks: list[str] = []
    alternatives: list[Alternative] = []
    for simpler in problem.simpler_models(model, inliers, threshold) if hasattr(problem, "simpler_models") else ():
        unexplained = inliers[~simpler.explains]
        if len(unexplained) > 0.5 * len(inliers) or _chance(problem, unexplained, len(rows), rate) < _LARGEST_CHANCE:
            continue  # the rows say more than the simpler model does
        remarks.append(simpler.name)
        if not simpler.determined:
            return Verdict(Status.DEGENERATE, 0.0, remarks=tuple(remarks))
        for other in simpler.others:
            ratios = np.minimum(problem.residuals(np.stack([model, other]), rows) / threshold, 1.0)
            if _lead(*ratios) < _CLEAR_LEAD:
                alternatives.append(Alternative(homogeneous(other), float((ratios[1] < 1.0).mean())))
    status = Status.AMBIGUOUS if alternatives else Status.OK
    return Verdict(status, min(confidence, 0.5) if alternatives else confidence, tuple(alternatives), tuple(remarks))


def _certainty_of_spread(residuals: Residuals, threshold: float, dimension: int) -> float:
    """How certainly the inliers beyond chance keep to the noise: 0.5 where as many as of a wrong model do.

    Of a right model, the share within two of the five standard deviations is that of a chi distribution; of a wrong
    one it is at most the fourth power of that (0.83, 0.56, 0.30 in one, two and three dimensions).
    """
    rows, pairs = len(residuals.of_rows), len(residuals.by_chance)
    shares = np.array([chance_rate(residuals.by_chance, x) for x in (0.4 * threshold, threshold)])
    hits = np.array([np.count_nonzero(residuals.of_rows < x) for x in (0.4 * threshold, threshold)])
    near, all_inliers = hits - rows * shares
    bound = float(chdtr(dimension, 4.0)) ** 4
    weights = np.array([(1.0 - bound) ** 2 - bound**2, bound**2])  # of those within, and of all
    variance = weights @ hits + rows**2 / pairs * (weights @ shares)
    return float(ndtr((near - bound * all_inliers) / np.sqrt(variance)))


def _certainty_of_search(support: float, tested: int, minimal_size: int) -> float:
    """How certainly a better model would have come up, if there were one: 0.5 at two expected starts.

    A start is a minimal sample of rows that a model with the same support explains. Not every minimal sample gives a
    model to be tested, so there were more.
    """
    starts = tested * max(support, 0.0) ** minimal_size
    return 1.0 - float(0.5 ** (starts / 2.0))


def _lead(ratios: Array, others: Array) -> float:
    """By how many standard deviations one model fits better than another, row by row (Vuong 1989).

    From the residuals as shares of the threshold, at most 1, through Tukey's biweight.
    """
    gains = (1.0 - ratios**2) ** 3 - (1.0 - others**2) ** 3
    return float(gains.sum() / max(np.sqrt((gains**2).sum()), 1e-300))


def _chance(problem: Problem, inliers: Array, rows: int, rate: float) -> float:
    """Probability that one model without any matches has as many distinct inliers among so many rows."""
    beyond = _distinct_count(problem, inliers) - problem.minimal_size
    if beyond <= 0:
        return 1.0
    return float(betainc(beyond, rows - problem.minimal_size - beyond + 1, rate))  # P(X >= beyond), binomial law


def _distinct_count(problem: Problem, rows: Array) -> int:
    """Rows that do not share a point with another one, in either half."""
    end = problem.width - 1 if hasattr(problem, "row_weights") else problem.width
    return min(_count_distinct(half) for half in (rows[:, : problem.split], rows[:, problem.split : end]))


def _count_distinct(points: Array) -> int:
    return len(_distinct(points))


def _distinct(rows: Array) -> Array:
    """The different rows, in their order; `numpy.unique` on an axis takes ten times as long, and sorts them."""
    if not len(rows):
        return rows
    order = np.lexsort(rows.T)
    ordered = rows[order]
    return rows[np.sort(order[np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))])]


def chance_residuals(problem: Problem, model: Array, rows: Array) -> Array:
    """Residuals of rows that are paired at random."""
    return problem.residuals(model[None], paired_at_random(problem, rows, min(50_000, max(6_000, 10 * len(rows)))))[0]


def paired_at_random(problem: Problem, rows: Array, size: int) -> Array:
    """So many rows of two halves from different rows: the marginal distributions without the matches.

    With each pair there is that of the other two halves, so that nothing changes where the halves change places.
    """
    n = len(rows)
    rng = np.random.default_rng(n)
    first = rng.integers(n, size=size // 2)
    second = (first + rng.integers(1, max(n, 2), size=size // 2)) % n
    first, second = np.concatenate([first, second]), np.concatenate([second, first])
    return np.hstack([rows[first, : problem.split], rows[second, problem.split :]])


def chance_rate(by_chance: Array, threshold: float) -> float:
    """Share of inliers among random pairs; half a count is added to be safe."""
    return (np.count_nonzero(by_chance < threshold) + 0.5) / (len(by_chance) + 1)
