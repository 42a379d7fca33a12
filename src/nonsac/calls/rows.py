"""Correspondences as the calls take them, arrays side by side or one source of rows, made into a source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.calls.arguments import points_argument, weights_argument
from nonsac.layouts import Array, Layout
from nonsac.sources import ArraySource, JoinedSource, MappedSource
from nonsac.sources.columns import arranged
from nonsac.sources.contract import Source
from nonsac.sources.mapped import BySideMap, ColumnMap, Map

_FEW_ROWS = 1000


@dataclass(frozen=True)
class Correspondences:
    """The parts of all rows, or of some to look at; whether rows have a weight; and how to read them."""

    parts: tuple[NDArray[Any], ...]
    weighted: bool
    source: Source | None = None
    weights: Array | None = None

    def through(self, maps: Sequence[Map | None]) -> Source:
        """The rows, of which each part passes through a map if it has one."""
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
        if isinstance(first, (list, tuple)) and hasattr(first[0], "pt"):
            hint = ": pass the keypoints that matches name, [keypoints1[m.queryIdx] for m in matches] say"
        raise ValueError(f"{call} needs {name1}[i] to match {name2}[i]; got {len(a)} and {len(b)} rows{hint}")
    uneven = weights_argument(weights, len(a))
    return Correspondences((a, b), uneven is not None, weights=uneven)


def rows_of_source(source: Source, layout: Layout, name: str, **others: object) -> Correspondences:
    """Check a source that was passed in place of arrays, and arrange its columns by their names if it has names.

    Raises
    ------
    ValueError
        If the source has other columns or weights that are no use, or `others` are given, which it would have to hold.
    """
    for other, given in others.items():
        if given is not None:
            raise ValueError(f"{other} must be left out if {name} is a source, whose rows hold all")
    source, width = _arranged(source, layout, name), len(layout.names)
    some = _first_rows(source)
    _check_weights(source, some[:, width:], name)
    if source.width > width and _are_even(source):
        source = source.narrowed(range(width))
    return Correspondences(layout.parts(some), source.width > width, source)


def source_of_rows(source: Source, layout: Layout, name: str) -> Source:
    """The source with the columns of a layout, in its order; its first weights, if it has any, must be weights."""
    source, width = _arranged(source, layout, name), len(layout.names)
    if source.width > width:
        _check_weights(source, _first_rows(source)[:, width:], name)
    return source


def _arranged(source: Source, layout: Layout, name: str) -> Source:
    try:
        return arranged(source, layout)
    except ValueError as error:
        raise ValueError(f"{name} is a source with {error}") from None


def _check_weights(source: Source, some: Array, name: str) -> None:
    """Refuse weights (k, 1) of the first rows, or of all, that are none; (k, 0) if there are none."""
    if not some.size or (len(some) < len(source) and not (some < 0.0).any()):
        return
    try:
        weights_argument(some[:, 0], len(some))
    except ValueError as error:
        raise ValueError(
            f"{error}; the last column of {name} is taken as weights: if it is none, choose columns"
        ) from None


def _first_rows(source: Source) -> Array:
    return next(iter(source.chunks(_FEW_ROWS, 0, _FEW_ROWS)), np.empty((0, source.width)))


def _are_even(source: Source) -> bool:
    """Whether the last column, that of the weights, is the same positive number in all rows; known of arrays only."""
    if not _are_arrays(source) or not len(source):
        return False
    first = float(source.take(np.zeros(1, np.int64))[0, -1])
    few = (source.chunks(_FEW_ROWS, 0, _FEW_ROWS), source.chunks(2**16, _FEW_ROWS))  # weights mostly differ at once
    return 0.0 < first < np.inf and all((rows[:, -1] == first).all() for chunks in few for rows in chunks)


def _are_arrays(source: Source) -> bool:
    """Whether to read all rows is to look at arrays in memory."""
    if isinstance(source, MappedSource) and isinstance(source.map, ColumnMap):
        return _are_arrays(source.source)
    plain = isinstance(source, ArraySource) or (isinstance(source, JoinedSource) and not any(source.maps))
    return plain and source.about.in_memory


def spread_rows(source: Source, count: int, most_blocks: int) -> NDArray[np.int64]:
    """Numbers of at most so many rows, spread evenly over the source, or over some of its blocks."""
    blocks = source.about.blocks
    starts = np.array([0, len(source)]) if blocks is None else blocks
    filled = np.flatnonzero(np.diff(starts))
    chosen = filled[_evenly(len(filled), most_blocks)]
    sizes = np.diff(starts)[chosen]
    places = _evenly(int(sizes.sum()), count)
    ends = np.cumsum(sizes)
    inside = np.searchsorted(ends, places, side="right")
    return places - (ends - sizes)[inside] + starts[chosen][inside]


def _evenly(rows: int, count: int) -> NDArray[np.int64]:
    """At most `count` of `range(rows)`, at equal distances."""
    return np.arange(min(rows, count), dtype=np.int64) * rows // max(min(rows, count), 1)
