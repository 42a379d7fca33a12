"""A draw of some blocks: which ones, and whether rows of a block are more alike than others."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nonsac.layouts import WEIGHT, Array
from nonsac.method.sampling import union_rows
from nonsac.method.search import Search
from nonsac.result import Remark
from nonsac.seeds import permutation
from nonsac.sources import HeldSource, SomeBlocksSource
from nonsac.sources.contract import Source

_LEAST_BLOCKS = 16
_STREAM = 2**63  # of the seed: those from 0 on are passes over the rows
_ROWS, _FALSE_ALARMS = 100_000, 1e-3
_RARE = 5  # rows of a kind in a block

Blocks = NDArray[np.int64]


def drawn_blocks(source: Source, least_rows: int, seed: int) -> Source:
    """The rows of some blocks at random, at least 16, that hold so many rows; the source itself if all are needed.

    Rows that can be read one by one are cut into runs of neighbours, if that makes a difference (`About.run`).
    """
    about = source.about
    if about.blocks is not None:
        chosen = _some_of(about.blocks, least_rows, seed)
        firsts, ends = about.blocks[chosen], about.blocks[chosen + 1]
    elif about.run > 1:
        count = -(-len(source) // about.run)
        wanted = max(_LEAST_BLOCKS, 1 + -(-least_rows // about.run))  # the last run may be short
        firsts = about.run * np.sort(permutation(count, 0, min(wanted, count), seed, _STREAM))
        ends = np.minimum(firsts + about.run, len(source))
    else:
        return source
    drawn = SomeBlocksSource(source, firsts, ends)
    return drawn if len(drawn) < len(source) else source


def _some_of(starts: Blocks, least_rows: int, seed: int) -> Blocks:
    """Numbers of blocks with rows, sorted: as many as hold so many rows."""
    filled = np.flatnonzero(np.diff(starts))
    order = filled[permutation(len(filled), 0, len(filled), seed, _STREAM)]
    enough = 1 + int(np.searchsorted(np.cumsum(np.diff(starts)[order]), least_rows))
    return np.sort(order[: max(_LEAST_BLOCKS, enough)])


def blocks_behind(source: Source) -> SomeBlocksSource | None:
    """The blocks that were drawn; None if rows were."""
    source = source.source if isinstance(source, HeldSource) else source
    return source if isinstance(source, SomeBlocksSource) else None


def remarks_on_blocks(search: Search, model: Array | None) -> tuple[str, ...]:
    """What is said if blocks were drawn whose rows are more alike than rows of different blocks."""
    source, problem = search.task.source, search.problem
    drawn = blocks_behind(source)
    if drawn is None:
        return ()
    rows = union_rows(len(source), 0, search.task.seed, min(_ROWS, search.max_rows))
    table = source.take(rows)
    finite = np.isfinite(table).all(axis=1)
    table, blocks = table[finite], drawn.blocks_of(rows[finite])
    scores = [*_scores((*problem.layout.names, WEIGHT), table)]
    if model is not None:
        inliers = problem.residuals(model[None], table[:, : problem.width])[0] < search.noise.threshold
        scores.append(("being an inlier", inliers.astype(np.float64)))
    most = most_alike(scores, blocks)
    if most is None:
        return ()
    share, name = most
    return (Remark.BLOCKS_DIFFER.detailed(f"{_percent(share)} of the variance of {name} is between blocks"),)


def _percent(share: float) -> str:
    """Two digits, without an exponent."""
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def most_alike(scores: Sequence[tuple[str, Array]], blocks: Blocks) -> tuple[float, str] | None:
    """What is most alike within blocks, and how much, if anything is; of a thousand files in random order one is told.

    Parameters
    ----------
    scores : sequence of (str, (n,) float64)
        What they are called, and their values.
    blocks : (n,) int64
        Which block each row lies in.
    """
    found = [(alikeness(values, blocks), name) for name, values in scores]
    bound = math.log(_FALSE_ALARMS / max(len(found), 1))
    return max(((alike.share, name) for alike, name in found if alike.log_chance < bound), default=None)


def _scores(names: tuple[str, ...], table: Array) -> Iterator[tuple[str, Array]]:
    """Where rows lie, how far from the middle, and how two columns go together, whatever their units and outliers."""
    ranks = [_ranks(column) for column in table.T]
    for place, (name, rank) in enumerate(zip(names, ranks, strict=False)):
        yield name, rank
        yield f"{name} squared", rank * rank
        for other, beside in zip(names[:place], ranks[:place], strict=True):
            yield f"{other} times {name}", beside * rank


def _ranks(column: Array) -> Array:
    """From -1 to 1; equal values have the mean of their ranks."""
    _, places, counts = np.unique(column, return_inverse=True, return_counts=True)
    middles = np.cumsum(counts) - 0.5 * counts
    return np.asarray((2.0 / len(column)) * middles[places] - 1.0)


class Alikeness(NamedTuple):
    """How alike scores are within blocks.

    Attributes
    ----------
    share : float
        Of the variance, what is between blocks (the intra-class correlation of one-way analysis of variance).
    log_chance : float
        Logarithm of a bound for the probability of so much in random order.
    """

    share: float
    log_chance: float


def alikeness(scores: Array, blocks: Blocks) -> Alikeness:
    """How alike scores (n,) are within blocks (n,), numbers from 0 on.

    In random order, the sum of squares between k blocks over the variance (Kruskal and Wallis, 1952, if the scores are
    ranks) follows a chi-squared distribution with k - 1 degrees of freedom, whose tail is bounded (Laurent and
    Massart, 2000, Lemma 1). That needs more than a few rows of each kind in each block: for less nothing is said.
    """
    counts = np.bincount(blocks)
    filled = counts > 0
    counts = counts[filled]
    rows, freedom = len(scores), len(counts) - 1
    centred = scores - scores.mean()
    squares = centred * centred
    total = float(squares.sum())
    if freedom < 1 or rows <= 2 * len(counts) or not total > 0.0:
        return Alikeness(0.0, 0.0)
    size = rows / len(counts)
    if rows * float(squares @ squares) / total**2 > size / _RARE:  # the kurtosis, one over the share of a rare kind
        return Alikeness(0.0, 0.0)
    between = float(np.sum(np.bincount(blocks, centred)[filled] ** 2 / counts))
    ratio = (between / freedom) / max((total - between) / (rows - len(counts)), 1e-300)
    share = max(ratio - 1.0, 0.0) / (ratio - 1.0 + size)
    excess = between * (rows - 1) / total - freedom  # 2 sqrt(freedom x) + 2 x at most, with probability 1 - exp(-x)
    x = ((math.sqrt(freedom + 2.0 * max(excess, 0.0)) - math.sqrt(freedom)) / 2.0) ** 2
    return Alikeness(share, -x)
