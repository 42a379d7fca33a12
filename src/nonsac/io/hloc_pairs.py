"""All pairs of images of hloc's files, and the database of COLMAP that they make."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from nonsac.cameras.camera import Camera
from nonsac.cameras.models import model_number
from nonsac.files.atomic import write_atomically
from nonsac.files.errors import FilePath, input_error
from nonsac.io.correspondences import Matches
from nonsac.io.hloc import HlocFiles
from nonsac.io.image_pairs import ImagePair, ImagePairs, listed_pairs
from nonsac.io.two_view_geometry import pair_id

_IMAGES_KEPT = 512  # whose keypoints are held in memory
_HALF_PIXEL = 0.5  # COLMAP has the centre of the first pixel there, hloc at 0

# As in the documentation of COLMAP 3; later versions read it, and add what they need.
_SCHEMA = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,
    width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,
    camera_id INTEGER NOT NULL, CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
    FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
    data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
    data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
    cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB);
"""

_INTO_CAMERAS = "INSERT INTO cameras VALUES (?, ?, ?, ?, ?, 1)"


@dataclass(frozen=True)
class HlocPairs(ImagePairs):
    """The pairs of a list, in its order, of files that are open.

    Attributes
    ----------
    cameras : dict, or Camera
        Of the images, by their names, or of all.
    """

    files: HlocFiles = field(repr=False)
    cameras: Mapping[str, Camera] | Camera

    @classmethod
    @contextmanager
    def open(
        cls, features: FilePath, matches: FilePath, listed: FilePath, cameras: Mapping[str, Camera] | Camera
    ) -> Iterator[HlocPairs]:
        """Open the files of features and of matches, and read the list of pairs.

        Raises
        ------
        InputError
            What `read_hloc` and `listed_pairs` raise.
        """
        unique = {tuple(sorted(names)): names for _, names in listed_pairs(listed)}
        pairs = tuple(ImagePair(names, names, None) for names in unique.values())
        if not pairs:
            raise input_error(listed, "lists no pairs", "write the names of two images in each line")
        with HlocFiles.open(features, matches) as files:
            yield cls(matches, pairs, files, cameras)

    def read(self, pair: ImagePair) -> Matches:
        """With points as COLMAP counts pixels."""
        first, second = pair.names
        found = self.files.matched(first, second, self._keypoints(first), self._keypoints(second))
        camera1, camera2 = (None if camera is None else str(camera) for camera in map(self.camera, pair.names))
        return replace(found, camera1=camera1, camera2=camera2)

    def camera(self, image: str) -> Camera | None:
        """Of an image; None if none is known."""
        return self.cameras if isinstance(self.cameras, Camera) else self.cameras.get(image)

    def write_database(self, output: Path) -> None:
        """Write a database of COLMAP with cameras, images, keypoints and matches.

        Images that share a camera of the list have one each, as hloc has it, unless there is one for all.

        Raises
        ------
        InputError
            If an image has no camera, or the size of its image is not known, or a file cannot be read or written.
        """
        write_atomically(output, self._write)

    def _write(self, path: Path) -> None:
        numbers = {name: k for k, name in enumerate(dict.fromkeys(n for pair in self.pairs for n in pair.names), 1)}
        with closing(sqlite3.connect(path)) as database, database:
            database.executescript(_SCHEMA)
            if isinstance(self.cameras, Camera):
                database.execute(_INTO_CAMERAS, self._camera_row(1, self.cameras))
            else:
                rows = (self._camera_row(number, self._known(name)) for name, number in numbers.items())
                database.executemany(_INTO_CAMERAS, rows)
            for name, number in numbers.items():
                camera = 1 if isinstance(self.cameras, Camera) else number
                database.execute("INSERT INTO images VALUES (?, ?, ?)", (number, name, camera))
                row = (number, *_blob(self._keypoints(name), "<f4"))
                database.execute("INSERT INTO keypoints VALUES (?, ?, ?, ?)", row)
            for pair in self.pairs:
                first, second = (numbers[name] for name in pair.names)
                indices = np.asarray(self.read(pair).indices)
                row = (pair_id([first, second]), *_blob(indices if first < second else indices[:, ::-1], "<u4"))
                database.execute("INSERT INTO matches VALUES (?, ?, ?, ?)", row)

    def _known(self, image: str) -> Camera:
        camera = self.camera(image)
        if camera is None:
            raise input_error(self.path, f"no camera is given for image {image!r}", "add a line for it to the list")
        return camera

    def _camera_row(self, number: int, camera: Camera) -> tuple[Any, ...]:
        if camera.width is None or camera.height is None:
            problem = f"the camera {camera} has no size, which a database of COLMAP holds"
            raise input_error(self.path, problem, "write width and height behind the name of its model")
        params = np.array(camera.params, "<f8").tobytes()
        return number, model_number(camera.model), camera.width, camera.height, params

    @cached_property
    def _keypoints(self) -> Any:
        return lru_cache(_IMAGES_KEPT)(lambda image: self.files.keypoints(image) + _HALF_PIXEL)


def _blob(array: Any, kind: str) -> tuple[int, int, bytes | None]:
    """Rows, columns and data, as COLMAP stores arrays (n, 2)."""
    return len(array), 2, np.ascontiguousarray(array, dtype=kind).tobytes() or None
