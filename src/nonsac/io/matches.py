"""Read matches between two images, and between an image and points in space."""

from pathlib import Path

from nonsac.files.errors import FilePath, input_error
from nonsac.io.colmap_database import read_colmap_pair
from nonsac.io.colmap_model import read_colmap_points
from nonsac.io.correspondences import Matches, PointMatches
from nonsac.io.tables import Layout, read_rows

_MATCHES = Layout(
    columns=("x1", "y1", "x2", "y2"),
    keys=(("points1", "points2"), ("x1", "x2")),
    camera_keys=(("camera1", "K1"), ("camera2", "K2")),
)
_POINTS = Layout(
    columns=("u", "v", "X", "Y", "Z"),
    keys=(("points2d", "points3d"), ("x", "X")),
    camera_keys=(("camera", "K"),),
)


def read_matches(path: FilePath, image1: str | int | None = None, image2: str | int | None = None) -> Matches:
    """Read the matches between two images.

    Parameters
    ----------
    path
        A table of matches: text or Parquet with the columns x1, y1, x2, y2 and perhaps weight, in any order, or
        text with four or five columns and no header; NPY of shape (n, 4) or (n, 5); NPZ with the keys ``points1``
        and ``points2``, or ``x1`` and ``x2``, or one array as in NPY, and perhaps ``weights`` and the cameras
        ``camera1`` and ``camera2``, or ``K1`` and ``K2``. Or a COLMAP database (.db).
    image1, image2
        For a database, the names or numbers of the two images; not for a table.

    Returns
    -------
    Matches
        In the unit and order of the file. Rows with NaN or infinite coordinates are kept.

    Raises
    ------
    InputError
        If the file cannot be read, is not what its suffix says or, where images are named, no database, or lacks
        columns, images or matches.
    """
    if image1 is not None and image2 is not None:
        return read_colmap_pair(path, image1, image2)
    suffix = Path(path).suffix.lower()
    if suffix == ".db" or image1 is not None or image2 is not None:
        raise input_error(path, "a database holds the matches of many images", "name two, as image1 and image2")
    if suffix in (".h5", ".hdf5"):
        problem = "hloc keeps matches apart from the keypoints they match"
        raise input_error(path, problem, "give both files to nonsac.io.read_hloc")
    rows = read_rows(path, _MATCHES)
    camera1, camera2 = rows.cameras or (None, None)
    return Matches(rows.first, rows.second, rows.weights, camera1, camera2)


def read_points(path: FilePath, image: str | int | None = None) -> PointMatches:
    """Read the matches between an image and points in space.

    Parameters
    ----------
    path
        A table of matches: text or Parquet with the columns u, v, X, Y, Z and perhaps weight, in any order, or
        text with five or six columns and no header; NPY of shape (n, 5) or (n, 6); NPZ with the keys ``points2d``
        and ``points3d``, or ``x`` and ``X``, or one array as in NPY, and perhaps ``weights`` and the camera
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
        If the file cannot be read, is not what its suffix says or, where an image is named, no model, or lacks
        columns, the image or matches.
    """
    if image is not None:
        return read_colmap_points(path, image)
    if Path(path).is_dir():
        raise input_error(path, "a model holds many images", "name one of them, as image")
    rows = read_rows(path, _POINTS)
    (camera,) = rows.cameras or (None,)
    return PointMatches(rows.first, rows.second, rows.weights, camera)
