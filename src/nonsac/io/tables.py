"""Read rows of matched points, each row a point of an image and what it matches, from tables of any format."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from nonsac.files.arrays import Archive, as_rows, load_npy, open_npz
from nonsac.files.errors import FilePath, input_error
from nonsac.files.parquet import read_parquet
from nonsac.files.paths import choose_by_suffix
from nonsac.files.records import find_columns
from nonsac.files.text import read_table
from nonsac.io.clouds import TEXT_SUFFIXES
from nonsac.io.correspondences import CameraDescription, Points

WEIGHT = "weight"


@dataclass(frozen=True)
class Layout:
    """How tables name what they hold.

    Attributes
    ----------
    columns
        The columns of a row in text and Parquet: two of the image, then those of what it matches. The column
        ``weight`` may come with them.
    keys
        The pairs of keys that an NPZ file may use for the two parts of the rows.
    camera_keys
        For each camera, the keys that an NPZ file may use for it.
    """

    columns: tuple[str, ...]
    keys: tuple[tuple[str, str], ...]
    camera_keys: tuple[tuple[str, ...], ...]

    @property
    def widths(self) -> tuple[int, int]:
        """The possible numbers of columns: without and with a weight."""
        return len(self.columns), len(self.columns) + 1


@dataclass(frozen=True)
class Rows:
    """The rows of a table: points of the image, what they match, and where known their weights and the cameras."""

    first: Points
    second: Points
    weights: Points | None = None
    cameras: tuple[CameraDescription | None, ...] = ()


def read_rows(path: FilePath, layout: Layout) -> Rows:
    """Read the rows of a table; the suffix names the format.

    Parameters
    ----------
    path
        A file that ends in .npz, .npy, .parquet, .csv or another suffix of text.
    layout
        How the table names what it holds.

    Returns
    -------
    Rows
        As many points as what they match, and as many weights; at least one row.

    Raises
    ------
    InputError
        If the file cannot be read, is not what its suffix says, lacks columns or holds no matches.
    """
    rows = choose_by_suffix(path, _READERS)(path, layout)
    lengths = {len(part) for part in (rows.first, rows.second, rows.weights) if part is not None}
    if len(lengths) > 1:
        problem = f"holds parts of different lengths ({', '.join(map(str, sorted(lengths)))})"
        raise input_error(path, problem, "save one row of each part for every match")
    if not len(rows.first):
        raise input_error(path, "the file holds no matches", "export it again with its matches")
    return rows


def _read_npz(path: FilePath, layout: Layout) -> Rows:
    with open_npz(path) as archive:
        names = next((names for names in layout.keys if set(names) <= set(archive.names)), None)
        if names:
            widths = (2, len(layout.columns) - 2)
            first, second = (
                as_rows(path, archive.load(name), width) for name, width in zip(names, widths, strict=True)
            )
            rows = Rows(first, second)
        else:
            keys = " or ".join("/".join(names) for names in layout.keys)
            rows = _split(archive.load_only(layout.widths, f"save it under {keys}"), layout)
        if "weights" in archive.names:
            rows = replace(rows, weights=_load_weights(archive))
        return replace(rows, cameras=tuple(_load_camera(archive, names) for names in layout.camera_keys))


def _load_weights(archive: Archive) -> Points:
    weights = archive.load("weights")
    if weights.ndim != 1 or weights.dtype.kind not in "iuf":
        problem = f"the array weights has the shape {weights.shape} and the type {weights.dtype}"
        raise input_error(archive.path, problem, "save one number for every match")
    return np.asarray(weights, dtype=np.float64)


def _load_camera(archive: Archive, names: Sequence[str]) -> CameraDescription | None:
    name = next((name for name in names if name in archive.names), None)
    if name is None:
        return None
    camera = archive.load(name)
    if camera.dtype.kind == "U" and camera.ndim == 0:
        return str(camera)
    if camera.shape != (3, 3) or camera.dtype.kind not in "iuf":
        problem = f"the array {name} has the shape {camera.shape} and the type {camera.dtype}"
        raise input_error(archive.path, problem, "save a camera as a 3x3 matrix or as a line of COLMAP's cameras.txt")
    return np.asarray(camera, dtype=np.float64)


def _read_npy(path: FilePath, layout: Layout) -> Rows:
    rows = load_npy(path)
    with_weight = rows.shape[1:] == layout.widths[1:]
    return _split(as_rows(path, rows, layout.widths[with_weight]), layout)


def _read_text(path: FilePath, layout: Layout) -> Rows:
    table = read_table(path)
    if table.names is not None:
        return _split(table.numbers(_choose(path, layout, table.names)), layout)
    width = len(table.first_row())
    if width not in (0, *layout.widths):
        few, many = layout.widths
        problem = f"has {width} columns and no header, where {few} are needed, or {many} with a weight"
        raise input_error(path, problem, f"keep these, or add the header line {' '.join(layout.columns)}")
    return _split(table.numbers(range(width or layout.widths[0])), layout)


def _read_parquet(path: FilePath, layout: Layout) -> Rows:
    columns = read_parquet(path, partial(_choose, path, layout))
    return _split(as_rows(path, columns, columns.shape[1]), layout)


def _choose(path: FilePath, layout: Layout, names: Sequence[str]) -> list[int]:
    """Return the positions of the columns among names, which may be in lower case."""
    weight = [name for name in (WEIGHT,) if name in names]
    wanted = [name if name in names else name.lower() for name in layout.columns]
    return find_columns(path, names, wanted + weight, f"name the columns {' '.join(layout.columns)}")


def _split(rows: NDArray[np.float64], layout: Layout) -> Rows:
    width = len(layout.columns)
    first, second = np.ascontiguousarray(rows[:, :2]), np.ascontiguousarray(rows[:, 2:width])
    weights = np.ascontiguousarray(rows[:, width]) if rows.shape[1] > width else None
    return Rows(first, second, weights)


_READERS = {
    ".npz": _read_npz,
    ".npy": _read_npy,
    **dict.fromkeys(TEXT_SUFFIXES, _read_text),
    ".parquet": _read_parquet,
}
