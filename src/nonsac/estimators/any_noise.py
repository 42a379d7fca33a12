"""RANSAC without a threshold: each model is scored at many, and the one least likely by chance is kept.

A contrario RANSAC (Moisan and Stival, IJCV 2004; Moulon, Monasse and Marlet, ACCV 2012), with one best model for each
octave of the threshold, so that a coarse model that means little does not keep a fine one from being found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem
from nonsac.problems.ladder import Ladder, Telling

_LOOKED_AT, _JUDGED = 2, 5
_OCTAVE = 2  # rungs
_FINER, _CLEARLY = 10, 2.0


@dataclass
class Best:
    """The best model of an octave so far."""

    model: Array | None = None
    score: float = 0.0
    rung: int = 0
    count: int = 0
    further: int = 0  # within twice the threshold


@dataclass
class Octaves:
    """The best model for each octave of the threshold.

    Parameters
    ----------
    problem : Problem
    rows : Rows
    ladder : Ladder
    optimise : callable
        A better model from one and a threshold.
    """

    problem: Problem
    rows: Rows
    ladder: Ladder
    optimise: Callable[[Array, float], Array]
    kept: list[Best] = field(init=False)
    seen: Array = field(init=False)

    def __post_init__(self) -> None:
        octaves = -(-len(self.ladder.chance) // _OCTAVE)
        self.kept = [Best() for _ in range(octaves)]
        self.seen = np.zeros(octaves)

    def take(self, models: Array) -> None:
        """Look at more models; the most promising ones are optimised where they are."""
        counts = self.ladder.counts(self.problem, models, self.rows)
        scores, best = self.ladder.best(self.problem, counts, len(self.rows))
        octaves = np.arange(len(scores)) // _OCTAVE
        promising = []
        for octave in range(len(self.kept)):
            rungs = np.flatnonzero(octaves == octave)
            rung = int(rungs[np.argmax(scores[rungs])])
            if scores[rung] > self.seen[octave]:
                self.seen[octave] = scores[rung]
                promising.append((float(scores[rung]), rung, int(best[rung])))
        for _, rung, number in sorted(promising, reverse=True)[:_LOOKED_AT]:
            self.keep(models[number])
            self.keep(self.optimise(models[number], float(self.ladder.thresholds[rung])))

    def keep(self, model: Array) -> None:
        """Keep a model in each octave in which it is the best so far."""
        counts = self.ladder.counts(self.problem, model[None], self.rows)
        scores = self.ladder.best(self.problem, counts, len(self.rows))[0]
        for rung, score in enumerate(scores):
            best = self.kept[rung // _OCTAVE]
            if score > best.score:
                best.model, best.score, best.rung = model, float(score), rung
                best.count, best.further = int(counts[0, rung]), int(counts[0, rung + _OCTAVE])

    @property
    def support(self) -> float:
        """Rows within the threshold of the model that is least likely by chance, beyond those that are by chance.

        As dense as between that threshold and twice it, rows are there by chance.
        """
        best = max(self.kept, key=lambda best: best.score)
        beside = (best.further - best.count) / (2.0**self.problem.residual_dimension - 1.0)
        return max(best.count - max(len(self.rows) * float(self.ladder.chance[best.rung]), beside), 0.0)

    def chosen(self) -> tuple[Array, float, float] | None:
        """The model that is least likely by its own chance, its threshold, and minus the logarithm of the chance."""
        ranked = sorted(self.kept, key=lambda best: -best.score)
        models = {best.model.tobytes(): best.model for best in ranked if best.model is not None}
        found, telling = [], Telling(self.problem, self.rows)
        for model in [*models.values()][:_JUDGED]:
            level = telling.of(model, self.ladder.thresholds)
            found.append((level.score, -level.threshold, model))
        if not found:
            return None
        score, threshold, model = max(found, key=lambda each: each[:2])
        return *self._likeliest(telling, model, -threshold), score

    def _likeliest(self, telling: Telling, model: Array, threshold: float) -> tuple[Array, float]:
        """The model, or one of those kept at finer thresholds, if the rows are clearly likelier with that.

        Where few rows are right, their number is least likely by chance at a coarse threshold, at which a model some
        degrees off has as many; how near they are tells.
        """
        within = self.ladder.thresholds[: len(self.ladder.chance)]
        finer = np.ascontiguousarray(within[within <= threshold][::-_OCTAVE][:_FINER])
        most, chosen = telling.likelihood(model, finer)[0] + _CLEARLY, (model, threshold)
        for best in self.kept:
            if best.model is None or within[best.rung] > threshold:
                continue
            likelihood, its_threshold = telling.likelihood(best.model, finer)
            if likelihood > most:
                most, chosen = likelihood, (best.model, its_threshold)
        return chosen
