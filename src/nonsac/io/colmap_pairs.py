"""All matched pairs of a COLMAP database, and the geometries that are found of them."""

from __future__ import annotations

import hashlib
import os
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from nonsac.cameras.unreadable import camera_or_error
from nonsac.files.atomic import write_atomically
from nonsac.files.errors import FilePath, input_error
from nonsac.io.colmap_database import described_camera, keypoints_of
from nonsac.io.colmap_sqlite import damaged, open_database, unpack
from nonsac.io.correspondences import Matches
from nonsac.io.image_pairs import ImagePair, ImagePairs
from nonsac.io.two_view_geometry import MAX_IMAGES, Rows, pair_id

_IMAGES_KEPT = 512  # whose keypoints are held in memory
_CAMERAS = "SELECT camera_id, model, width, height, params, prior_focal_length FROM cameras ORDER BY camera_id"


@dataclass(frozen=True)
class DatabasePairs(ImagePairs):
    """The pairs of a database that is open, as it was when it was opened.

    Attributes
    ----------
    pairs
        Those with an entry in the table of matches, in the order of COLMAP's numbers; the image of the smaller number
        is the first one.
    calibrated : dict
        By the numbers of the images, whether the focal length of their camera is known rather than a guess.
    fingerprint : str
        Differs if images, cameras or numbers of matches do.
    """

    database: sqlite3.Connection = field(repr=False)
    calibrated: dict[int, bool] = field(repr=False)
    fingerprint: str

    @classmethod
    @contextmanager
    def open(cls, path: FilePath) -> Iterator[DatabasePairs]:
        """Open a database for reading.

        Raises
        ------
        InputError
            If it cannot be read, is no database of COLMAP, is locked or damaged, or holds no matches.
        """
        version = _version(path)
        with open_database(path) as database:
            images = database.execute("SELECT image_id, name, camera_id FROM images ORDER BY image_id").fetchall()
            cameras = database.execute(_CAMERAS).fetchall()
            matches = database.execute("SELECT pair_id, rows FROM matches ORDER BY pair_id").fetchall()
            if not matches:
                raise input_error(path, "the database holds no matches", "match its images first")
            digest = hashlib.sha256(repr((images, cameras, matches)).encode()).hexdigest()
            names = {int(number): str(name) for number, name, _ in images}
            known = {camera[0] for camera in cameras if camera[-1]}
            calibrated = {int(number): camera in known for number, _, camera in images}
            pairs = tuple(_pair(path, names, *row) for row in matches)
            yield cls(path, pairs, database, calibrated, digest[:16])
            if _version(path) != version:
                problem = "was changed by another program while it was read"
                raise input_error(path, problem, "verify it again when that is done, or with --resume")

    def is_calibrated(self, pair: ImagePair, name: str | None = None) -> bool:
        images = zip(pair.images, pair.names, strict=True)
        return all(self.calibrated[int(image)] for image, known in images if name in (None, known))

    def read(self, pair: ImagePair) -> Matches:
        first, second = (int(image) for image in pair.images)
        keypoints1, keypoints2 = self._keypoints(first), self._keypoints(second)
        indices = _indices(self.path, self.database, pair)
        if (indices.max(axis=0, initial=-1) >= (len(keypoints1), len(keypoints2))).any():
            raise damaged(self.path, "a match names a keypoint that is not there")
        points1, points2 = keypoints1[indices[:, 0]], keypoints2[indices[:, 1]]
        return Matches(points1, points2, None, self._camera(first), self._camera(second), indices)

    @cached_property
    def _keypoints(self) -> Any:
        return lru_cache(_IMAGES_KEPT)(lambda image: keypoints_of(self.path, self.database, image))

    @cached_property
    def _camera(self) -> Any:
        return lru_cache(None)(lambda image: camera_or_error(lambda: described_camera(self.path, self.database, image)))


def _version(path: FilePath) -> tuple[int, int]:
    """What changes with the file, which a journal beside it may delay."""
    status = os.stat(path)
    return status.st_size, status.st_mtime_ns


Found = tuple[ImagePair, NDArray[np.bool_], dict[str, Any], int]


def write_geometries(path: FilePath, output: FilePath, rows: Iterable[Found]) -> None:
    """Write geometries of two views, each in place of what is there, all of them or none.

    Parameters
    ----------
    path
        The database.
    output
        A copy that is written, and appears when it is complete; or the database itself, which is written in one
        transaction, as other programs may have it open.
    rows
        Pairs, which of their matches are inliers, the columns of `TwoViewGeometry`, and the checksum of the matches.

    Raises
    ------
    InputError
        If the database is locked, has changed since the pairs were read, or the file cannot be written.
    """
    if is_same_file(path, output):
        _insert(path, rows)
        return

    def write(temporary: Path) -> None:
        with open_database(path) as source, closing(sqlite3.connect(temporary)) as copy:
            source.backup(copy)
        _insert(temporary, rows)

    write_atomically(output, write)


def checksum(indices: NDArray[np.int64]) -> int:
    """Of the matches (k, 2) of a pair."""
    return crc32(np.ascontiguousarray(indices, np.int64).tobytes())


def is_same_file(path: FilePath, other: FilePath) -> bool:
    """Whether two names are of one file that is there."""
    return Path(other).exists() and Path(other).samefile(path)


def check_writable(path: FilePath) -> None:
    """Take the lock for writing, and give it back.

    Raises
    ------
    InputError
        If the database is read-only, or locked by another program.
    """
    with open_database(path, write=True):
        pass


def _insert(path: FilePath, rows: Iterable[Found]) -> None:
    with open_database(path, write=True) as database:
        written = Rows(database)
        for pair, are_inliers, columns, verified in rows:
            indices = _indices(path, database, pair)
            if checksum(indices) != verified:
                problem = f"the matches of {' and '.join(pair.names)} have changed since they were verified"
                raise input_error(path, problem, "verify them again")
            written.write(_number(pair), indices[are_inliers], columns)


def _indices(path: FilePath, database: sqlite3.Connection, pair: ImagePair) -> NDArray[np.int64]:
    """Which keypoints of a pair match (k, 2)."""
    query = "SELECT rows, cols, data FROM matches WHERE pair_id = ?"
    row = database.execute(query, (_number(pair),)).fetchone()
    names = " and ".join(map(repr, pair.names))
    if row is None:  # though it was listed
        raise damaged(path, f"it does not find the matches of {names}")
    return np.array(unpack(path, row, "<u4", f"the matches of {names}")[:, :2], dtype=np.int64)


def _number(pair: ImagePair) -> int:
    """COLMAP's number of a pair of a database."""
    return pair_id([int(image) for image in pair.images])


def _pair(path: FilePath, names: dict[int, str], number: Any, count: Any) -> ImagePair:
    first, second = divmod(number, MAX_IMAGES) if isinstance(number, int) else (-1, -1)
    if first not in names or second not in names or first >= second or not isinstance(count, int):
        raise damaged(path, f"the pair {number} is not one of its images")
    return ImagePair((first, second), (names[first], names[second]), count)
