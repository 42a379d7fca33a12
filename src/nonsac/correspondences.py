"""Correspondences as the calls take them, arrays side by side or one source of rows, made into a source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.arguments import points_argument, weights_argument
from nonsac.result import Array
from nonsac.sources import JoinedSource, MappedSource, Source
from nonsac.sources.mapped import BySideMap, ColumnMap, Map

WEIGHT = "weight"
_FEW_ROWS = 1000


@dataclass(frozen=True)
class Columns:
    """The columns of a row, as tables name them, and how many of them each part of it has."""

    names: tuple[str, ...]
    widths: tuple[int, ...]

    def parts(self, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """The columns of each part."""
        return tuple(np.split(rows[:, : len(self.names)], np.cumsum(self.widths)[:-1], axis=1))


MATCHES = Columns(("x1", "y1", "x2", "y2"), (2, 2))
POINTS = Columns(("u", "v", "X", "Y", "Z"), (2, 3))
PAIRS = Columns(("x1", "y1", "z1", "x2", "y2", "z2"), (3, 3))


@dataclass(frozen=True)
class Correspondences:
    """The parts of all rows, or of some to look at; whether rows have a weight; and how to read them."""

    parts: tuple[NDArray[Any], ...]
    weighted: bool
    source: Source | None = None
    weights: Array | None = None

    def through(self, maps: Sequence[Map | None]) -> Source:
        """The rows, of which each part passes through a map where it has one."""
        maps = [*maps, None] if self.weighted else list(maps)
        if self.source is None:
            weights = [] if self.weights is None else [self.weights[:, None]]
            return JoinedSource([*self.parts, *weights], maps)
        if not any(maps):
            return self.source
        widths = [part.shape[1] for part in self.parts]
        return MappedSource(self.source, BySideMap([*widths, 1] if self.weighted else widths, maps))


def rows_of_arrays(
    call: str, arrays: dict[str, Any], widths: Sequence[int], weights: ArrayLike | None, hint: str = ""
) -> Correspondences:
    """Check two arrays, named as the user knows them, and their weights."""
    (name1, first), (name2, second) = arrays.items()
    a, b = points_argument(first, name1, widths[0]), points_argument(second, name2, widths[1])
    if len(a) != len(b):
        raise ValueError(f"{call} needs {name1}[i] to match {name2}[i]; got {len(a)} and {len(b)} rows{hint}")
    uneven = weights_argument(weights, len(a))
    return Correspondences((a, b), uneven is not None, weights=uneven)


def rows_of_source(source: Source, columns: Columns, name: str, **others: object) -> Correspondences:
    """Check a source that was passed in place of arrays, and pick its columns by their names where it has these.

    Raises
    ------
    ValueError
        Where the source has another number of columns, or `others` are given, which it would have to hold.
    """
    for other, given in others.items():
        if given is not None:
            raise ValueError(f"{other} must be left out where {name} is a source, whose rows hold all")
    try:
        source = pick_columns(source, columns)
    except ValueError as error:
        raise ValueError(f"{name} is a source with {error}") from None
    some = next(iter(source.chunks(_FEW_ROWS, 0, _FEW_ROWS)), np.empty((0, source.width)))
    weighted = source.width > len(columns.names)
    return Correspondences(columns.parts(some), weighted, source)


def pick_columns(source: Source, columns: Columns) -> Source:
    """The source with the columns of these names, and the weight, if it has them; else as it is, if it fits.

    As it is, too, where `open_source` was told which columns to take: their order is that of the user.

    Raises
    ------
    ValueError
        Where it has another number of columns, or some of these names at other places and lacks the rest; the message
        says how many, and which.
    """
    names, width = tuple(getattr(source, "names", None) or ()), len(columns.names)
    given = getattr(source, "columns_given", False)
    places = [None if given else _place(name, names) for name in columns.names]
    chosen = [names[place] for place in places if place is not None]
    if len(chosen) == width:
        return _with_columns(source, [*chosen, WEIGHT] if WEIGHT in names else chosen)
    held = f"rows of {source.width} columns" + (f" ({' '.join(names)})" if names else "")
    if source.width not in (width, width + 1):
        expected = f"{width} ({' '.join(columns.names)}), or {width + 1} with a weight"
        raise ValueError(f"{held}, not of {expected}; choose columns")
    if any(place not in (None, position) for position, place in enumerate(places)):
        missing = " ".join(name for name, place in zip(columns.names, places, strict=True) if place is None)
        raise ValueError(f"{held}, of which none is called {missing}; rename the columns, or choose others")
    return source


def spread_rows(source: Source, count: int, most_blocks: int) -> NDArray[np.int64]:
    """Numbers of at most so many rows, spread evenly over the source, or over some of its blocks."""
    starts = getattr(source, "block_starts", np.array([0, len(source)]))
    blocks = np.flatnonzero(np.diff(starts))
    blocks = blocks[_evenly(len(blocks), most_blocks)]
    sizes = np.diff(starts)[blocks]
    places = _evenly(int(sizes.sum()), count)
    ends = np.cumsum(sizes)
    inside = np.searchsorted(ends, places, side="right")
    return places - (ends - sizes)[inside] + starts[blocks][inside]


def _place(name: str, names: Sequence[str]) -> int | None:
    """Where a name is, in whatever case; the exact one is preferred."""
    if name in names:
        return names.index(name)
    folded = [other.lower() for other in names]
    return folded.index(name.lower()) if folded.count(name.lower()) == 1 else None


def _with_columns(source: Source, chosen: Sequence[str]) -> Source:
    names = list(source.names)  # type: ignore[attr-defined]
    if list(chosen) == names:
        return source
    if hasattr(source, "with_columns"):
        return source.with_columns(chosen)
    return MappedSource(source, ColumnMap(tuple(names.index(name) for name in chosen)))


def _evenly(rows: int, count: int) -> NDArray[np.int64]:
    """At most `count` of `range(rows)`, at equal distances."""
    return np.arange(min(rows, count), dtype=np.int64) * rows // max(min(rows, count), 1)
