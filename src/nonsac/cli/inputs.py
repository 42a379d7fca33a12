"""What the pose commands read: matches, cameras and photos, and which of them go together."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from nonsac.cli.options import camera_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from nonsac.cameras.camera import Camera, CameraLike
    from nonsac.io import Matches, PointMatches
    from nonsac.result import Array

    Cameras = tuple[Camera | None, Camera | None]
    Photo = NDArray[Any] | None

_HDF5 = (".h5", ".hdf5")
_DATABASE = ".db"
_MODEL_FILES = ("cameras", "images", "points3D")

Images = tuple[str, str]


def check_pair(matches: Path, second: Path | None, image1: str | None, image2: str | None) -> Images | None:
    """The names of both images, if any; refuse files and images that do not go together."""
    if (image1 is None) != (image2 is None):
        raise _bad("--image1" if image1 is None else "--image2", "name both images, or none")
    suffix = matches.suffix.lower()
    if suffix in _HDF5 and second is None:
        problem = f"{matches}: hloc keeps matches apart from features; give both files, features first"
        raise _bad("SECOND", f"{problem} (for rows of another HDF5 file name its --dataset)")
    if suffix not in _HDF5 and second is not None:
        raise _bad("SECOND", f"{matches} needs no second file: only the features of hloc (.h5) do")
    if suffix in (*_HDF5, _DATABASE) and image1 is None:
        raise _bad("--image1", f"{matches} holds the matches of many images; name two, with --image1 and --image2")
    if _is_table(suffix) and image1 is not None:
        raise _bad("--image1", f"{matches} holds the matches of one pair; only hloc and databases have images to name")
    return None if image1 is None or image2 is None else (image1, image2)


def is_hdf5(path: Path) -> bool:
    return path.suffix.lower() in _HDF5


def _is_table(suffix: str) -> bool:
    from nonsac.io.clouds import TEXT_SUFFIXES

    return suffix in (".npz", ".npy", ".parquet", *TEXT_SUFFIXES)


def check_geometry(matches: Path, images: Images | None, cameras: tuple[str | None, str | None]) -> None:
    """Refuse to write a two-view geometry where there is no database, or where it would not fit its cameras."""
    option = "--write-geometry"
    if images is None or matches.suffix.lower() in _HDF5:
        raise _bad(option, f"{matches} is no COLMAP database; only there can a two-view geometry be written")
    if any(camera is not None for camera in cameras):
        problem = "a two-view geometry has to fit the cameras of the database"
        raise _bad(option, f"{problem}; leave out --camera1 and --camera2, or change the database")
    if matches.exists() and not os.access(matches, os.W_OK):
        raise _bad(option, f"{matches} is write-protected")


def read_pair(matches: Path, second: Path | None, images: Images | None) -> Matches:
    from nonsac import io

    if images is None:
        return io.read_matches(matches)
    if second is not None:
        return io.read_hloc(matches, second, *images)
    return io.read_colmap_pair(matches, *map(image_of, images))


def check_points(points: Path, image: str | None) -> None:
    """Refuse a model without an image, and an image without a model."""
    if points.is_dir() and image is None:
        raise _bad("--image", f"{points} holds the points of many images; name one")
    if points.is_file() and image is not None and points.stem not in _MODEL_FILES:
        raise _bad("--image", f"{points} holds the points of one image; only the folder of a COLMAP model has names")


def model_files(points: Path) -> list[tuple[str, Path]]:
    """The files of a model, as far as a command could overwrite them."""
    folder = points.parent if points.stem in _MODEL_FILES else points
    return [("POINTS", points), *(("POINTS", folder / f"{name}.txt") for name in _MODEL_FILES)]


def read_points(points: Path, image: str | None) -> PointMatches:
    from nonsac import io

    return io.read_points(points, None if image is None else image_of(image))


def image_of(name: str) -> str | int:
    """COLMAP's number of an image, or its name."""
    return int(name) if name.isdecimal() else name


def choose_camera(option: str | None, path: Path, name: str, in_file: CameraLike | None) -> Camera | None:
    """The camera of the option, else that of the file, called `name` there."""
    from nonsac.cameras.camera import Camera

    if option is not None:
        return camera_of(option)
    if in_file is None:
        return None
    with blaming(path):
        return Camera.parse(in_file, name)


def choose_cameras(options: tuple[str | None, str | None], path: Path, matches: Matches) -> Cameras:
    """Those of both images; that of the second one is by default that of the first."""
    first = choose_camera(options[0], path, "camera1", matches.camera1)
    second = choose_camera(options[1], path, "camera2", matches.camera2)
    if first is None and second is not None:
        raise _bad("--camera1", "give the camera of the first image, too")
    return first, second or first


def check_unit(points: Array, noise: float | None, camera: Camera | None, option: str) -> None:
    """Without a camera, pixels are an oversight, unless their noise is told."""
    from nonsac.calls.poses import look_like_pixels

    if noise is None and camera is None and look_like_pixels(points):
        raise _bad(option, "the points look like pixels, and there is no camera: give one, or normalised coordinates")


def check_table(is_table: bool, columns: str | None, dataset: str | None, file: str) -> None:
    """Refuse options of tables for what is none."""
    for option, value in (("--columns", columns), ("--dataset", dataset)):
        if value is not None and not is_table:
            raise _bad(option, f"{file} is no table of rows; leave this option out")


def read_photo(option: str, path: Path | None, picture: Path | None, camera: Camera | None) -> Photo:
    """The image to be drawn behind the points."""
    if path is None:
        return None
    if picture is None:
        raise _bad(option, "give --picture, too, into which it is drawn")
    if camera is None:
        raise _bad(option, "the points are not in pixels as long as there is no camera")
    from matplotlib.image import imread

    try:
        return imread(path)
    except FileNotFoundError:
        raise _bad(option, f"{path}: no such file; check the path") from None
    # What Pillow and its plugins raise for damaged files share no other type.
    except Exception:
        raise _bad(option, f"{path}: is no image that can be read; give a .png or .jpg") from None


@contextmanager
def blaming(path: Path | str) -> Iterator[None]:
    """Name the file whose content is refused."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _bad(option: str, message: str) -> typer.BadParameter:
    return typer.BadParameter(message, param_hint=repr(option))
