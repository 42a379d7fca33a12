"""How far inliers are from a model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

_WIDTH = 5.0  # standard deviations within which rows are inliers (Lee et al., Sec. 4)


@dataclass(frozen=True)
class Noise:
    """The noise of inliers, and the residual below which rows are inliers.

    Attributes
    ----------
    sigma : float
        Standard deviation of an inlier, in the unit of the residual.
    threshold : float
        Rows with a smaller residual are inliers: 5 `sigma`.
    known : bool
        Whether the user gave it; if not, a model that is right in part may look right at its own noise.
    """

    sigma: float
    threshold: float
    known: bool = True

    @classmethod
    def given(cls, sigma: float, known: bool = True) -> Self:
        """A noise with this standard deviation."""
        return cls(float(sigma), _WIDTH * float(sigma), known)

    @classmethod
    def within(cls, threshold: float, known: bool = True) -> Self:
        """The noise whose inliers have residuals below this threshold."""
        return cls(float(threshold) / _WIDTH, float(threshold), known)
