"""LO-RANSAC: a good model's inliers are sampled again, larger samples at a time, and each fit is drawn in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nonsac.estimators.usac import Consensus, LocalOptimiser, Usac
from nonsac.layouts import Array
from nonsac.problems.contract import Problem
from nonsac.values.numeric import as_real, as_whole, shown


@dataclass(frozen=True)
class InnerRansac(LocalOptimiser):
    """Inner RANSAC with iteration (Chum, Matas and Kittler, "Locally optimized RANSAC", DAGM 2003, Sec. 3, method 4).

    Samples of the inliers, not minimal ones, are fitted by least squares. Each fit is followed by fits to all rows
    within a threshold that shrinks to the given one. Fits that need a start begin at the model that is improved.

    Parameters
    ----------
    samples : int
        How many, 10 as published.
    sample_size : int
        Half of the inliers, at most so many: 14 as published for epipolar geometry.
    widest : float
        The first threshold of the fits that follow, in units of the given one; the paper leaves it open.
    steps : int
        How many fits follow, at thresholds in geometric progression; left open, too.
    """

    samples: int = 10
    sample_size: int = 14
    widest: float = 2.0
    steps: int = 4

    def __post_init__(self) -> None:
        for name in ("samples", "sample_size", "steps"):
            whole = as_whole(getattr(self, name))
            if whole is None or whole < 1:
                raise ValueError(f"{name} must be a whole number of at least 1, got {shown(getattr(self, name))}")
        if not 1.0 <= as_real(self.widest) < np.inf:
            raise ValueError(f"widest must be a number of at least 1, got {shown(self.widest)}")

    def models(self, consensus: Consensus, model: Array, rng: np.random.Generator) -> Array:
        inliers = np.flatnonzero(consensus.ratios(model) < 1.0)
        size, found = min(len(inliers) // 2, self.sample_size), []
        if size >= consensus.problem.minimal_size:
            for _ in range(self.samples):
                chosen = rng.choice(inliers, size, replace=False)
                found.append(self._drawn_in(consensus, consensus.fitted_to(model, chosen)))
        return np.reshape(found, (-1, *consensus.problem.model_shape))

    def _drawn_in(self, consensus: Consensus, model: Array) -> Array:
        """The model after fits to all rows within a threshold that shrinks; NaN if a fit is not determined."""
        for width in np.geomspace(self.widest, 1.0, self.steps):
            if not np.isfinite(model).all():
                break
            model = consensus.fitted_to(model, np.flatnonzero(consensus.ratios(model) < width))
        return model


def lo_ransac(problem: Problem) -> Usac:
    """LO-RANSAC as published: the number of inliers, and inner RANSAC for every best model."""
    return Usac(optimiser=InnerRansac())
