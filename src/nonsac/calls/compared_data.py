"""What methods are compared on: a problem, the rows that they see, and those that they are judged on."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac import problems
from nonsac.calls.arguments import check_source
from nonsac.calls.jobs import is_path
from nonsac.calls.poses import look_like_pixels
from nonsac.calls.registry import CALLS, Call
from nonsac.calls.rows import rows_of_arrays, rows_of_source, source_of_rows
from nonsac.cameras.camera import Camera
from nonsac.cameras.unreadable import chosen_cameras
from nonsac.layouts import Array, Rows
from nonsac.problems.contract import Problem, check_attributes, rows_of
from nonsac.seeds import permutation
from nonsac.sources import NpySource, WithoutRows
from nonsac.sources.contract import Source
from nonsac.values.numeric import as_real, shown

_MOST_JUDGED, _SHARE_JUDGED, _MOST_BLOCKS = 20_000, 5, 16
_MUCH, _AT_ONCE = 64_000_000, 2**16  # bytes, and rows
_STREAM = 7  # of the seed, so that rows are judged on that are not the first ones of the samples

COMPARED = tuple(name for name, call in CALLS.items() if call.layout_name)


@dataclass(frozen=True, eq=False)
class ComparedData:
    """The problem; the rows that methods see; and rows that none of them sees."""

    problem: Problem
    seen: Source
    held_out: Rows
    call: str = ""

    @property
    def num_rows(self) -> int:
        return len(self.seen) + len(self.held_out)


def split(source: Source, problem: Problem, seed: int, call: str = "") -> ComparedData:
    """Hold out some of the rows: a fifth of them, 20,000 at most, of some blocks of a file that comes in blocks."""
    chosen = _chosen(source, min(_MOST_JUDGED, len(source) // _SHARE_JUDGED), seed)
    table = source.take(chosen)
    usable = rows_of(problem, table[np.isfinite(table).all(axis=1)])
    return ComparedData(problem, WithoutRows(source, chosen), usable, call)


@contextmanager
def shareable(source: Source) -> Iterator[Source]:
    """The source; one of much data in memory as a file, of which each process reads what it needs and holds no copy."""
    size = 8 * source.width * len(source)
    if not source.about.in_memory or size < _MUCH:
        yield source
        return
    with TemporaryDirectory(prefix="nonsac-") as folder:
        path = Path(folder) / "rows.npy"
        written = np.lib.format.open_memmap(path, "w+", np.float64, (len(source), source.width))
        start = 0
        for rows in source.chunks(_AT_ONCE):
            written[start : start + len(rows)] = rows
            start += len(rows)
        del written  # which flushes it
        yield NpySource(path)


def _chosen(source: Source, count: int, seed: int) -> NDArray[np.int64]:
    blocks = source.about.blocks
    if blocks is None or len(blocks) <= _MOST_BLOCKS + 1:
        return np.sort(permutation(len(source), 0, count, seed, _STREAM))
    drawn = np.sort(permutation(len(blocks) - 1, 0, _MOST_BLOCKS, seed, _STREAM))
    sizes = np.diff(blocks)[drawn]
    ends = np.cumsum(sizes)
    places = np.sort(permutation(int(ends[-1]), 0, min(count, int(ends[-1]) // 2), seed, _STREAM))
    inside = np.searchsorted(ends, places, side="right")
    return places - (ends - sizes)[inside] + blocks[drawn][inside]


# --- from the arguments of a call ----------------------------------------------------------


def opened(call: str | Problem, data: Sequence[Any], settings: dict[str, Any]) -> tuple[Source, Problem]:
    """The rows of arrays, files or a source, in the unit of a problem, and the problem.

    Raises
    ------
    ValueError, TypeError
        If the data are no use for the call, or it has no such settings; the message names the argument.
    """
    if isinstance(call, Problem):
        check_attributes(call)
        if len(data) != 1 or settings:
            raise TypeError("with a problem of your own, data must be one source of rows, and there are no settings")
        check_source("data", data[0])
        return source_of_rows(data[0], call.layout, "data"), call
    if not isinstance(call, str) or call.replace("-", "_") not in COMPARED:
        raise ValueError(f"call must be one of {', '.join(COMPARED)}, or a problem, got {shown(call)}")
    return _of_call(CALLS[call.replace("-", "_")], data, dict(settings))


def _of_call(call: Call, data: Sequence[Any], settings: dict[str, Any]) -> tuple[Source, Problem]:
    known = ("weights", "scale", "columns", "dataset", *call.cameras, *call.images)
    known = tuple(name for name in known if name != "scale" or name in call.own)
    for name in settings:
        if name not in known:
            raise TypeError(f"compare has no setting {name!r} for {call.name}; it has {', '.join(known)}")
    if not data:
        raise TypeError(f"compare needs data: what {call.name} takes first, files or a source")
    rows, in_file = _rows_of(call, data, settings)
    given = [settings.get(name) for name in call.cameras]
    if len(given) == 2 and given[0] is None and given[1] is not None:
        raise ValueError("camera1 must be given if camera2 is")
    cameras = _cameras(call, chosen_cameras(given, in_file) if in_file else given)
    if call.cameras and cameras[0] is None and look_like_pixels(rows.parts[0]):
        raise ValueError(f"the points look like pixels, not like normalised coordinates: pass {call.cameras[0]}")
    maps = [None if camera is None else camera.normalise for camera in cameras]
    maps += [None] * (len(rows.parts) - len(maps))
    return rows.through(maps), _problem_of(call, cameras, settings)


def _rows_of(call: Call, data: Sequence[Any], settings: dict[str, Any]) -> Any:
    layout, weights = call.layout, settings.get("weights")
    assert layout is not None
    columns, dataset = settings.get("columns"), settings.get("dataset")
    if all(map(is_path, data)):
        from nonsac.io import open_matches

        images = [settings.get(name) for name in call.images]
        file = open_matches(layout, data, images, columns, dataset)
        return rows_of_source(file.source, layout, "data", weights=weights), file.cameras
    if columns is not None or dataset is not None:
        raise ValueError("columns and dataset are for a file; leave them out, or choose columns with open_source")
    if isinstance(data[0], Source) and len(data) == 1:
        return rows_of_source(data[0], layout, "data", weights=weights), ()
    names = list(inspect.signature(call.function).parameters)[:2]
    if len(data) != 2:
        raise TypeError(f"compare takes {' and '.join(names)} for {call.name}, a source, or files; got {len(data)}")
    return rows_of_arrays("compare", dict(zip(names, data, strict=True)), layout.widths, weights), ()


def _cameras(call: Call, given: Sequence[Any]) -> list[Camera | None]:
    """Those of all images; the second is by default the first."""
    parsed = [
        None if camera is None else Camera.parse(camera, name) for camera, name in zip(given, call.cameras, strict=True)
    ]
    return [camera or parsed[0] for camera in parsed]


def _problem_of(call: Call, cameras: Sequence[Camera | None], settings: dict[str, Any]) -> Problem:
    make = getattr(problems, call.problem_name)
    if "scale" in call.own:
        return make(settings.get("scale", 1.0))
    return make(*(camera.focal for camera in cameras if camera is not None))


# --- the truth -----------------------------------------------------------------------------


def truth_of(truth: Any, problem: Problem) -> Array | None:
    """The true model in the problem's own shape, from a matrix or a file of one.

    Raises
    ------
    ValueError, TypeError
        If it is none.
    """
    if truth is None:
        return None
    matrix = _read_truth(truth) if is_path(truth) else truth
    try:
        array = np.asarray(matrix, np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"truth must be a matrix or the name of a file, got {shown(truth)}") from None
    shape = tuple(problem.model_shape)
    if shape == (3, 4) and array.shape == (4, 4):
        array = array[:3]
    if array.shape != shape:
        expected = "(4, 4)" if shape == (3, 4) else str(shape)
        raise ValueError(f"truth must be a matrix of the shape {expected}, got the shape {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError("truth must be finite, got a matrix that is not")
    if problem.transform(array) is not None:
        _check_motion(array)
    return np.ascontiguousarray(array)


def _check_motion(model: Array) -> None:
    product, determinant = model[:, :3] @ model[:, :3].T, float(np.linalg.det(model[:, :3]))
    scale = as_real(np.cbrt(max(determinant, 0.0)) ** 2)
    if determinant <= 0.0 or np.abs(product - scale * np.eye(3)).max() > 1e-3 * scale:
        raise ValueError("truth must hold a rotation (times a scale), R R^T = s^2 I and det R > 0, got another matrix")


def _read_truth(path: Any) -> Array:
    from nonsac.io.transforms import read_truth

    return read_truth(path)
