"""Models with fewer parameters that may explain the same rows."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Simpler:
    """A special case of a problem, and which inliers it explains.

    Where it explains all but a chance number of them, the rows cannot tell more than it does.

    Attributes
    ----------
    name : str
        For the result's `info`, such as "planar".
    explains : (N,) bool
    determined : bool
        Whether the rows then still determine finitely many models.
    others : (K, 3, 4) float64
        Further models that the rows then allow.
    """

    name: str
    explains: NDArray[np.bool_]
    determined: bool
    others: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3, 4)))
