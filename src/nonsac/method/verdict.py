"""Whether an answer is to be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nonsac.layouts import Array, Rows, distinct
from nonsac.method.doubts import certainty, disagreement, slippage, slipping_apart
from nonsac.method.residuals import Residuals, chance_rate, measured_noise
from nonsac.problems.contract import Problem
from nonsac.problems.facts import LOOKED_AT, Facts, Places
from nonsac.problems.ladder import BEYOND, LADDER, Telling
from nonsac.problems.noise import Noise
from nonsac.result import Alternative, Remark, Status
from nonsac.values import special

_LARGEST_CHANCE = 1e-6
_CLEAR_LEAD = 4.0
_AROUND, _ABOVE = 12, 2  # rungs
_CROWDED, _FEWEST = 0.6, 200
_LEAST_SHARE = 1e-6  # exact rows leave residuals of rounding only
_MORE_THAN_BACKGROUND, _MORE_THAN_BESIDE = 1.25, 2.0


@dataclass(frozen=True)
class Verdict:
    """Whether to trust an answer, what answers the rows allow besides, special cases, and what was measured."""

    status: Status
    confidence: float
    alternatives: tuple[Alternative, ...] = ()
    remarks: tuple[str, ...] = ()
    tests: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model that might be the answer, and the rows that it is judged on."""

    problem: Problem
    model: Array
    rows: Rows
    noise: Noise

    @cached_property
    def residuals(self) -> Residuals:
        return Residuals.of(self.problem, self.model, self.rows)

    @cached_property
    def inliers(self) -> NDArray[np.bool_]:
        return self.residuals.of_rows < self.noise.threshold

    @property
    def support(self) -> float:
        """Share of the rows that are inliers beyond chance."""
        return self.residuals.support(self.noise.threshold)

    @property
    def chance_rate(self) -> float:
        """Share of the rows that would be inliers by chance.

        Rows that match nothing may be dense where a model is for other reasons, and no background is sure to know
        these: there must be clearly more of them than of the background rows, no fewer than of rows spread evenly over
        their box, and clearly more than in the model's surroundings, out to three thresholds.
        """
        problem, threshold, residuals = self.problem, self.noise.threshold, self.residuals.of_rows
        rate = chance_rate(self.residuals.background, threshold)
        if problem.layout.split is not None:
            return rate
        of_box = problem.residuals(self.model[None], _box(self.rows.values, len(self.residuals.background)))[0]
        beside = np.count_nonzero((residuals >= threshold) & (residuals < 3.0 * threshold)) / len(residuals)
        beside /= 3.0**problem.residual_dimension - 1.0
        rates = _MORE_THAN_BACKGROUND * rate, chance_rate(of_box, threshold), _MORE_THAN_BESIDE * beside
        return min(max(rates), 1.0)

    @cached_property
    def facts(self) -> Facts:
        """Those of the inliers that are in places of their own."""
        return self._facts(Places.of(self.problem, self.rows.values))

    @property
    def facts_of_fewer(self) -> list[Facts]:
        """Those among fewer of the inliers, too, while most of them share a place with another.

        A scene has only so many places: where all are taken, further rows that match nothing would add to what is
        expected, and further inliers nothing to what is found.
        """
        found = [self.facts]
        while found[-1].count < _CROWDED * found[-1].looked_at and found[-1].looked_at >= 2 * _FEWEST:
            found.append(self._facts(Places.of(self.problem, self.rows.values), found[-1].looked_at // 2))
        return found

    @cached_property
    def resolved(self) -> Facts:
        """Those of the inliers that the noise lets one tell apart; neighbours need not be independent of each other."""
        return self._facts(Places.finest(self.problem))

    def _facts(self, places: Places, most: int = LOOKED_AT) -> Facts:
        return Facts.of(self.model, self.rows.values[self.inliers], len(self.rows), self.noise, places, most)

    @cached_property
    def measured_noise(self) -> float:
        """The standard deviation that the inliers show, no more than that of the threshold, and not zero."""
        shown = measured_noise(self.residuals, self.noise.threshold, self.problem.residual_dimension)
        return float(np.clip(np.nan_to_num(shown, nan=np.inf), _LEAST_SHARE * self.noise.sigma, self.noise.sigma))

    @property
    def least_chance(self) -> float:
        """Bound of the chance of the model at the threshold at which it is least, out of some around its own.

        Nobody gave the noise, so that none of them is better founded than the others.
        """
        thresholds = self.noise.threshold * LADDER[-_AROUND - BEYOND :] / LADDER[-_ABOVE - BEYOND]
        return _AROUND * Telling(self.problem, self.rows).of(self.model, thresholds).chance

    def without_copies(self) -> Candidate:
        """The same model on different rows only, if some inliers are copies of others."""
        inliers = self.rows.values[self.inliers]
        if len(distinct(inliers)) == len(inliers):
            return self
        return Candidate(self.problem, self.model, self.rows[distinct(self.rows.values)], self.noise)


class Effort(NamedTuple):
    """How long the search was.

    Attributes
    ----------
    compared : int
        Models that the answer was chosen from, as far as is known, at most: each could have come up by chance.
    searched : int
        Minimal samples that are known to have been drawn, at least: each could have been the start of a better model.
    """

    compared: int
    searched: int


def judge_rows(candidate: Candidate, effort: Effort) -> Verdict:
    """Could a model with this many inliers come up by chance, or as a model that is right in part only?

    *Chance.* The chance level is measured on the problem's background rows: the same rows with their pairing shuffled,
    so that the marginal distributions stay and the matches are gone. The number of inliers beyond a minimal sample,
    under a binomial law with that rate and corrected for the number of models that were compared (Bonferroni), gives
    the probability that data without any matches would have produced such an answer; it must be below one in a
    million. Inliers that share a point count once, because they are no independent evidence.

    *Part of the truth.* A model near a wrong optimum has many true matches within the threshold, too. The parts of the
    scene then ask for different models (`doubts.disagreement`). If the noise is known, the inliers must keep to it as
    well, unless the search was so long that a better model, of which every minimal sample of true matches is a start,
    would have come up (`_certainty_of_search`).

    *Slipping.* Models beside the answer explain next to none of the other rows (`doubts.slippage`).

    The confidence is what the ways to be wrong leave of 1; each takes 0.5 at its bound. The first test is applied, too,
    to the inliers that a special case (a rotation without a baseline, a planar scene) does not explain. If they are no
    more than chance, the data are of that special kind.
    """
    candidate = candidate.without_copies()  # copies are no evidence, and would be paired with each other
    problem, noise = candidate.problem, candidate.noise
    inliers = candidate.rows.values[candidate.inliers]
    if _distinct_count(problem, inliers) <= problem.minimal_size:
        return Verdict(Status.LOW_SUPPORT, 0.0)
    if not problem.determined(candidate.model, inliers, noise):
        return Verdict(Status.DEGENERATE, 0.0)
    rate = candidate.chance_rate
    counted = candidate.facts_of_fewer
    chance = len(counted) * min(_chance(candidate, facts, rate) for facts in counted)
    if not noise.known and problem.layout.split is not None:
        chance = min(chance, candidate.least_chance)
    chance = min(1.0, chance * max(effort.compared, 1))
    tests = {"facts": candidate.facts.count, "chance": chance}
    doubts = [Doubt(float(chance ** (np.log(0.5) / np.log(_LARGEST_CHANCE))), Status.LOW_SUPPORT)]
    if chance >= _LARGEST_CHANCE:
        return _doubted(doubts, tests)
    parts = disagreement(problem, candidate.model, candidate.rows, noise, candidate.measured_noise)
    seen = problem, candidate.model, candidate.rows, noise, candidate.residuals
    slipping = {"slippage": slippage(*seen), "one_motion": slipping_apart(*seen)}
    tests |= slipping if parts is None else {**slipping, "parts": parts}
    doubts.append(
        Doubt(1.0 - _certainty_of_whole(candidate, effort.searched, parts), Status.LOW_SUPPORT, Remark.PARTLY_RIGHT)
    )
    doubts.append(Doubt(1.0 - certainty(max(slipping.values())), Status.LOW_SUPPORT, Remark.SLIPPING))
    verdict = _doubted(doubts, tests)
    return _beside_special_cases(candidate, verdict, rate) if verdict.status is Status.OK else verdict


class Doubt(NamedTuple):
    """A way to be wrong: how likely it is, and what the verdict is if it is too likely."""

    probability: float
    status: Status
    remark: Remark | None = None


def _doubted(doubts: Sequence[Doubt], tests: dict[str, float]) -> Verdict:
    """Trust, unless the ways to be wrong are together more likely than not."""
    worst = max(doubts, key=lambda doubt: doubt.probability)
    confidence = max(0.0, 1.0 - sum(doubt.probability for doubt in doubts))
    if confidence >= 0.5 and worst.probability < 0.5:
        return Verdict(Status.OK, confidence, tests=tests)
    remarks = () if worst.remark is None else (worst.remark,)
    return Verdict(worst.status, min(confidence, 0.5), remarks=remarks, tests=tests)


def _certainty_of_whole(candidate: Candidate, searched: int, parts: float | None) -> float:
    """How certainly the model is not right in part only: the parts of the scene agree.

    If too few rows tell, or the problem does not say how uncertain its models are, the search was exhaustive. The
    inliers must keep to the noise, too, if that is known.
    """
    problem, noise = candidate.problem, candidate.noise
    if parts is not None and not noise.known:
        return certainty(parts)
    whole = _certainty_of_search(candidate.support, searched, problem.minimal_size)
    if noise.known:
        whole = max(whole, _certainty_of_spread(candidate.residuals, noise.threshold, problem.residual_dimension))
    return whole if parts is None else min(whole, certainty(parts))


def _beside_special_cases(candidate: Candidate, verdict: Verdict, rate: float) -> Verdict:
    """The verdict in view of what special cases of the problem explain."""
    problem, model, noise, rows = candidate.problem, candidate.model, candidate.noise, candidate.rows.values
    inliers = rows[candidate.inliers]
    remarks: list[str] = list(problem.remarks(model, inliers))
    alternatives: list[Alternative] = []
    for case in problem.special_cases(model, inliers, noise):
        unexplained = ~case.explains
        chance = _chance(candidate, candidate.resolved.among(unexplained), rate)
        if case.displaced is not None:
            chance = max(chance, _local_chance(candidate, unexplained, *case.displaced(rows)))
        elif unexplained.mean() > 0.5:
            continue
        if chance < _LARGEST_CHANCE:
            continue  # the rows say more than the special case does
        remarks.append(case.name)
        if not case.determined:
            return replace(verdict, status=Status.DEGENERATE, confidence=0.0, remarks=tuple(remarks))
        for other in case.others:
            ratios = np.minimum(problem.residuals(np.stack([model, other]), rows) / noise.threshold, 1.0)
            if _lead(*ratios) < _CLEAR_LEAD:
                alternatives.append(alternative(problem, other, float((ratios[1] < 1.0).mean())))
    verdict = replace(verdict, remarks=tuple(remarks))
    if not alternatives:
        return verdict
    confidence = min(verdict.confidence, 0.5)
    return replace(verdict, status=Status.AMBIGUOUS, confidence=confidence, alternatives=tuple(alternatives))


def alternative(problem: Problem, model: Array, support: float) -> Alternative:
    """Another answer, with its matrix if it is a motion."""
    return Alternative(model, support, problem.transform(model))


def _certainty_of_spread(residuals: Residuals, threshold: float, dimension: int) -> float:
    """How certainly the inliers beyond chance keep to the noise: 0.5 if as many as of a wrong model do.

    Of a right model, the share within two of the five standard deviations is that of a chi distribution; of a wrong
    one it is at most the fourth power of that (0.83, 0.56, 0.30 in one, two and three dimensions).
    """
    rows, pairs = len(residuals.of_rows), len(residuals.background)
    shares = np.array([chance_rate(residuals.background, x) for x in (0.4 * threshold, threshold)])
    hits = np.array([np.count_nonzero(residuals.of_rows < x) for x in (0.4 * threshold, threshold)])
    near, all_inliers = hits - rows * shares
    bound = float(special.chdtr(dimension, 4.0)) ** 4
    weights = np.array([(1.0 - bound) ** 2 - bound**2, bound**2])  # of those within, and of all
    variance = weights @ hits + rows**2 / pairs * (weights @ shares)
    return float(special.ndtr((near - bound * all_inliers) / np.sqrt(variance)))


def _certainty_of_search(support: float, searched: int, minimal_size: int) -> float:
    """How certainly a better model would have come up, if there were one: 0.5 at two expected starts.

    A start is a minimal sample of rows that a model with the same support explains. Not every minimal sample gives a
    model to be tested, so there were more.
    """
    starts = searched * max(support, 0.0) ** minimal_size
    return 1.0 - float(0.5 ** (starts / 2.0))


def _lead(ratios: Array, others: Array) -> float:
    """By how many standard deviations one model fits better than another, row by row (Vuong 1989).

    From the residuals as shares of the threshold, at most 1, through Tukey's biweight.
    """
    gains = (1.0 - ratios**2) ** 3 - (1.0 - others**2) ** 3
    return float(gains.sum() / max(np.sqrt((gains**2).sum()), 1e-300))


def _chance(candidate: Candidate, facts: Facts, rate: float) -> float:
    """Probability that one model without any matches has as many facts."""
    problem = candidate.problem
    count = _distinct_count(problem, candidate.rows.values[candidate.inliers][facts.chosen])
    beyond = count - problem.minimal_size
    if beyond <= 0:
        return 1.0
    rows = facts.rows - problem.minimal_size
    return float(special.betainc(beyond, max(rows - beyond, 0) + 1, rate))  # P(X >= beyond), binomial law


def _local_chance(candidate: Candidate, among: NDArray[np.bool_], near: NDArray[np.bool_], displaced: Array) -> float:
    """The same for rows that a special case misses by little, if they were displaced from it at random."""
    problem, noise = candidate.problem, candidate.noise
    facts = candidate.resolved.among(among & near[candidate.inliers])
    beyond = facts.count - problem.minimal_size
    if beyond <= 0:
        return 1.0
    rate = chance_rate(problem.residuals(candidate.model[None], displaced)[0], noise.threshold)
    rows = int(facts.share * np.count_nonzero(near)) - problem.minimal_size
    return float(special.betainc(beyond, max(rows - beyond, 0) + 1, rate))


def _distinct_count(problem: Problem, rows: Array) -> int:
    """Rows that do not share a point with another one, in either half."""
    split = problem.layout.split
    halves = (rows,) if split is None else (rows[:, :split], rows[:, split:])
    return min(len(distinct(half)) for half in halves)


def _box(rows: Array, size: int) -> Array:
    """So many rows, spread evenly over the box around the given ones."""
    return np.random.default_rng(len(rows)).uniform(rows.min(axis=0), rows.max(axis=0), (size, rows.shape[1]))
