"""Read the matches of COLMAP's database.db, and write the geometry of two views into it."""

import sqlite3
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.cameras.models import camera_dict, model_name, pinhole_matrix
from nonsac.cameras.unreadable import camera_or_error, check_readable
from nonsac.files.errors import FilePath, input_error, not_held
from nonsac.io.colmap_sqlite import damaged, open_database, unpack
from nonsac.io.correspondences import Matches, Points
from nonsac.io.two_view_geometry import MAX_IMAGES, Rows, TwoViewGeometry, pair_id
from nonsac.values.arraylike import as_array
from nonsac.values.checks import real_array
from nonsac.values.numeric import as_whole, shown
from nonsac.values.quiet import quiet

_Image = str | int


def read_colmap_pair(path: FilePath, image1: _Image, image2: _Image) -> Matches:
    """Read the matches between two images of a COLMAP database, before COLMAP's own geometric verification.

    Parameters
    ----------
    path
        The database, usually database.db. It is not changed, and COLMAP may have it open.
    image1, image2
        Names or numbers of the images, in either order.

    Returns
    -------
    Matches
        The matches with the cameras, as dicts, and with the indices of the keypoints. As COLMAP has it, the centre
        of the top-left pixel is (0.5, 0.5), for points and cameras alike. There may be no match, as far as COLMAP
        found none.

    Raises
    ------
    InputError
        If the file cannot be read, is no database of COLMAP, is locked or damaged, does not hold the images or
        their matches, or has a camera of a model that nonsac does not know.
    """
    pair = pair_of_database(path, image1, image2)
    check_readable(pair.camera1, pair.camera2)
    return pair


def pair_of_database(path: FilePath, image1: _Image, image2: _Image) -> Matches:
    """As `read_colmap_pair`, with an `UnreadableCamera` in place of a camera that cannot be read."""
    with open_database(path) as database:
        numbers = _find_pair(path, database, image1, image2)
        camera1, camera2 = _find_cameras(path, database, numbers)
        keypoints1, keypoints2 = (keypoints_of(path, database, number) for number in numbers)
        indices = _read_matches(path, database, numbers, f"{image1!r} and {image2!r}")
    if (indices.max(axis=0, initial=-1) >= (len(keypoints1), len(keypoints2))).any():
        raise damaged(path, "a match names a keypoint that is not there")
    return Matches(keypoints1[indices[:, 0]], keypoints2[indices[:, 1]], None, camera1, camera2, indices)


def write_two_view_geometry(
    path: FilePath,
    image1: _Image,
    image2: _Image,
    transform: ArrayLike | tuple[ArrayLike, ArrayLike],
    matches: ArrayLike,
) -> None:
    """Write the relative pose of two images and its inliers into a COLMAP database, in place of what is there.

    COLMAP's mapper then takes them as verified. Its essential matrix follows from the pose; the fundamental matrix
    from this and the cameras without their distortion, and is left out if one is a fisheye.

    Parameters
    ----------
    path
        The database, usually database.db. The row is written as a whole or not at all.
    image1, image2
        Names or numbers of the images.
    transform
        Shape (4, 4) or (3, 4), or the rotation and the translation: X2 = R X1 + t, with t not zero. Its length is
        kept.
    matches
        Shape (k, 2), the inliers: which keypoint of `image1` matches which one of `image2`; of `Matches`, the
        attribute `indices`.

    Raises
    ------
    InputError
        If the pose or the matches do not fit, a camera has no focal length, or the file cannot be written, is no
        database of COLMAP, is locked or damaged, or does not hold the images.
    """
    for name, image in (("image1", image1), ("image2", image2)):
        if not isinstance(image, str) and not 0 <= (as_whole(image) or 0) <= MAX_IMAGES:
            raise ValueError(f"{name} is {shown(image)}; expected the name or the number of an image")
        if not isinstance(image, str) and as_whole(image) is None:
            raise TypeError(f"{name} is {shown(image)}; expected the name or the number of an image")
    rotation, translation = _check_pose(path, transform)
    inliers = _check_inliers(path, matches)
    with open_database(path, write=True) as database:
        numbers = _find_pair(path, database, image1, image2)
        for number, column in zip(numbers, inliers.T, strict=True):
            count = len(keypoints_of(path, database, number))
            if len(column) and column.max() >= count:
                problem = f"a match names keypoint {column.max()} of image {number}, which has {count}"
                raise input_error(path, problem, "number the keypoints as the database does, from 0")
        if numbers[0] > numbers[1]:
            numbers, inliers = numbers[::-1], inliers[:, ::-1]
            rotation, translation = rotation.T, -rotation.T @ translation
        matrices = [_pinhole_matrix(path, database, number) for number in numbers]
        geometry = TwoViewGeometry.of_pose(rotation, translation, matrices)
        Rows(database).write(pair_id(numbers), inliers, geometry.columns())


def _find_pair(path: FilePath, database: sqlite3.Connection, image1: _Image, image2: _Image) -> list[int]:
    numbers = [_find_image(path, database, image) for image in (image1, image2)]
    if numbers[0] == numbers[1]:
        raise input_error(path, f"{image1!r} and {image2!r} are the same image", "name two images")
    return numbers


def _find_image(path: FilePath, database: sqlite3.Connection, image: _Image) -> int:
    column = "name" if isinstance(image, str) else "image_id"
    wanted = image if isinstance(image, str) else int(image)
    row = database.execute(f"SELECT image_id FROM images WHERE {column} = ?", (wanted,)).fetchone()
    if row is None:
        rows = database.execute(f"SELECT {column} FROM images ORDER BY image_id")
        raise not_held(path, f"image {image!r}", [str(name) for (name,) in rows])
    return int(row[0])


def _find_cameras(path: FilePath, database: sqlite3.Connection, numbers: Sequence[int]) -> list[Any]:
    """The cameras of images, or what stands for those that cannot be read; one object if they share one camera."""
    cameras: dict[Any, Any] = {}
    found = []
    for number in numbers:
        row = database.execute("SELECT camera_id FROM images WHERE image_id = ?", (number,)).fetchone()
        if row is None:  # though it was found by its name
            raise damaged(path, f"its index does not find image {number}")
        (shared,) = row
        if shared not in cameras:
            cameras[shared] = camera_or_error(partial(described_camera, path, database, number))
        found.append(cameras[shared])
    return found


def described_camera(path: FilePath, database: sqlite3.Connection, image: int) -> dict[str, Any]:
    return camera_dict(path, *_read_camera(path, database, image))


def _read_camera(path: FilePath, database: sqlite3.Connection, image: int) -> tuple[str, int, int, list[float]]:
    """Return the model, width, height and parameters of the camera of an image."""
    row = database.execute(
        "SELECT model, width, height, params FROM cameras JOIN images USING (camera_id) WHERE image_id = ?", (image,)
    ).fetchone()
    if row is None:
        raise damaged(path, f"it lacks the camera of image {image}")
    *numbers, params = row
    if not all(isinstance(number, int) for number in numbers) or not isinstance(params, bytes) or len(params) % 8:
        raise damaged(path, f"the camera of image {image} is not valid")
    model, width, height = numbers
    return model_name(path, model), width, height, np.frombuffer(params, "<f8").tolist()


def keypoints_of(path: FilePath, database: sqlite3.Connection, image: int) -> Points:
    row = database.execute("SELECT rows, cols, data FROM keypoints WHERE image_id = ?", (image,)).fetchone()
    if row is None:
        raise input_error(path, f"holds no keypoints of image {image}", "extract its features first")
    # Besides x and y there may be scale and orientation, or an affine shape.
    return np.array(unpack(path, row, "<f4", f"the keypoints of image {image}")[:, :2], dtype=np.float64)


def _read_matches(path: FilePath, database: sqlite3.Connection, numbers: list[int], names: str) -> NDArray[np.int64]:
    row = database.execute("SELECT rows, cols, data FROM matches WHERE pair_id = ?", (pair_id(numbers),)).fetchone()
    if row is None:
        raise input_error(path, f"holds no matches of {names}", "match these images first")
    indices = unpack(path, row, "<u4", f"the matches of {names}")[:, :2]
    # The image of the smaller number comes first.
    return np.array(indices if numbers[0] < numbers[1] else indices[:, ::-1], dtype=np.int64)


@quiet
def _check_pose(path: FilePath, transform: ArrayLike | tuple[ArrayLike, ArrayLike]) -> tuple[Points, Points]:
    if isinstance(transform, tuple) and len(transform) == 2:
        rotation, translation = (real_array("transform", part) for part in transform)
    else:
        matrix = real_array("transform", transform)
        if matrix.shape not in ((4, 4), (3, 4)):
            problem = f"a pose has the shape (4, 4) or (3, 4), this array has the shape {matrix.shape}"
            raise input_error(path, problem, "give the T of a result")
        rotation, translation = matrix[:3, :3], matrix[:3, 3]
    translation = translation.reshape(-1)
    if rotation.shape != (3, 3) or len(translation) != 3:
        problem = f"rotation and translation have the shapes {rotation.shape} and {translation.shape}"
        raise input_error(path, problem, "give the R and t of a result")
    # A failed result has a T of NaN, which must not pass.
    if not (
        np.abs(rotation).max() <= 2
        and np.abs(rotation @ rotation.T - np.eye(3)).max() <= 1e-6
        and np.linalg.det(rotation) > 0
    ):
        raise input_error(path, "the pose holds no rotation", "write the poses only of results that succeeded")
    if not (np.isfinite(translation).all() and translation.any()):
        problem = "the translation is zero or not finite, so that there is no essential matrix"
        raise input_error(path, problem, "write only poses with a translation")
    return rotation, translation


def _check_inliers(path: FilePath, matches: ArrayLike) -> NDArray[np.int64]:
    inliers = as_array(matches, "matches", "indices of keypoints (k, 2)")
    if inliers.ndim != 2 or inliers.shape[1] != 2 or inliers.dtype.kind not in "iu" or inliers.min(initial=0) < 0:
        problem = f"the matches are no indices of keypoints of shape (k, 2), but {inliers.dtype} of {inliers.shape}"
        raise input_error(path, problem, "give the rows of Matches.indices that are inliers")
    return inliers.astype(np.int64)


def _pinhole_matrix(path: FilePath, database: sqlite3.Connection, image: int) -> Points | None:
    """Return the matrix of the camera of an image without its distortion, or None for a fisheye."""
    model, _, _, params = _read_camera(path, database, image)
    matrix = pinhole_matrix(model, params)
    if matrix is not None and not (np.isfinite(matrix).all() and np.diag(matrix).min() > np.finfo(float).tiny):
        problem = f"the camera of image {image} has the focal lengths {matrix[0, 0]:g} and {matrix[1, 1]:g}"
        raise input_error(path, problem, "write the right ones, in pixels, into the database first")
    return matrix
