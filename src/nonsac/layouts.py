"""What columns a row has, and rows with their weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WEIGHT = "weight"


@dataclass(frozen=True)
class Layout:
    """The columns of a row: their names, and how they fall into the two things that a row matches.

    Parameters
    ----------
    columns : str
        Names separated by spaces, with a bar between the two things that a row matches: "x1 y1 | x2 y2". Rows that
        match nothing, such as the points of a line, have no bar: "x y".
    keys : tuple of (str, str)
        Pairs of keys under which archives (.npz) hold both parts of the rows.
    cameras : tuple of tuple of str
        For each camera, the keys under which archives hold it.

    Attributes
    ----------
    names : tuple of str
    widths : tuple of int
        How many columns each part has.
    split : int or None
        Column at which a row splits into the two things that it matches; None if it matches nothing.
    """

    columns: str
    keys: tuple[tuple[str, str], ...] = field(default=(), compare=False)
    cameras: tuple[tuple[str, ...], ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.columns, str):
            raise TypeError(f'columns must be names in one string, as "x1 y1 | x2 y2", got {self.columns!r}')
        if "," in self.columns:
            raise ValueError(f'columns must be names separated by spaces, as "x1 y1 | x2 y2", got {self.columns!r}')
        if not self.names or len(set(self.names)) < len(self.names) or not all(self.widths) or len(self.widths) > 2:
            raise ValueError(
                f'columns must be different names, with at most one bar between them ("x1 y1 | x2 y2"), '
                f"got {self.columns!r}"
            )

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(self.columns.replace("|", " ").split())

    @cached_property
    def widths(self) -> tuple[int, ...]:
        return tuple(len(part.split()) for part in self.columns.split("|"))

    @property
    def split(self) -> int | None:
        return self.widths[0] if len(self.widths) == 2 else None

    def parts(self, rows: Array) -> tuple[Array, ...]:
        """The columns of each part of rows (n, D), of which a weight is left out."""
        return tuple(np.split(rows[:, : len(self.names)], np.cumsum(self.widths)[:-1], axis=1))


MATCHES = Layout(
    "x1 y1 | x2 y2", (("points1", "points2"), ("x1", "x2")), cameras=(("camera1", "K1"), ("camera2", "K2"))
)
POINTS = Layout("u v | X Y Z", (("points2d", "points3d"), ("x", "X")), cameras=(("camera", "K"),))
PAIRS = Layout("x1 y1 z1 | x2 y2 z2", (("source", "target"), ("src", "tgt")))


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a problem, and how much each counts.

    Attributes
    ----------
    values : (N, D) float64
    weights : (N,) float64 or None
        Not negative, in any unit; None if all rows count alike.
    """

    values: Array
    weights: Array | None = None

    @classmethod
    def of(cls, table: Array, width: int) -> Rows:
        """The rows of a table (N, width), or (N, width + 1) with a weight in the last column; see `usable`."""
        if table.shape[1] == width:
            return cls(table)
        return cls(np.ascontiguousarray(table[:, :width]), np.ascontiguousarray(table[:, width]))

    def usable(self) -> Rows:
        """The rows without those that hold a value that is not finite, or whose weight is no positive number."""
        usable = np.isfinite(self.values).all(axis=1)
        if self.weights is not None:
            usable &= np.isfinite(self.weights) & (self.weights > 0.0)
        return self if usable.all() else self[usable]

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """The rows of several parts, one after the other."""
        weights = [part.weights for part in parts if part.weights is not None]
        values = np.concatenate([part.values for part in parts])
        return cls(values, np.concatenate(weights) if len(weights) == len(parts) else None)

    @property
    def mean_weights(self) -> Array | None:
        """The weights scaled to a mean of 1: how many rows of mean weight each row counts for."""
        if self.weights is None:
            return None
        total = self.weights.sum()
        return np.asarray(self.weights * (len(self.weights) / total)) if total > 0.0 else self.weights

    def times(self, factors: Array) -> Array:
        """Factors (N,), times the weights if there are weights."""
        return factors if self.weights is None else factors * self.weights

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, chosen: Any) -> Rows:
        """Some of the rows, by a slice, a mask or their numbers."""
        return Rows(self.values[chosen], None if self.weights is None else self.weights[chosen])

    def some(self, most: int) -> Rows:
        """At most so many of the rows, in their order, the same each time."""
        if len(self) <= most:
            return self
        return self[np.sort(np.random.default_rng(len(self)).choice(len(self), most, replace=False))]
