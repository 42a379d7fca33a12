"""What warps and flow share: arrays with a match for each pixel, of which some are drawn."""

from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.io.correspondences import Points
from nonsac.seeds import canonical_seed
from nonsac.values.arraylike import as_array
from nonsac.values.numeric import shown


def numbers_of(name: str, values: Any) -> NDArray[Any]:
    """An array of real numbers, in single or double precision; others, such as those of half precision, in double."""
    array = as_array(values, name)
    if array.dtype.kind not in "iufb":
        raise ValueError(f"{name} has the type {array.dtype}; expected real numbers")
    if array.dtype in (np.float32, np.float64):
        return array
    with np.errstate(all="ignore"):
        return array.astype(np.float64)


def checked_count(count: Any) -> int | None:
    """How many matches to draw, or None for all."""
    if count is not None and (not isinstance(count, Integral) or isinstance(count, bool) or int(count) < 1):
        raise ValueError(f"count is {shown(count)}; expected at least 1, or None for all matches")
    return None if count is None else int(count)


def drawn(
    matches: NDArray[np.int64], weights: NDArray[Any] | None, count: int | None, rng: int | np.random.Generator | None
) -> tuple[NDArray[np.int64], Points | None]:
    """The numbers of so many of the matches, in their order, and their weights if all are taken.

    The draw is without replacement, and the larger its weight, the more often one is drawn; all then count alike.
    """
    weights = None if weights is None else weights.astype(np.float64)
    if count is None or count >= len(matches):
        return matches, weights
    generator = rng if isinstance(rng, np.random.Generator) else np.random.default_rng(canonical_seed(rng))
    # The smallest of exponential times, each with its certainty as the rate, are such a draw.
    with np.errstate(all="ignore"):  # what is next to impossible waits for ever
        times = generator.standard_exponential(len(matches)) / (1.0 if weights is None else weights)
    return matches[np.sort(np.argpartition(times, count - 1)[:count])], None
