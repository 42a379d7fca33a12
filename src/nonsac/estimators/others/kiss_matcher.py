"""KISS-Matcher's pruning and solver for given pairs (Lim et al., "KISS-Matcher", ICRA 2025).

Pairs are pruned by a core of the graph of their consistency (ROBIN), and fitted by graduated non-convexity. Its licence
is MIT.
"""

from __future__ import annotations

import numpy as np

from nonsac.estimators.others.frame import Pairs, near
from nonsac.estimators.others.library import Library
from nonsac.layouts import Array
from nonsac.problems.contract import Problem
from nonsac.problems.registration import Registration

_BOUND = 0.1  # metres; in other units it refuses small bounds and clamps large ones
_FAR = 1e5  # farther away, its assertions fail, and that ends the process


def default(problem: Problem) -> Library:
    return Library(solve, needs_scale=True)


def solve(problem: Registration, values: Array, threshold: float, seed: int, iterations: int) -> Array | None:
    """There is nothing random in it, nor a number of iterations."""
    import kiss_matcher

    pairs = Pairs.of(problem, values, threshold / _BOUND)
    rows = near(np.hstack([pairs.source, pairs.target]), _FAR)
    if len(rows) < problem.minimal_size:
        return None
    matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(_BOUND))
    found = matcher.solve(rows[:, :3].T, rows[:, 3:].T)
    return pairs.model(found.rotation, found.translation) if found.valid else None
