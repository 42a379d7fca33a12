"""Matches between two images, and between an image and points in space, as the readers return them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
CameraDescription = Points | str | dict[str, Any]


@dataclass(frozen=True, eq=False)
class Matches:
    """Points of two images; row i of the one matches row i of the other.

    Attributes
    ----------
    points1, points2
        Shape (n, 2), in pixels, in the order and with the origin that the file has. Rows with NaN are kept.
    weights
        Shape (n,), larger if a match is more certain; None if nothing tells them apart.
    camera1, camera2
        A 3x3 matrix, or a line or dict in the form of COLMAP, for `nonsac.Camera.parse`; None if unknown.
    indices
        Shape (n, 2): which keypoints of the two images these are; None if the source does not number them.
    """

    points1: Points
    points2: Points
    weights: Points | None = None
    camera1: CameraDescription | None = None
    camera2: CameraDescription | None = None
    indices: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        """The number of matches."""
        return len(self.points1)


@dataclass(frozen=True, eq=False)
class PointMatches:
    """Points of an image; row i of them shows row i of the points in space.

    Attributes
    ----------
    points2d
        Shape (n, 2), in pixels, in the order and with the origin that the file has. Rows with NaN are kept.
    points3d
        Shape (n, 3), in the unit of the file.
    weights
        Shape (n,), larger if a match is more certain; None if nothing tells them apart.
    camera
        A 3x3 matrix, or a line or dict in the form of COLMAP, for `nonsac.Camera.parse`; None if unknown.
    """

    points2d: Points
    points3d: Points
    weights: Points | None = None
    camera: CameraDescription | None = None

    def __len__(self) -> int:
        """The number of matches."""
        return len(self.points2d)
