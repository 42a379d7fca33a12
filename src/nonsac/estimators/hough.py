"""Randomised Hough transform: triplets of rows vote for rotations, and the fullest cells are looked at."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from nonsac.estimators.contract import Estimator
from nonsac.estimators.ransac import gathered, minimal_samples
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, solved
from nonsac.problems.fits import inlier_fit
from nonsac.problems.noise import Noise
from nonsac.problems.registration import Registration
from nonsac.result import Hypothesis
from nonsac.values.numeric import as_real, as_whole, shown

_BATCH = 10_000
_MOST_COUNTED = 500
_ENOUGH = 10_000  # models
_HASH = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x27D4EB2F165667C5], np.uint64).view(
    np.int64
)


@dataclass(frozen=True)
class Hough(Estimator):
    """Randomised Hough transform for rotations (Xu, Oja and Kultanen 1990), for registrations of matched points.

    Triplets of rows are drawn at random; those whose sides agree in the two clouds vote for their rotation, in cells of
    unit quaternions. Only cells with votes are held. Of the models in the fullest cells, the one with the most inliers
    is fitted to them.

    A rotation needs two or three right votes: with 100,000 triplets up to about 95 % of outliers. Rows are drawn, and
    count, by their weights.

    Parameters
    ----------
    triplets : int
        Drawn in all.
    cell : float
        Width of a cell, in degrees of rotation.
    peaks : int
        Cells that are looked at.
    """

    triplets: int = 100_000
    cell: float = 8.0
    peaks: int = 10

    def __post_init__(self) -> None:
        for name in ("triplets", "peaks"):
            whole = as_whole(getattr(self, name))
            if whole is None or whole < 1:
                raise ValueError(f"{name} must be a whole number of at least 1, got {shown(getattr(self, name))}")
        if not 0.0 < as_real(self.cell) <= 180.0:
            raise ValueError(f"cell must be an angle above 0 and up to 180 degrees, got {shown(self.cell)}")

    def check(self, problem: Problem) -> None:
        self._registration(problem)

    def _registration(self, problem: Problem) -> Registration:
        if not isinstance(problem, Registration):
            raise TypeError(f"Hough estimates 3D registrations only, got {type(problem).__name__}")
        return problem

    def estimate(self, problem: Problem, rows: Rows, noise: Noise, rng: np.random.Generator) -> Hypothesis:
        threshold, weights = noise.threshold, rows.mean_weights
        models = self._voting(self._registration(problem), rows, threshold, rng)
        if not len(models):
            return Hypothesis(problem.no_model, np.full(len(rows), np.inf), threshold, tested=0)
        first = models[fullest(models, self.cell, self.peaks)[:_MOST_COUNTED]]
        best = first[int(np.argmax(problem.count_inliers(first, rows.values, threshold, weights)))]
        model = inlier_fit(problem, best, rows, threshold)
        residuals = problem.residuals(model[None], rows.values)[0]
        return Hypothesis(model, residuals, threshold, tested=len(models))

    def with_budget(self, factor: int) -> Self:
        return replace(self, triplets=self.triplets * factor)

    def _voting(self, problem: Registration, rows: Rows, threshold: float, rng: np.random.Generator) -> Array:
        """The models of all triplets whose sides agree."""
        found = [np.empty((0, *problem.model_shape))]
        for start in range(0, self.triplets if len(rows) >= problem.minimal_size else 0, _BATCH):
            if sum(map(len, found)) >= _ENOUGH:  # where most rows are right, nearly all triplets agree
                break
            count = min(_BATCH, self.triplets - start)
            samples = gathered(rows.values, minimal_samples(len(rows), 3, count, rng, rows.mean_weights))
            found.append(solved(problem, samples[sides_agree(samples, problem.scale, threshold)]))
        return np.concatenate(found)


def sides_agree(samples: Array, scale: float | None, threshold: float) -> NDArray[np.bool_]:
    """Whether the three sides of triplets (B, 3, 6) have the same lengths in both clouds, but for two thresholds.

    If the scale is not known, that of the longest side is taken for the others.
    """
    sides = samples - np.roll(samples, 1, axis=1)
    first, second = (np.linalg.norm(half, axis=2) for half in (sides[..., :3], sides[..., 3:]))
    if scale is None:
        longest = np.argmax(first, axis=1)[:, None]
        base = np.take_along_axis(first, longest, 1)
        scales = np.take_along_axis(second, longest, 1) / np.where(base > 0.0, base, np.inf)
    else:
        scales = np.full((len(samples), 1), scale)
    return (np.abs(scales * first - second) < 2.0 * threshold).all(axis=1)


def fullest(models: Array, cell: float, peaks: int) -> NDArray[np.int64]:
    """Numbers of the models in the cells of rotations with the most votes, those of the fullest first.

    Cells are of quaternions, in which a rotation and its neighbours are neighbours everywhere: each votes for q and
    for -q. A second grid, displaced by half a cell, has the votes together that the first one divides.
    """
    q = quaternions(models)
    width, chosen, sizes = np.radians(cell) / 2.0, [], []
    for shift in (0.0, 0.5):
        places = np.floor(np.vstack([q, -q]) / width + shift).astype(np.int64)
        cells, votes = np.unique((places * _HASH).sum(axis=1), return_inverse=True, return_counts=True)[1:]
        for number in np.argsort(-votes, kind="stable")[: 2 * peaks]:
            chosen.append(np.flatnonzero(cells.ravel() == number) % len(models))
            sizes.append(votes[number])
    order = np.argsort(-np.array(sizes), kind="stable")[: 2 * peaks]
    members = np.concatenate([chosen[number] for number in order])
    return members[np.sort(np.unique(members, return_index=True)[1])]


def quaternions(models: Array) -> Array:
    """Unit quaternions (M, 4), scalar last, of the rotations in models [s R | t] (M, 3, 4)."""
    from scipy.spatial.transform import Rotation

    linear = models[:, :, :3]
    return np.asarray(Rotation.from_matrix(linear / np.cbrt(np.linalg.det(linear))[:, None, None]).as_quat())


def hough(problem: Problem) -> Hough:
    """The randomised Hough transform for rotations."""
    return Hough()
