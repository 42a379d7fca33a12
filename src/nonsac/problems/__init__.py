"""What is estimated. A problem owns the mathematics and knows nothing of where its rows lie."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from nonsac.problems.oriented_registration import OrientedRegistration
from nonsac.problems.registration import Registration

__all__ = ["OrientedRegistration", "Problem", "Registration"]

Array = NDArray[np.float64]


@runtime_checkable
class Problem(Protocol):
    """The mathematics of one kind of model. A row is one correspondence, of `width` numbers."""

    @property
    def width(self) -> int:
        """Numbers in a row, D."""
        ...

    @property
    def minimal_size(self) -> int:
        """Rows that determine finitely many models, k."""
        ...

    @property
    def split(self) -> int:
        """Column at which a row splits into the two things that it matches."""
        ...

    def solve_minimal(self, samples: Array) -> Array:
        """All models of B minimal samples (B, k, D): (M, 3, 4), where M may be more or fewer than B."""
        ...

    def residuals(self, models: Array, rows: Array) -> Array:
        """How far each row is from each model, in the unit of the threshold: (M, N) for M models, N rows."""
        ...

    def count_inliers(self, models: Array, rows: Array, threshold: float) -> NDArray[np.int64]:
        """How many rows have a residual below the threshold: (M,)."""
        ...

    def refit(self, model: Array, rows: Array, weights: Array) -> Array:
        """The least-squares model of weighted rows, started at `model`; NaN where the rows do not determine one."""
        ...

    def determined(self, model: Array, inliers: Array, threshold: float) -> bool:
        """Whether these inlier rows, uncertain by the threshold, pin the model down; the model may be NaN."""
        ...

    def distance(self, a: Array, b: Array) -> Array:
        """How different two models are, in degrees; broadcasts over leading axes."""
        ...
