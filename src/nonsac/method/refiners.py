"""The refiners by name."""

from __future__ import annotations

from nonsac.method.average_refiner import HypothesisAverage
from nonsac.method.full_pass import FullFit
from nonsac.method.refine import AsSelected, Refiner
from nonsac.method.union_refit import UnionRefit

REFINERS: dict[str, Refiner] = {
    "union": UnionRefit(),
    "polish": UnionRefit(polish_rows=100_000),
    "full": FullFit(polish_rows=30_000),
    "none": AsSelected(),
    "average": HypothesisAverage(),
}


def by_name(name: object) -> Refiner:
    """The refiner with this name: "union", "polish", "full", "none" or "average"."""
    if not isinstance(name, str) or name not in REFINERS:
        names = ", ".join(f'"{known}"' for known in REFINERS)
        raise ValueError(f"refine must be {names} or a Refiner, got {name!r}")
    return REFINERS[name]
