"""Read what an image shows, and where it was taken, from a sparse model of COLMAP."""

import os
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np

from nonsac.cameras.unreadable import camera_or_error, check_readable
from nonsac.files.content import status_of
from nonsac.files.errors import FilePath, input_error
from nonsac.io import colmap_binary, colmap_text
from nonsac.io.colmap_image import find_image
from nonsac.io.correspondences import PointMatches, Points
from nonsac.values.quiet import quiet

_READERS = {".bin": colmap_binary, ".txt": colmap_text}


def read_colmap_points(folder: FilePath, image: str | int) -> PointMatches:
    """Read the points of a COLMAP model that an image shows.

    Parameters
    ----------
    folder
        The folder of the files cameras, images and points3D, all ending in .bin or all in .txt, or one of these
        files.
    image
        Name or number of the image.

    Returns
    -------
    PointMatches
        The keypoints that have a point in space, with their points and the camera, as a dict. As COLMAP has it, the
        centre of the top-left pixel is (0.5, 0.5), for points and camera alike. There may be none.

    Raises
    ------
    InputError
        If the files are missing, cannot be read, are truncated or damaged, do not hold the image or do not fit each
        other, or the camera has a model that nonsac does not know.
    """
    points = points_of_model(folder, image)
    check_readable(points.camera)
    return points


def points_of_model(folder: FilePath, image: str | int) -> PointMatches:
    """As `read_colmap_points`, with an `UnreadableCamera` in place of a camera that cannot be read."""
    reader, place, suffix = find_model(folder)
    path = place / f"images{suffix}"
    found = find_image(path, reader.images_of(path), image)
    camera = camera_or_error(partial(reader.find_camera, place / f"cameras{suffix}", found.camera))
    has_point = found.points >= 0
    numbers = found.points[has_point].tolist()
    path = place / f"points3D{suffix}"
    points = reader.find_points(path, frozenset(numbers))
    missing = set(numbers) - set(points)
    if missing:
        problem = f"holds no point {min(missing)}, which image {image!r} shows"
        raise input_error(path, problem, "copy or export the whole model again")
    points3d = np.array([points[number] for number in numbers], dtype=np.float64).reshape(-1, 3)
    return PointMatches(found.xy[has_point], points3d, camera=camera)


@quiet
def read_colmap_pose(folder: FilePath, image: str | int) -> Points:
    """Read the pose of an image in a COLMAP model.

    Parameters
    ----------
    folder, image
        As for `read_colmap_points`; only the file of the images is read.

    Returns
    -------
    ndarray of float64, shape (4, 4)
        From the world to the camera, as `nonsac.absolute_pose` gives it.

    Raises
    ------
    InputError
        If the files are missing, cannot be read, are truncated or damaged, or do not hold the image.
    """
    from scipy.spatial.transform import Rotation

    reader, place, suffix = find_model(folder)
    path = place / f"images{suffix}"
    found = find_image(path, reader.images_of(path), image)
    pose = np.eye(4)
    pose[:3, 3] = found.translation
    length = np.linalg.norm(found.quaternion)
    if not (np.isfinite(pose).all() and 0.0 < length < np.inf):
        raise input_error(path, f"the pose of image {image!r} is not valid", "copy or export the model again")
    # SciPy has w at the end.
    pose[:3, :3] = Rotation.from_quat(np.roll(found.quaternion, -1)).as_matrix()
    return pose


def find_model(path: FilePath) -> tuple[ModuleType, Path, str]:
    """Return what reads a model, its folder and the suffix of its files, given the folder or one of the files."""
    given = Path(path)
    status_of(path)
    folder, suffixes = (given, tuple(_READERS)) if os.path.isdir(given) else (given.parent, (given.suffix,))
    for suffix in suffixes:
        if suffix in _READERS and os.path.isfile(folder / f"images{suffix}"):
            return _READERS[suffix], folder, suffix
    problem = "is no model of COLMAP: there is no images.bin or images.txt"
    raise input_error(path, problem, "give the folder of a sparse model, such as sparse/0")
