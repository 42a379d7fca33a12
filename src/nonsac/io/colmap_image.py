"""What COLMAP's models say of an image."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nonsac.files.errors import FilePath, not_held
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


# The number and the name of an image, and what reads the rest.
Listed = tuple[int, str, Callable[[], ModelImage]]


def find_image(path: FilePath, images: Iterable[Listed], image: str | int) -> ModelImage:
    """Return the one of a file's images that has this name or number.

    Raises
    ------
    InputError
        If there is none, or what reading raises.
    """
    names = []
    for number, name, read in images:
        if image in (number, name):
            return read()
        names.append(name if isinstance(image, str) else str(number))
    raise not_held(path, f"image {image!r}", names)
