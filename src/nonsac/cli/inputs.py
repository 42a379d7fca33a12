"""What the commands read: tables and other files, cameras and photos, and which of them go together."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from nonsac.cli.options import camera_of, columns_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from nonsac.cameras.camera import Camera, CameraLike
    from nonsac.io import Opened
    from nonsac.layouts import Array

    Cameras = tuple[Camera | None, Camera | None]
    Photo = NDArray[Any] | None

_HDF5 = (".h5", ".hdf5")
_DATABASE = ".db"
_MODEL_FILES = ("cameras", "images", "points3D")


@dataclass(frozen=True)
class Table:
    """The files of matched rows, as they are named on the command line."""

    file: str
    second: Path | None = None
    images: tuple[str | None, ...] = ()
    columns: str | None = None
    dataset: str | None = None

    @property
    def suffix(self) -> str:
        return Path(self.file).suffix.lower()

    @property
    def named_images(self) -> list[str]:
        return [image for image in self.images if image is not None]

    @property
    def is_asked_for_as_table(self) -> bool:
        """Whether options say that the file is a table of rows."""
        return self.columns is not None or self.dataset is not None

    def check_options(self, holds_rows: bool) -> None:
        """Refuse options of tables for what is none."""
        for option, value in (("--columns", self.columns), ("--dataset", self.dataset)):
            if value is not None and not holds_rows:
                raise bad(option, f"{self.file} is no table of rows; leave this option out")

    def opened(self, layout: str) -> Opened:
        """Its rows, with the columns of a layout."""
        from nonsac import layouts
        from nonsac.io import open_matches

        files: list[str | Path] = [self.file] if self.second is None else [self.file, self.second]
        images = [image_of(image) for image in self.named_images]
        return open_matches(getattr(layouts, layout), files, images, columns_of(self.columns), self.dataset)

    def parts(self, layout: str, rows: Array, total: int) -> tuple[Any, ...]:
        """The parts of some rows of so many in all; weights are refused that are negative, or all zero."""
        from nonsac import layouts
        from nonsac.calls.arguments import weights_argument

        columns = getattr(layouts, layout)
        weights = rows[:, len(columns.names) :]
        if weights.size and ((weights < 0.0).any() or len(rows) == total):
            with blaming(self.file):
                weights_argument(weights[:, 0], len(rows))
        return tuple(columns.parts(rows))


def check_pair(table: Table) -> None:
    """Refuse files and images that do not go together."""
    images, is_hdf5 = table.named_images, table.suffix in _HDF5
    table.check_options(not (table.second or images))
    if len(images) == 1:
        raise bad("--image1" if table.images[0] is None else "--image2", "name both images, or none")
    if is_hdf5 and table.second is None and not table.is_asked_for_as_table and os.path.isfile(table.file):
        problem = f"{table.file}: hloc keeps matches apart from features; give both files, features first"
        raise bad("SECOND", f"{problem} (for rows of another HDF5 file name its --dataset)")
    if not is_hdf5 and table.second is not None:
        raise bad("SECOND", f"{table.file} needs no second file: only the features of hloc (.h5) do")
    if (table.second is not None or table.suffix == _DATABASE) and not images:
        raise bad("--image1", f"{table.file} holds the matches of many images; name two, with --image1 and --image2")
    if images and table.second is None and table.suffix != _DATABASE and _is_table(table.suffix):
        raise bad(
            "--image1", f"{table.file} holds the matches of one pair; only hloc and databases have images to name"
        )


def _is_table(suffix: str) -> bool:
    from nonsac.io.clouds import TEXT_SUFFIXES

    return suffix in (".npz", ".npy", ".parquet", ".flo", ".png", *TEXT_SUFFIXES)


def check_geometry(table: Table, cameras: Sequence[str | None]) -> None:
    """Refuse to write a two-view geometry without a database, or if it would not fit its cameras."""
    option = "--write-geometry"
    if not table.named_images or table.suffix in _HDF5:
        raise bad(option, f"{table.file} is no COLMAP database; only there can a two-view geometry be written")
    if any(camera is not None for camera in cameras):
        problem = "a two-view geometry has to fit the cameras of the database"
        raise bad(option, f"{problem}; leave out --camera1 and --camera2, or change the database")
    if os.path.exists(table.file) and not os.access(table.file, os.W_OK):
        raise bad(option, f"{table.file} is write-protected")


def check_points(table: Table) -> None:
    """Refuse a model without an image, and an image without a model."""
    points, image = Path(table.file), table.images[0]
    table.check_options(image is None)
    if image is None and os.path.isdir(points) and not table.is_asked_for_as_table:
        from nonsac.sources.open import holds_rows

        if not holds_rows(table.file):
            raise bad("--image", f"{points} holds the points of many images; name one")
    if os.path.isfile(points) and image is not None and points.stem not in _MODEL_FILES:
        raise bad("--image", f"{points} holds the points of one image; only the folder of a COLMAP model has names")


def check_pairs(table: Table) -> None:
    """Refuse options of tables if there are two clouds."""
    table.check_options(table.second is None)


def model_files(points: Path) -> list[tuple[str, Path]]:
    """The files of a model, as far as a command could overwrite them."""
    folder = points.parent if points.stem in _MODEL_FILES else points
    return [("POINTS", points), *(("POINTS", folder / f"{name}.txt") for name in _MODEL_FILES)]


def image_of(name: str) -> str | int:
    """COLMAP's number of an image, or its name."""
    return int(name) if name.isdecimal() else name


def choose_camera(option: str | None, path: str, name: str, in_file: CameraLike | None) -> Camera | None:
    """The camera of the option, else that of the file, called `name` there."""
    return _camera(in_file, path, name) if option is None else camera_of(option)


def _camera(in_file: CameraLike | None, path: str, name: str) -> Camera | None:
    from nonsac.cameras.camera import Camera

    if in_file is None:
        return None
    with blaming(path):
        return Camera.parse(in_file, name)


def choose_cameras(options: tuple[str | None, str | None], path: str, in_file: Sequence[CameraLike | None]) -> Cameras:
    """Those of both images; that of the second one is by default that of the first."""
    from nonsac.cameras.unreadable import chosen_cameras

    given = [None if option is None else camera_of(option) for option in options]
    first, second = (
        _camera(camera, path, name)
        for camera, name in zip(chosen_cameras(given, in_file or (None, None)), ("camera1", "camera2"), strict=True)
    )
    if first is None and second is not None:
        raise bad("--camera1", "give the camera of the first image, too")
    return first, second or first


def check_unit(points: Array, noise: float | None, camera: Camera | None, option: str) -> None:
    """Without a camera, pixels are an oversight, unless their noise is told."""
    from nonsac.calls.poses import look_like_pixels

    if noise is None and camera is None and look_like_pixels(points):
        raise bad(option, "the points look like pixels, and there is no camera: give one, or normalised coordinates")


def read_photo(option: str, path: Path | None, picture: Path | None, camera: Camera | None) -> Photo:
    """The image to be drawn behind the points."""
    if path is None:
        return None
    if picture is None:
        raise bad(option, "give --picture, too, into which it is drawn")
    if camera is None:
        raise bad(option, "the points are not in pixels as long as there is no camera")
    from matplotlib.image import imread

    from nonsac.files.content import check_regular
    from nonsac.files.errors import InputError

    try:
        check_regular(path)
        return imread(path)
    except InputError as error:
        raise bad(option, str(error)) from None
    # What Pillow and its plugins raise for damaged files share no other type.
    except Exception:
        raise bad(option, f"{path}: is no image that can be read; give a .png or .jpg") from None


@contextmanager
def blaming(path: Path | str) -> Iterator[None]:
    """Name the file whose content is refused."""
    from nonsac.files.errors import InputError

    try:
        yield
    except InputError:  # it names its file
        raise
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def bad(option: str, message: str) -> typer.BadParameter:
    return typer.BadParameter(message, param_hint=repr(option))
