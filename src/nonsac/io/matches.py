"""Matched rows of any file: tables, which are opened as sources, and what hloc and COLMAP write."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.cameras.unreadable import camera_or_error, check_readable
from nonsac.files.arrays import open_npz
from nonsac.files.content import content_kind
from nonsac.files.errors import FilePath, input_error
from nonsac.files.paths import is_folder, is_url, read_head
from nonsac.io.clouds import read_cloud
from nonsac.io.colmap_database import pair_of_database
from nonsac.io.colmap_model import points_of_model
from nonsac.io.correspondences import CameraDescription, Matches, PointMatches, Points
from nonsac.io.flow import is_flow, read_flow
from nonsac.io.hloc import read_hloc
from nonsac.io.matchers import is_of_a_matcher, read_matcher
from nonsac.layouts import MATCHES, PAIRS, POINTS, Layout
from nonsac.sources import JoinedSource
from nonsac.sources.contract import Source
from nonsac.sources.open import holds_rows, open_source
from nonsac.values.checks import file_name, listed

_HDF5 = (".h5", ".hdf5")
_CLOUDS, _KINDS_OF_CLOUDS = (".ply", ".pcd", ".las", ".laz"), ("PLY file", "PCD file", "LAS file")
_HEAD_LENGTH = 4096
_SMALL = 64_000_000  # bytes

Image = str | int


@dataclass(frozen=True, eq=False)
class Opened:
    """Matched rows, and what else their file says.

    Attributes
    ----------
    source : Source
        The columns of the layout, in its order, and a weight in the last one, if the file has weights.
    cameras : tuple
        For each camera of the layout a 3x3 matrix, or a line or dict in the form of COLMAP; None if it is not known;
        something that `nonsac.Camera.parse` refuses if it cannot be read, which does not matter if another is used.
    indices : (n, 2) int64 or None
        Which keypoints of the two images match, if the file numbers them.
    """

    source: Source
    cameras: tuple[CameraDescription | None, ...] = ()
    indices: NDArray[np.int64] | None = None

    @property
    def is_small(self) -> bool:
        """Whether all rows may be read into memory."""
        return self.source.bytes_to_take(len(self.source)) < _SMALL


def open_matches(
    layout: Layout,
    files: Sequence[FilePath],
    images: Sequence[Image | None] = (),
    columns: Sequence[str | int] | None = None,
    dataset: str | None = None,
) -> Opened:
    """Open matched rows of any format.

    Parameters
    ----------
    layout : Layout
        `MATCHES`, `POINTS` or `PAIRS` of `nonsac.layouts`.
    files : sequence of path
        One table (see `nonsac.open_source`), file of optical flow, COLMAP database or folder of a COLMAP model; or
        two: the features and the matches of hloc, or two clouds whose points match row by row.
    images : sequence of str or int
        Names or numbers of the images, for files with many.
    columns, dataset
        For a table, as in `nonsac.open_source`.

    Returns
    -------
    Opened

    Raises
    ------
    InputError
        If a file cannot be read, is not what its name says, or lacks columns, images or rows.
    """
    files, images = listed("files", files, "a sequence of paths"), listed("images", images, "names or numbers")
    if not files:
        raise ValueError("files must name at least one file")
    for file in files:
        file_name("files", file)
    first, named = files[0], [image for image in images if image is not None]
    if len(files) > 2:
        raise input_error(files[2], "is one file too many", "give one file, or two that belong together")
    if (columns is not None or dataset is not None) and (len(files) == 2 or named):
        raise input_error(first, "only a table by itself has columns or a dataset to choose", "leave them out")
    if len(files) == 2:
        return _of_two(layout, files[0], files[1], named)
    if named:
        return _of_images(layout, first, named)
    if columns is None and dataset is None and not is_url(first):
        _refuse_collections(layout, first)
        if layout == MATCHES and is_flow(first):
            return _of_arrays(read_flow(first))
        if layout == MATCHES and is_of_a_matcher(first, but_for=(*layout.keys, layout.names)):
            opened = _of_arrays(read_matcher(first))
            return replace(opened, cameras=_cameras_in(layout, first, may_count_from_0=True))
    source = open_source(first, layout=layout, columns=columns, dataset=dataset)
    if not len(source):
        raise input_error(first, "the file holds no matches", "export it again with its matches")
    return Opened(source, _cameras_in(layout, first))


def read_matches(path: FilePath, image1: Image | None = None, image2: Image | None = None) -> Matches:
    """Read the matches between two images.

    Parameters
    ----------
    path
        A table of matches, of any kind that `nonsac.open_source` knows, with the columns x1, y1, x2, y2 and perhaps
        weight, in any order, or with four or five columns without names. An NPZ file has the keys ``points1`` and
        ``points2``, or ``x1`` and ``x2``, or one array (n, 4) or (n, 5), and perhaps ``weights`` and the cameras
        ``camera1`` and ``camera2``, or ``K1`` and ``K2``; those of SuperGlue, LightGlue, LoFTR, RoMa and MASt3R have
        the keys that these programs give, those of optical flow the key ``flow``. Or the flow of a Middlebury file
        (.flo) or of a 16-bit PNG of KITTI, or a COLMAP database (.db).
    image1, image2
        For a database, the names or numbers of the two images; not for a table.

    Returns
    -------
    Matches
        In the unit and order of the file. Rows with NaN or infinite coordinates are kept.

    Raises
    ------
    InputError
        If the file cannot be read, is not what its suffix says or, if images are named, no database, or lacks columns,
        images or matches.
    """
    opened = open_matches(MATCHES, [path], [image1, image2])
    (first, second), weights = _all_rows(opened.source, MATCHES)
    camera1, camera2 = opened.cameras
    check_readable(camera1, camera2)
    return Matches(first, second, weights, camera1, camera2, opened.indices)


def read_points(path: FilePath, image: Image | None = None) -> PointMatches:
    """Read the matches between an image and points in space.

    Parameters
    ----------
    path
        A table of matches, of any kind that `nonsac.open_source` knows, with the columns u, v, X, Y, Z and perhaps
        weight, in any order, or with five or six columns without names. An NPZ file has the keys ``points2d`` and
        ``points3d``, or ``x`` and ``X``, or one array (n, 5) or (n, 6), and perhaps ``weights`` and the camera
        ``camera`` or ``K``. Or the folder of a COLMAP model.
    image
        For a model, the name or number of the image; not for a table.

    Returns
    -------
    PointMatches
        In the unit and order of the file. Rows with NaN or infinite coordinates are kept.

    Raises
    ------
    InputError
        If the file cannot be read, is not what its suffix says or, if an image is named, no model, or lacks columns,
        the image or matches.
    """
    opened = open_matches(POINTS, [path], [image])
    (first, second), weights = _all_rows(opened.source, POINTS)
    (camera,) = opened.cameras
    check_readable(camera)
    return PointMatches(first, second, weights, camera)


def read_pairs(path: FilePath, second: FilePath | None = None) -> tuple[Points, Points]:
    """Read pairs of matched points, from one file of pairs or from two clouds of equal length.

    Parameters
    ----------
    path
        Without `second`, a table of pairs, of any kind that `nonsac.open_source` knows, with the columns x1, y1, z1,
        x2, y2 and z2, in any order, or with six columns without names; an NPZ file has the keys ``source`` and
        ``target``, or ``src`` and ``tgt``, or one array (n, 6). With `second`, the source: any file that `read_cloud`
        takes.
    second
        The target cloud; its points match those of the source, row by row.

    Returns
    -------
    source, target : ndarray of float64, shape (n, 3)
        The pairs in the unit and order of the file. Those with NaN or infinite coordinates are kept.

    Raises
    ------
    InputError
        If a file cannot be read, is not what its suffix says or holds no pairs, or the lengths differ.
    """
    opened = open_matches(PAIRS, [path] if second is None else [path, second])
    (first, other), _ = _all_rows(opened.source, PAIRS)
    return first, other


def _all_rows(source: Source, layout: Layout) -> tuple[tuple[Points, ...], Points | None]:
    """The parts of all rows, and their weights."""
    rows = np.concatenate([np.empty((0, source.width)), *source.chunks(2**20)])
    parts = tuple(np.ascontiguousarray(part) for part in layout.parts(rows))
    return parts, np.ascontiguousarray(rows[:, -1]) if source.width > len(layout.names) else None


# --- files that hold more than one table ---------------------------------------------------------


def _of_two(layout: Layout, first: FilePath, second: FilePath, images: Sequence[Image]) -> Opened:
    if layout == PAIRS:
        source, target = read_cloud(first), read_cloud(second)
        if len(source) != len(target):
            problem = f"holds {len(source)} points and {second} holds {len(target)}, so they are no pairs"
            raise input_error(first, problem, "for unmatched clouds use `nonsac register-clouds`")
        return Opened(JoinedSource([source, target]))
    if layout != MATCHES:
        raise input_error(second, "a second file is for pairs of images or of clouds", "give one file of matches")
    if len(images) != 2:
        problem = f"hloc keeps the matches of many images, of which {len(images) or 'none'} is named"
        raise input_error(second, problem, "name two, as image1 and image2")
    image1, image2 = map(str, images)
    return _of_arrays(read_hloc(first, second, image1, image2))


def _of_images(layout: Layout, path: FilePath, images: Sequence[Image]) -> Opened:
    if layout == MATCHES and len(images) == 2:
        return _of_arrays(pair_of_database(path, *images))
    if layout == POINTS and len(images) == 1:
        points = points_of_model(path, *images)
        return Opened(_joined(points.points2d, points.points3d, points.weights), (points.camera,))
    if layout == MATCHES:
        raise input_error(path, "matches are those of two images", "name two, as image1 and image2, or none")
    if layout == POINTS:
        raise input_error(path, "points are those of one image", "name one, as image")
    raise input_error(path, "pairs of points have no images", "leave their names out")


def _of_arrays(matches: Matches) -> Opened:
    source = _joined(matches.points1, matches.points2, matches.weights)
    return Opened(source, (matches.camera1, matches.camera2), matches.indices)


def _joined(first: Points, second: Points, weights: Points | None) -> Source:
    return JoinedSource([first, second] if weights is None else [first, second, weights[:, None]])


def _refuse_collections(layout: Layout, path: FilePath) -> None:
    """Say what is missing for files that hold the matches of many images, or one cloud."""
    suffix = Path(path).suffix.lower()
    kind = content_kind(read_head(os.fspath(path), _HEAD_LENGTH)) if os.path.isfile(path) else ""
    if layout == MATCHES and (suffix == ".db" or kind == "SQLite database"):
        raise input_error(path, "a database holds the matches of many images", "name two, as image1 and image2")
    if layout == MATCHES and suffix in _HDF5 and os.path.isfile(path):
        problem = "hloc keeps matches apart from the keypoints they match"
        fix = "give both files, to nonsac.io.read_hloc say (or, for rows of another HDF5 file, name its dataset)"
        raise input_error(path, problem, fix)
    if layout == POINTS and os.path.isdir(path) and not holds_rows(os.fspath(path)):
        raise input_error(path, "a model holds many images", "name one of them, as image")
    if layout == PAIRS and (suffix in _CLOUDS or kind in _KINDS_OF_CLOUDS):
        raise input_error(path, "this format is for one cloud, not for pairs", "give the target as the second file")


def _cameras_in(layout: Layout, path: FilePath, may_count_from_0: bool = False) -> tuple[CameraDescription | None, ...]:
    """The cameras of an archive, by their keys; None for those that it lacks."""
    nothing: tuple[CameraDescription | None, ...] = (None,) * len(layout.cameras)
    if not nothing or is_url(path) or is_folder(os.fspath(path)) or not os.path.isfile(path):
        return nothing
    if content_kind(read_head(os.fspath(path), _HEAD_LENGTH)) != "NumPy archive":
        return nothing
    with open_npz(path) as archive:
        from_0 = may_count_from_0 and not {"K0", "camera0"}.isdisjoint(archive.names)
        keys = (("camera0", "K0"), ("camera1", "K1")) if from_0 else layout.cameras
        return tuple(camera_or_error(partial(_camera, archive, names)) for names in keys)


def _camera(archive: Any, names: Sequence[str]) -> CameraDescription | None:
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
