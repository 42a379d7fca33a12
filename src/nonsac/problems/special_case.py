"""Models with fewer parameters that may explain the same rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nonsac.layouts import Array


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
    displaced : callable or None
        What rows would be, of all of which it is given (N, D), if they were displaced at random from where the special
        case has them, as mistakes of a tracker are: which of them that may be (N,) bool, none that the case explains,
        and these, each several times, with a displacement of the same length in any direction. None if mistakes are not
        local.
    """

    name: str
    explains: NDArray[np.bool_]
    determined: bool
    others: NDArray[np.float64] | tuple[()] = ()
    displaced: Callable[[Array], tuple[NDArray[np.bool_], Array]] | None = None
