"""Models with fewer parameters that may explain the same rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class SpecialCase:
    """A special case of a problem, and which inliers it explains.

    If it explains all but a chance number of them, the rows cannot tell more than it does.

    Attributes
    ----------
    name : str
        For the remarks of a result, such as "planar".
    explains : (N,) bool
    determined : bool
        Whether the rows then still determine finitely many models.
    others : sequence of models
        Further models that the rows then allow.
    """

    name: str
    explains: NDArray[np.bool_]
    determined: bool
    others: NDArray[np.float64] | tuple[()] = ()
