"""Write where images were taken: hloc's lines of results, or a model of COLMAP."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from nonsac.cameras.camera import Camera
from nonsac.files.atomic import check_target, write_atomically
from nonsac.files.errors import FilePath, input_error
from nonsac.io.correspondences import Points

_LINES = ".txt"


@dataclass(frozen=True, eq=False)
class PosedImage:
    """An image, its camera, and its pose (4, 4) from the world to the camera."""

    name: str
    camera: Camera
    T: Points

    def __str__(self) -> str:
        """Quaternion, with w in front, and translation."""
        from scipy.spatial.transform import Rotation

        quaternion = np.roll(Rotation.from_matrix(self.T[:3, :3]).as_quat(), 1)
        return " ".join(repr(float(number)) for number in (*quaternion, *self.T[:3, 3]))


def check_poses(path: FilePath, overwrite: bool) -> None:
    """Check that poses can be written there, before the work.

    Raises
    ------
    InputError
        If the place cannot be written, or holds something that is not to be replaced.
    """
    target = Path(path)
    if target.suffix.lower() == _LINES:
        check_target(path)
        if target.exists() and not overwrite:
            raise input_error(path, "is there already", "give another name, or overwrite it (--overwrite)")
        return
    check_target(target / "images.txt" if target.is_dir() else path)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise input_error(path, "is there already", "give the name of a new folder, or of a file that ends in .txt")


def write_poses(path: FilePath, images: Sequence[PosedImage]) -> None:
    """Write poses, whole or not at all.

    Parameters
    ----------
    path
        A file that ends in .txt, with a line ``name qw qx qy qz tx ty tz`` for each image, as hloc's results have it;
        or a folder, which becomes a model of COLMAP in text, with cameras and images, but without points.
    images

    Raises
    ------
    InputError
        If it cannot be written.
    """
    target = Path(path)
    if target.suffix.lower() == _LINES:
        text = "".join(f"{image.name} {image}\n" for image in images)
        write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
        return
    _write_folder(target, lambda folder: _write_model(folder, images))


def _write_folder(target: Path, write: Callable[[Path], None]) -> None:
    try:
        folder = Path(mkdtemp(prefix=".nonsac-", dir=target.absolute().parent))
        try:
            write(folder)
            os.chmod(folder, 0o755)
            os.replace(folder, target)  # an empty folder may be there
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    except OSError as error:
        problem = f"cannot be written ({error.strerror or error})"
        raise input_error(target, problem, "check the folder and its free space") from error


def _write_model(folder: Path, images: Sequence[PosedImage]) -> None:
    numbers = {line: k for k, line in enumerate(dict.fromkeys(_line(image.camera) for image in images), 1)}
    cameras = "".join(f"{number} {line}\n" for line, number in numbers.items())
    poses = "".join(f"{k} {image} {numbers[_line(image.camera)]} {image.name}\n\n" for k, image in enumerate(images, 1))
    for name, text in (("cameras", cameras), ("images", poses), ("points3D", "")):
        (folder / f"{name}.txt").write_text(text, encoding="utf-8")


def _line(camera: Camera) -> str:
    """As in cameras.txt, but for the number; a size that is not known is twice the principal point, about."""
    if camera.width is not None:
        return str(camera)
    width, height = np.maximum(1, np.rint(2.0 * camera.K[:2, 2])).astype(int)
    return str(Camera(camera.model, camera.params, int(width), int(height)))
