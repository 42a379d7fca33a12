"""The geometry of two views, as COLMAP stores it."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.io.correspondences import Points
from nonsac.values.quiet import quiet

# COLMAP numbers pairs by this constant of its own: there can be no more images.
MAX_IMAGES = 2147483647


class Configuration(IntEnum):
    """What kind of geometry a pair of views has, by COLMAP's numbers."""

    UNDEFINED = 0
    DEGENERATE = 1
    CALIBRATED = 2
    UNCALIBRATED = 3
    PLANAR = 4
    PANORAMIC = 5
    PLANAR_OR_PANORAMIC = 6
    WATERMARK = 7
    MULTIPLE = 8


@dataclass(frozen=True, eq=False)
class TwoViewGeometry:
    """What a row of COLMAP's table two_view_geometries holds, but for the inliers.

    Attributes
    ----------
    config : Configuration
    E : (3, 3) or None
        Essential matrix, of normalised coordinates: x2^T E x1 = 0.
    F, H : (3, 3) or None
        Fundamental matrix and homography, of pixels: x2^T F x1 = 0, x2 ~ H x1.
    rotation, translation : (3, 3) and (3,), or None
        X2 = R X1 + t.
    """

    config: Configuration
    E: Points | None = None
    F: Points | None = None
    H: Points | None = None
    rotation: Points | None = None
    translation: Points | None = None

    @classmethod
    @quiet
    def of_pose(
        cls,
        rotation: Points,
        translation: Points,
        matrices: Sequence[Points | None],
        config: Configuration = Configuration.CALIBRATED,
        H: Points | None = None,
    ) -> TwoViewGeometry:
        """From a pose with a baseline, and the matrices of the cameras; without F if one of them has no matrix."""
        x, y, z = translation / np.linalg.norm(translation)
        essential = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ rotation
        first, second = matrices
        fundamental = None
        if first is not None and second is not None:
            fundamental = np.linalg.inv(second).T @ essential @ np.linalg.inv(first)
        return cls(config, essential, fundamental, H, rotation, translation)

    def columns(self) -> dict[str, Any]:
        """What COLMAP stores, by the names of its columns."""
        arrays = {"F": self.F, "E": self.E, "H": self.H, "qvec": self._quaternion, "tvec": self.translation}
        blobs = {name: None if array is None else array.astype("<f8").tobytes() for name, array in arrays.items()}
        return {"config": int(self.config), **blobs}

    @property
    def _quaternion(self) -> Points | None:
        """Of the rotation, with w in front."""
        from scipy.spatial.transform import Rotation

        if self.rotation is None:
            return None
        return np.roll(Rotation.from_matrix(self.rotation).as_quat(), 1)


def pair_id(numbers: Sequence[int]) -> int:
    """COLMAP's number of a pair of images."""
    return min(numbers) * MAX_IMAGES + max(numbers)


class Rows:
    """The rows of the table two_view_geometries of a database that is open."""

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database
        # Older databases lack qvec and tvec, and some more.
        self._columns = {name for _, name, *_ in database.execute("PRAGMA table_info(two_view_geometries)")}

    def write(self, number: int, inliers: NDArray[np.integer], columns: dict[str, Any]) -> None:
        """Write that of a pair, whose inliers (k, 2) are in the order of its images, in place of what is there."""
        data = np.ascontiguousarray(inliers, dtype="<u4").tobytes() or None
        row = {"pair_id": number, "rows": len(inliers), "cols": 2, "data": data, **columns}
        row = {name: value for name, value in row.items() if name in self._columns or name not in columns}
        marks = ", ".join("?" * len(row))
        statement = f"INSERT OR REPLACE INTO two_view_geometries ({', '.join(row)}) VALUES ({marks})"
        self._database.execute(statement, tuple(row.values()))
