"""What a run would read, hold and take, told before any of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from nonsac.method.block_draw import drawn_blocks
from nonsac.method.budget import LARGEST_SIZE
from nonsac.method.settings import Draw, descriptions
from nonsac.running.memory import bytes_for
from nonsac.sources import MappedSource
from nonsac.sources.contract import Source
from nonsac.values.numeric import as_whole, shown

_ROWS_OF_THE_LAST_FIT, _MOST_SAMPLES = 100_000, 100
_BYTES_A_SECOND = 200e6
_SECONDS_A_SAMPLE, _SECONDS_A_ROW = 0.1, 5e-6


@dataclass(frozen=True)
class Plan:
    """What a run costs, as far as the source can tell; times are guesses for one core and a middling disk.

    Attributes
    ----------
    kind : str
        Class of the source.
    rows, columns : int
        Of the source.
    blocks : int or None
        In how many pieces its rows come that can only be read whole; None if rows are read one by one.
    samples, sample_size : int
        Of the run. With samples="auto" it may be 2, or 100.
    rows_read, bytes_read : int
        By this run, in all samples and the last fit, if none is read twice. Bytes are those of the file, 0 in memory.
    bytes_of_all : int
        That one pass over all rows reads, as for `result.inliers`.
    memory : int
        Bytes that the run needs, beside some 200 MB for Python and its libraries and the data that are in memory.
    seconds, seconds_of_all : float
        Of the run, without compiling, and of reading all rows.
    """

    kind: str
    rows: int
    columns: int
    blocks: int | None
    samples: int
    sample_size: int
    rows_read: int
    bytes_read: int
    bytes_of_all: int
    memory: int
    seconds: float
    seconds_of_all: float

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    def __str__(self) -> str:
        blocks = "" if self.blocks is None else f", in {self.blocks:,} blocks that are read whole"
        return "\n".join(
            [
                f"{self.rows:,} rows of {self.columns} columns{blocks} ({self.kind})",
                f"a run with {self.samples:,} samples of {self.sample_size:,} rows, estimated:",
                f"  reads   {self.rows_read:,} rows, {_size(self.bytes_read)}, if none is read twice",
                f"  holds   {_size(self.memory)}, beside some 200 MB for Python and its libraries",
                f"  takes   {_time(self.seconds)}, if 200 MB are read in a second and a sample takes 0.1 s",
                f"one pass over all rows, as for all inliers: {_size(self.bytes_of_all)}, {_time(self.seconds_of_all)}",
            ]
        )


def plan(source: Source, *, samples: int = 10, sample_size: int = 2000, draw: Draw = "rows") -> Plan:
    """Tell what a run on this source would read, hold and take, from what the source says of itself.

    Nothing but the description of the data is read. The run has samples of the default size, as many as suffice for
    most data, and a last fit to 100,000 rows. It is an estimate: with many outliers more samples are drawn, and those
    of a later round may read a block once more.

    Parameters
    ----------
    source : Source
        Of any kind; see `nonsac.open_source`.
    samples, sample_size : int
        As in `nonsac.estimate`.
    draw : "rows" or "blocks"
        Likewise.

    Returns
    -------
    Plan

    Raises
    ------
    ValueError
        If a number is not positive, or `draw` is something else.
    """
    for name, value in (("samples", samples), ("sample_size", sample_size)):
        if not 1 <= (as_whole(value) or 0) <= 2**53:
            raise ValueError(f"{name} must be a positive integer, got {shown(value)}")
    samples, sample_size = int(samples), int(sample_size)
    descriptions()["draw"].check(draw)
    if not isinstance(source, Source):
        raise TypeError(f"source must be a source of rows, got {shown(source)}; see nonsac.open_source")
    rows = len(source)
    read = min(rows, max(_ROWS_OF_THE_LAST_FIT, samples * sample_size))
    drawn = drawn_blocks(source, max(read, _MOST_SAMPLES * LARGEST_SIZE), seed=0) if draw == "blocks" else source
    bytes_read, bytes_of_all = drawn.bytes_to_take(read), source.bytes_to_take(rows)
    starts = source.about.blocks
    return Plan(
        kind=type(_innermost(source)).__name__,
        rows=rows,
        columns=source.width,
        blocks=None if starts is None else len(starts) - 1,
        samples=samples,
        sample_size=sample_size,
        rows_read=read,
        bytes_read=bytes_read,
        bytes_of_all=bytes_of_all,
        memory=bytes_for(read, source),
        seconds=bytes_read / _BYTES_A_SECOND + samples * _SECONDS_A_SAMPLE + read * _SECONDS_A_ROW,
        seconds_of_all=bytes_of_all / _BYTES_A_SECOND,
    )


def _innermost(source: Source) -> Source:
    return _innermost(source.source) if isinstance(source, MappedSource) else source


def _size(count: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def _time(seconds: float) -> str:
    if seconds < 1:
        return "less than 1 s"
    if seconds < 120:
        return f"about {seconds:.0f} s"
    return f"about {seconds / 60:.0f} min" if seconds < 7200 else f"about {seconds / 3600:.0f} h"
