"""What a problem has to know."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from numpy.typing import NDArray

from nonsac.result import Array


@runtime_checkable
class Problem(Protocol):
    """The mathematics of one kind of model. A row is one correspondence, of `width` numbers.

    A problem may have further methods, which are used where they are there:

    - `refit_robustly(model, rows, weights, threshold, iterations)`: `refit` with Tukey's biweight loss, in one go.
    - `simpler_models(model, inliers, threshold)`: special cases that may explain the inliers too, as `Simpler` objects.
    - `covariance(model, inliers, threshold)`: of the parameters of a fitted model, (p, p).
    - `pivot(rows)`, `normal_equations(model, rows, weigher, pivot)` and `moved(model, step, pivot)`: a step of Newton's
      method from sums over rows, in parameters about a pivot (3,), and the residuals; refine="full" needs them.
    - `residual_dimension`: how many independent errors of the same noise a residual is the length of; 1 if left out.
    - `row_weights(rows)`: weights of the rows, (N,), as `Weighted` has.
    """

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

    def count_inliers(self, models: Array, rows: Array, threshold: float) -> NDArray[Any]:
        """How many rows have a residual below the threshold: (M,), or what they weigh together."""
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


def residual_dimension(problem: Problem) -> int:
    """How many independent errors of the same noise a residual is the length of."""
    return getattr(problem, "residual_dimension", 1)
