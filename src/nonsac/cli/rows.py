"""Tables that are opened as sources: the large ones, and those that only sources read."""

from __future__ import annotations

import glob
import os
from dataclasses import replace
from typing import TYPE_CHECKING

import typer

from nonsac.cli.inputs import blaming
from nonsac.cli.messages import say

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from nonsac.layouts import Columns
    from nonsac.result import Array, Result
    from nonsac.sources.contract import Source

_DRAWN, _LOOKED_AT = (5000, 8), (1000, 1)  # rows, of so many blocks
_LARGE = 64_000_000  # bytes
_WHOLE_WHERE_SMALL = (".npy", ".parquet")
_ALWAYS_WHOLE = (".npz", ".db", ".txt", ".csv", ".xyz", ".asc", ".pts", ".ply", ".pcd")
_ARROW = (".parquet", ".pq", ".parq", ".arrow", ".feather", ".ipc")
_KINDS = ("NumPy array", "HDF5 file", "LAS file", "Parquet file", "Arrow file")


def opens_as_source(file: str, columns: str | None, dataset: str | None) -> bool:
    """Whether a file is to be read in pieces: it is large, only sources read its kind, or options ask for it."""
    if columns is not None or dataset is not None or "://" in file:
        return True
    if os.path.isdir(file):
        return _holds_rows(file)
    if not os.path.isfile(file):
        return glob.has_magic(file)
    suffix = os.path.splitext(file)[1].lower()
    if suffix in _WHOLE_WHERE_SMALL:
        return os.path.getsize(file) > _LARGE
    return suffix not in _ALWAYS_WHOLE and _kind(file) in _KINDS


def open_rows(file: str, layout: Columns | None, columns: str | None, dataset: str | None) -> Source:
    """The source of a file, with the columns of a layout where it names them."""
    from nonsac.sources.columns import pick_columns
    from nonsac.sources.open import open_source

    source = open_source(file, columns=columns_of(columns), dataset=dataset)
    if layout is None:
        return source
    with blaming(file):
        return pick_columns(source, layout)


def columns_of(text: str | None) -> list[str | int] | None:
    """Names and positions, separated by commas."""
    if text is None:
        return None
    words = [word.strip() for word in text.split(",")]
    if not all(words):
        raise typer.BadParameter(
            f"{text!r} is no list of columns such as x1,y1,x2,y2 or 0,1,2,3", param_hint="'--columns'"
        )
    return [int(word) if word.isdecimal() else word for word in words]


def some_rows(source: Source, layout: Columns, picture: Path | None) -> tuple[Array, Array]:
    """Both parts of the rows that are drawn, where there is a picture, or looked at."""
    first, second = layout.parts(source.take(_places(source, picture)))
    return first, second


def seen_there(result: Result, source: Source | None, picture: Path | None) -> Result:
    """The result, whose residuals and inliers are those of `some_rows`."""
    from nonsac.sources import ArraySource

    if source is None or result.evidence is None:
        return result
    rows = result.evidence.source.take(_places(source, picture))
    return replace(result, evidence=replace(result.evidence, source=ArraySource(rows)))


def note_share(source: Source | None, picture: Path | None, quiet: bool) -> None:
    """Say where a picture does not show all."""
    if source is not None and picture is not None and len(source) > _DRAWN[0] and not quiet:
        say(f"{picture} shows {_DRAWN[0]:,} of {len(source):,} rows")


def _places(source: Source, picture: Path | None) -> NDArray[np.int64]:
    from nonsac.calls.rows import spread_rows

    return spread_rows(source, *(_LOOKED_AT if picture is None else _DRAWN))


def _holds_rows(folder: str) -> bool:
    """Whether it is a Zarr array or has Parquet or Arrow files, and is not the folder of a COLMAP model, say."""
    if any(os.path.exists(os.path.join(folder, name)) for name in ("zarr.json", ".zarray", ".zgroup")):
        return True
    return any(name.lower().endswith(_ARROW) for _, _, names in os.walk(folder) for name in names)


def _kind(file: str) -> str:
    from nonsac.files.content import content_kind

    with open(file, "rb") as opened:
        return content_kind(opened.read(4096))
