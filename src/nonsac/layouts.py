"""What columns a row has, and rows with their weights."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Value = TypeVar("Value")

WEIGHT = "weight"
_ORIENTATIONS = 4


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
    copies : int
        How many more there were that are equal to one of these, and were left out.
    """

    values: Array
    weights: Array | None = None
    copies: int = 0
    _kept: dict[Hashable, tuple[object, Any]] = field(default_factory=dict, init=False, repr=False)

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

    def without_padding(self) -> Rows:
        """Rows that are equal to many others count once: padding, missing measurements, stuck sensors.

        Four may be equal: feature detectors describe a point in several orientations, and matches that agree in more
        than one of them are right more often than others.
        """
        chosen = distinct(self.values, self.weights, at_most=_ORIENTATIONS)
        return self if len(chosen) == len(self) else replace(self[chosen], copies=len(self) - len(chosen))

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

    def kept(self, owner: object, name: Hashable, make: Callable[[], Value]) -> Value:
        """What was made of these rows before under this name for the same owner; made now, if nothing was."""
        key = id(owner), name
        if key not in self._kept:
            self._kept[key] = owner, make()  # an owner that is gone would leave its id to another
        return self._kept[key][1]

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


def distinct(rows: Array, weights: Array | None = None, at_most: int = 1) -> NDArray[np.int64]:
    """Numbers of the different ones of some rows (N, D), in their order; of equal rows the one with the most weight.

    Up to `at_most` rows may be equal; of more, one is left.
    """
    repeated = _perhaps_repeated(rows)
    some = rows[repeated]
    if not len(some):
        return np.arange(len(rows))
    order = np.lexsort(some.T if weights is None else (-weights[repeated], *some.T))
    ordered = some[order]
    is_first = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))
    group = np.cumsum(is_first) - 1
    others = ~is_first & (np.bincount(group)[group] > at_most)
    return np.delete(np.arange(len(rows)), repeated[order[others]])


def _perhaps_repeated(rows: Array) -> NDArray[np.int64]:
    """Numbers of the rows that share a hash with another one; sorting them all as they are takes ten times as long."""
    hashes = hashed(rows)
    ordered = np.sort(hashes)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(twice):
        return np.empty(0, np.int64)
    return np.flatnonzero(twice[np.minimum(np.searchsorted(twice, hashes), len(twice) - 1)] == hashes)


def hashed(rows: Array) -> NDArray[np.uint64]:
    """A number for each row (N, D): equal rows have the same, and different ones hardly ever do."""
    bits = np.ascontiguousarray(rows + 0.0).view(np.uint64)  # a zero may be negative
    hashes = np.zeros(len(rows), np.uint64)
    for column in bits.T:
        hashes = (hashes ^ (hashes >> np.uint64(29)) ^ column) * np.uint64(0x9E3779B97F4A7C15)
    return hashes
