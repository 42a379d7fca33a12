"""The average of the hypotheses as the answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nonsac.method.averaging import AVERAGES, check_kind
from nonsac.method.refine import Refinement, Refiner
from nonsac.method.search import Search


@dataclass(frozen=True)
class HypothesisAverage(Refiner):
    """A robust average of all hypotheses, as it is: what hypothesis averaging gives, for studies; judged on the union.

    Parameters
    ----------
    kind : "l1", "trimmed" or "truncated"
        Which average (see `nonsac.method.averaging`).
    """

    kind: str = "truncated"

    def __post_init__(self) -> None:
        check_kind(self.kind)

    def refine(self, search: Search, winner: int) -> Refinement:
        models = np.stack([h.model for h in search.hypotheses if h.found])
        return Refinement.of(search, AVERAGES[self.kind](search.problem, models, search.union().values))
