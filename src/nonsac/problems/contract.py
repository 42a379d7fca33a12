"""What a problem has to know: the mathematics of one kind of model."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nonsac.kernels.ladder import count_on_ladder
from nonsac.layouts import Array, Layout, Rows

if TYPE_CHECKING:
    from nonsac.problems.noise import Noise
    from nonsac.problems.normal_equations import Streaming
    from nonsac.problems.special_case import SpecialCase
    from nonsac.result import Uncertainty

_BLOCK = 2**20  # residuals that are held at once


class ContractBroken(TypeError):
    """A problem or an estimator gave something else than its contract says; the message says what."""


class Problem(ABC):
    """The mathematics of one kind of model; derive a class from it to add a problem.

    `layout`, `minimal_size`, `solve_minimal`, `residuals` and `refit` are needed, and `model_shape` if models are not
    (3, 4). Everything else has a default, and is overridden if that pays or means more.

    A problem travels to workers, so it must pickle.

    Attributes
    ----------
    layout : Layout
        The columns of a row.
    minimal_size : int
        Rows that determine finitely many models, k.
    model_shape : tuple of int
        Shape of a model; (3, 4) unless the class says otherwise.
    residual_dimension : int
        How many independent errors of the same noise a residual is the length of: 1 for the distance of a point from
        a line, 2 for the distance of two points in an image.
    streaming : Streaming or None
        Sums over rows for refine="full"; None if the problem has none.
    """

    model_shape: tuple[int, ...] = (3, 4)
    residual_dimension: int = 1

    @property
    @abstractmethod
    def layout(self) -> Layout: ...

    @property
    @abstractmethod
    def minimal_size(self) -> int: ...

    @abstractmethod
    def solve_minimal(self, samples: Array) -> Array:
        """All models of one or more minimal samples (B, k, D): (M, *model_shape); M may be more or fewer than B."""

    @abstractmethod
    def residuals(self, models: Array, rows: Array) -> Array:
        """How far each row is from each model, in the unit of the noise: (M, N) for M models and rows (N, D)."""

    @abstractmethod
    def refit(self, model: Array, rows: Array, weights: Array) -> Array:
        """The least-squares model of weighted rows, started at `model`; NaN if the rows do not determine one.

        At least `minimal_size` rows have a positive weight, and perhaps no more than that.
        """

    # --- what has a default ----------------------------------------------------------------

    @property
    def streaming(self) -> Streaming | None:
        return None

    def count_inliers(self, models: Array, rows: Array, threshold: float, weights: Array | None = None) -> NDArray[Any]:
        """How many rows have a residual below the threshold, or what they weigh together: (M,)."""
        step = max(1, _BLOCK // max(1, len(rows)))
        blocks = [residuals_of(self, models[i : i + step], rows) < threshold for i in range(0, len(models), step)]
        if weights is None:
            return np.concatenate([np.empty(0, np.int64), *(block.sum(axis=1) for block in blocks)])
        return np.concatenate([np.empty(0), *(block @ weights for block in blocks)])

    def count_on_ladder(self, models: Array, rows: Array, thresholds: Array) -> NDArray[np.int64]:
        """How many rows have a residual below each threshold: (M, L), each the square root of two times the last."""
        counts = np.empty((len(models), len(thresholds)), np.int64)
        step = max(1, _BLOCK // max(1, len(rows)))
        for i in range(0, len(models), step):
            residuals = residuals_of(self, models[i : i + step], rows)
            count_on_ladder(residuals, float(thresholds[0]), self.minimal_size, counts[i : i + step])
        return counts

    def fit_robustly(self, model: Array, rows: Array, weights: Array, threshold: float, iterations: int) -> Array:
        """`refit` with Tukey's biweight loss, constant beyond the threshold; the start or NaN if there is none.

        By default iteratively reweighted least squares.
        """
        previous = np.zeros(len(rows))
        for _ in range(iterations):
            ratio = residuals_of(self, model[None], rows)[0] / threshold
            biweights = np.where(ratio < 1.0, (1.0 - ratio**2) ** 2, 0.0)
            if np.abs(biweights - previous).max(initial=0.0) < 1e-9:
                break
            fitted = refitted(self, model, rows, biweights * weights)
            if not np.isfinite(fitted).all():
                break
            model, previous = fitted, biweights
        return model

    def distance(self, a: Array, b: Array) -> Array:
        """How different two models are, in degrees; broadcasts over leading axes.

        By default the angle between their numbers as vectors: a multiple of a model is the same model.
        """
        axes = tuple(range(-len(self.model_shape), 0))
        a, b = (each / np.sqrt((each**2).sum(axis=axes, keepdims=True)) for each in (np.asarray(a), np.asarray(b)))
        chord = np.sqrt(np.minimum(((a - b) ** 2).sum(axis=axes), ((a + b) ** 2).sum(axis=axes)))
        return np.asarray(np.degrees(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))))

    def average(self, models: Array, rows: Array) -> Array:
        """The model with the least sum of distances to models (M, *model_shape), of which there is at least one.

        By default the best of themselves, by `distance`; a problem that knows the mean between them gives that. `rows`
        tell where models matter, and there may be none.
        """
        return np.asarray(models[int(np.argmin(sums_of_distances(self, models)))])

    def determined(self, model: Array, inliers: Array, noise: Noise) -> bool:
        """Whether these inlier rows, uncertain by the noise, pin the model down; the model may be NaN.

        There are at least `minimal_size` rows. By default whether so many are different.
        """
        return len(np.unique(inliers[np.isfinite(inliers).all(axis=1)], axis=0)) >= self.minimal_size

    def resolution(self, model: Array, inliers: Array, noise: Noise) -> Array | None:
        """Differences (D,) in each column below which rows say the same: some standard deviations of the noise.

        None, the default, if only equal rows do.
        """
        return None

    def standard_errors(self, model: Array, inliers: Array, noise: Noise) -> tuple[float, float] | None:
        """How uncertain rotation and translation are if inliers have this noise, in degrees; infinite if undetermined.

        A translation counts as the angle at which it is seen from the middle of the scene. None, the default, if the
        problem does not say; the verdict then does not ask either whether parts of the rows agree, as `distance` need
        not be one in degrees of rotation.
        """
        return None

    def share_of_one_motion(self, model: Array, rows: Array, noise: Noise) -> float:
        """Share of the squared residuals of these rows that one further motion explains, if each may move by its own.

        Near 1 if matches slip along a surface that looks the same all along. 0, the default, if residuals are not
        lengths of vectors.
        """
        return 0.0

    def background(self, rows: Array, size: int, rng: np.random.Generator) -> Array:
        """So many rows (size, D) as there would be if no model held, from which the verdict takes what chance does.

        By default, rows that match two things get their second half from another row: the distribution of either half
        stays, the matches are gone. With each such row there is that of the other two halves, so that nothing
        changes if the halves change places. Rows that match nothing are scattered: where the many are many stay, and
        lines, planes and circles are gone (`scattered`).
        """
        split, n = self.layout.split, len(rows)
        if split is None:
            return scattered(rows, size, rng)
        half = (size + 1) // 2
        first = rng.integers(n, size=half)
        second = (first + rng.integers(1, max(n, 2), size=half)) % n
        first, second = np.concatenate([first, second])[:size], np.concatenate([second, first])[:size]
        mixed = rows.take(first, axis=0)  # twice as fast as indexing
        mixed[:, split:] = rows.take(second, axis=0)[:, split:]
        return mixed

    def special_cases(self, model: Array, inliers: Array, noise: Noise) -> Sequence[SpecialCase]:
        """Special cases of the data that may explain the inliers, too: a planar scene, say. By default none."""
        return ()

    def twins(self, model: Array, inliers: Array, noise: Noise) -> Sequence[Array]:
        """Further models that the inliers may allow, one of which may fit better: those of the special cases."""
        return [other for case in self.special_cases(model, inliers, noise) for other in case.others]

    def remarks(self, model: Array, inliers: Array) -> Sequence[str]:
        """What else is to be said of a trusted model's inliers; see `Result.remarks`. By default nothing."""
        return ()

    def covariance(self, model: Array, inliers: Array, noise: Noise) -> Array | None:
        """Covariance (p, p) of the parameters of a fitted model; None if the problem knows none."""
        return None

    def uncertainty(self, covariance: Array, model: Array, inliers: Array) -> Uncertainty | None:
        """What such a covariance of the parameters means, in degrees and lengths; None if the problem does not say."""
        return None

    def transform(self, model: Array) -> Array | None:
        """The model as a matrix (4, 4), if it is a motion of points: what `Result.T` is. None if it is none."""
        return None

    def describe(self, model: Array) -> str:
        """A model in words, for people; for motions the result has words of its own."""
        numbers = np.array2string(np.asarray(model).ravel(), precision=6, max_line_width=10**6)
        return f"model {numbers}"

    # --- what follows from the above -------------------------------------------------------

    @property
    def width(self) -> int:
        """Numbers in a row, D, without a weight."""
        return len(self.layout.names)

    @property
    def no_model(self) -> Array:
        """What stands for a model if none was found: NaN."""
        return np.full(self.model_shape, np.nan)


def scattered(rows: Array, size: int, rng: np.random.Generator) -> Array:
    """So many rows (size, D) that are as dense as the given ones on the whole, but lie on no curve or surface.

    Each is the end of the way from one row to another after it was mirrored in a random direction; then all are drawn
    together as much as that spread them, so that means and variances stay, and a normal distribution nearly stays what
    it was. Columns are compared by their standard deviations, because they need not share a unit.
    """
    start, end = rows[rng.integers(len(rows), size=size)], rows[rng.integers(len(rows), size=size)]
    varied = np.ptp(rows, axis=0) > 0.0
    if not varied.any():
        return start
    mean, scale = rows[:, varied].mean(axis=0), rows[:, varied].std(axis=0)
    way, mirror = (end - start)[:, varied] / scale, rng.standard_normal((size, len(scale)))
    mirror /= np.linalg.norm(mirror, axis=1, keepdims=True)
    way -= 2.0 * mirror * (mirror * way).sum(axis=1, keepdims=True)
    start[:, varied] = mean + (start[:, varied] - mean + way * scale) / np.sqrt(1.0 + 4.0 / len(scale))
    return start


def background(problem: Problem, rows: Rows, size: int) -> Array:
    """So many background rows, the same each time."""
    return rows.kept(
        problem,
        ("background", size),
        lambda: problem.background(rows.values, size, np.random.default_rng(len(rows))),
    )


def solved(problem: Problem, samples: Array) -> Array:
    """The models of minimal samples, if they are what the contract says; none of samples that are singular."""
    if not len(samples):
        return np.empty((0, *problem.model_shape))
    try:
        models = np.asarray(problem.solve_minimal(samples), np.float64)
    except np.linalg.LinAlgError:  # NumPy raises it for all if one is singular
        if len(samples) == 1:
            return np.empty((0, *problem.model_shape))
        return np.concatenate([solved(problem, sample[None]) for sample in samples])
    if models.shape[1:] != tuple(problem.model_shape):
        name = type(problem).__name__
        raise ContractBroken(
            f"{name}.solve_minimal gave models of the shape {models.shape[1:]} instead of {problem.model_shape}: "
            f"return (M, *model_shape), and set {name}.model_shape"
        )
    return models


def refitted(problem: Problem, model: Array, rows: Array, weights: Array) -> Array:
    """`Problem.refit`, if enough rows have a weight; else NaN."""
    if np.count_nonzero(weights) < problem.minimal_size:
        return problem.no_model
    try:
        fitted = np.asarray(problem.refit(model, rows, weights), np.float64)
    except np.linalg.LinAlgError:
        return problem.no_model
    if fitted.shape != tuple(problem.model_shape):
        name = type(problem).__name__
        raise ContractBroken(f"{name}.refit gave a model of the shape {fitted.shape} instead of {problem.model_shape}")
    return fitted


def residuals_of(problem: Problem, models: Array, rows: Array) -> Array:
    """`Problem.residuals`, if they are what the contract says."""
    residuals = problem.residuals(models, rows)
    if np.shape(residuals) != (len(models), len(rows)):
        raise ContractBroken(
            f"{type(problem).__name__}.residuals gave the shape {np.shape(residuals)} for {len(models)} models and "
            f"{len(rows)} rows: return (M, N)"
        )
    return residuals


def sums_of_distances(problem: Problem, models: Array, most: float = np.inf) -> Array:
    """How far each model is from all others together (M,), none counting for more than `most` degrees."""
    step = max(1, _BLOCK // max(1, models.size))
    blocks = [problem.distance(models[i : i + step, None], models[None]) for i in range(0, len(models), step)]
    return np.concatenate([np.fmin(block, most).sum(axis=1) for block in blocks])


def check_attributes(problem: Problem) -> None:
    """Refuse a problem whose attributes are not what the contract says."""
    name, shape = type(problem).__name__, problem.model_shape
    if not isinstance(problem.layout, Layout):
        raise ContractBroken(
            f'{name}.layout must be a nonsac.Layout, such as nonsac.Layout("x1 y1 | x2 y2"), got {problem.layout!r}'
        )
    if not isinstance(shape, tuple) or not all(map(_is_count, shape)):
        raise ContractBroken(f"{name}.model_shape must be a tuple of integers, such as (3,) or (3, 3), got {shape!r}")
    for attribute in ("minimal_size", "residual_dimension"):
        value = problem.minimal_size if attribute == "minimal_size" else problem.residual_dimension
        if not _is_count(value):
            raise ContractBroken(f"{name}.{attribute} must be an integer of at least 1, got {value!r}")


def blame(problem: Problem, rows: Rows, threshold: float, error: Exception) -> None:
    """Raise ContractBroken if a problem's own methods raise, too, on rows in which an estimator failed."""
    size, method = problem.minimal_size, "solve_minimal"
    some = rows.values[: 2 * size]
    try:
        models = solved(problem, some[: len(some) // size * size].reshape(-1, size, problem.width))
        method = "residuals"
        residuals_of(problem, models, some)
        method = "count_inliers"
        problem.count_inliers(models, some, threshold)
        method = "refit"
        for model in models[:1]:
            refitted(problem, model, some, np.ones(len(some)))
    except ContractBroken:
        raise
    except Exception as own:
        name = type(problem).__name__
        raise ContractBroken(f"{name}.{method} raised {type(own).__name__}: {own}") from error


def _is_count(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and bool(value >= 1)


def rows_of(problem: Problem, table: Array) -> Rows:
    """The usable rows of a table of a source, with weights if it has a column more than the problem; no padding."""
    return Rows.of(table, problem.width).usable().without_padding()
