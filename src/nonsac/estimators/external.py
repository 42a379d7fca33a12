"""Somebody else's estimator as a core: any function from rows to a model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from nonsac.estimators.contract import Estimator
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem
from nonsac.problems.fits import biweight_costs
from nonsac.problems.noise import Noise
from nonsac.result import Hypothesis

Call = Callable[[Array, float, int], Any]


@dataclass(frozen=True)
class External(Estimator):
    """A function of another library, or of your own, that finds a model in rows.

    Residuals, inliers, the comparison of samples, the last fit and the verdict are the pipeline's. An exception, a
    model of the wrong shape or one that is not finite costs the sample that it came from, and the result says so.

    Parameters
    ----------
    call : callable
        `call(values, threshold, seed)` gives a model of the problem's own shape, or several (K, *shape) of which the
        one that fits best is taken, or None. `values` are the rows (N, D), without weights; `threshold` is the inlier
        threshold in the unit of the residual; `seed` is an int below 2^31. For processes and clusters it must pickle:
        a function of a module, not a lambda.
    needs : str, optional
        Module that the function imports, so that its lack is reported before anything is read.

    Examples
    --------
    >>> import cv2
    >>> def magsac(rows, threshold, seed):
    ...     return cv2.findHomography(rows[:, :2], rows[:, 2:], cv2.USAC_MAGSAC, threshold)[0]
    >>> estimator = External(magsac, needs="cv2")
    """

    call: Call
    needs: str | None = None

    def __post_init__(self) -> None:
        if self.needs is not None and not isinstance(self.needs, str):
            raise TypeError(f'needs must be the name of a module, such as "cv2", got {self.needs!r}')
        if not callable(self.call):
            raise TypeError(f"call must be a function of (values, threshold, seed), got {self.call!r}")

    def check(self, problem: Problem) -> None:
        if self.needs is not None and not _is_installed(self.needs):
            raise ValueError(f"this estimator needs the module {self.needs}, which is not installed: pip install it")

    def estimate(self, problem: Problem, rows: Rows, noise: Noise, rng: np.random.Generator) -> Hypothesis:
        answer = self.call(rows.values.copy(), noise.threshold, int(rng.integers(2**31)))
        models = _models(problem, answer)
        if not len(models):
            return Hypothesis(problem.no_model, np.full(len(rows), np.inf), noise.threshold, fault=_why_none(answer))
        best = models[int(np.argmin(biweight_costs(problem, models, rows, noise.threshold)))]
        return Hypothesis(best, problem.residuals(best[None], rows.values)[0], noise.threshold)


def _why_none(answer: Any) -> str:
    return "the function gave None" if answer is None else "the function gave no finite model"


def _is_installed(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # the package that it is in
        return False


def _models(problem: Problem, answer: Any) -> Array:
    """The finite models (K, *shape) that a function gave."""
    shape = tuple(problem.model_shape)
    if isinstance(answer, tuple):
        raise TypeError(f"the function gave a tuple of {len(answer)} (a model and a mask?): return the model alone")
    if np.iscomplexobj(answer):
        raise TypeError("the function gave complex numbers: return a model of real ones")
    models = np.empty((0, *shape)) if answer is None else np.asarray(answer, np.float64)
    if models.shape == shape:
        models = models[None]
    if models.shape[1:] != shape:
        raise ValueError(f"a model must have the shape {shape}, or (K, *shape) for several, got {models.shape}")
    return np.ascontiguousarray(models[np.isfinite(models).all(axis=tuple(range(1, models.ndim)))])
