"""What COLMAP's models say of an image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nonsac.io.correspondences import Points


@dataclass(frozen=True, eq=False)
class ModelImage:
    """An image of a COLMAP model.

    Attributes
    ----------
    camera
        The number of its camera.
    quaternion
        Shape (4,), the rotation from the world to the camera as w, x, y, z.
    translation
        Shape (3,), from the world to the camera.
    xy
        Shape (n, 2), all keypoints.
    points
        Shape (n,), the numbers of the points in space that the keypoints show, -1 if there is none.
    """

    camera: int
    quaternion: Points
    translation: Points
    xy: Points
    points: NDArray[np.int64]
