"""Lists of images with their cameras, as hloc has them: a name in each line, and a camera in COLMAP's form."""

from __future__ import annotations

import os

from nonsac.cameras.camera import Camera, CameraLike
from nonsac.files.content import read_content
from nonsac.files.errors import FilePath, input_error


def read_camera_list(path: FilePath) -> dict[str, Camera]:
    """The cameras of images, by their names.

    Parameters
    ----------
    path
        A text file with lines such as ``query/1.jpg SIMPLE_RADIAL 1600 1200 1100 800 600 0.01``, hloc's "queries with
        intrinsics".

    Returns
    -------
    dict
        In the order of the file.

    Raises
    ------
    InputError
        If the file cannot be read, holds no image, names one twice, or a line is something else.
    """
    text = read_content(path, "text table").decode("utf-8-sig", errors="replace")
    cameras: dict[str, Camera] = {}
    for number, line in enumerate(text.splitlines(), 1):
        name, _, camera = line.strip().partition(" ")
        if not name or name.startswith("#"):
            continue
        if name in cameras:
            raise input_error(path, f"line {number} names {name!r} again", "keep one line for each image")
        try:
            cameras[name] = Camera.parse(camera.strip())
        except (TypeError, ValueError) as error:
            fix = "write a name and a camera, as 'a.jpg PINHOLE 1600 1200 1100 1100 800 600'"
            raise input_error(path, f"line {number} holds no camera ({error})", fix) from error
    if not cameras:
        raise input_error(path, "holds no images", "write a name and a camera in each line")
    return cameras


def cameras_of(given: FilePath | CameraLike) -> dict[str, Camera] | Camera:
    """The cameras of a list of images, or the one of all."""
    if isinstance(given, os.PathLike) or (isinstance(given, str) and os.path.isfile(given)):
        return read_camera_list(given)
    return Camera.parse(given, "cameras")
