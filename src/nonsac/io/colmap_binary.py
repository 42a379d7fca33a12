"""Find cameras, images and points in the .bin files of a COLMAP model."""

import struct
from collections.abc import Collection, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.cameras.models import camera_dict, model_name, parameter_count
from nonsac.files.content import read_bytes
from nonsac.files.errors import FilePath, input_error, not_held
from nonsac.io.colmap_image import Listed, ModelImage

_OBSERVATION = np.dtype([("xy", "<f8", 2), ("point", "<i8")])
_TRACK_ENTRY_SIZE = 8


def find_camera(path: FilePath, number: int) -> dict[str, Any]:
    """Return a camera of cameras.bin, as `camera_dict` describes it.

    Raises
    ------
    InputError
        If the file cannot be read, is truncated or damaged, does not hold the camera, or nonsac does not know its
        model.
    """
    file = _Bytes(path)
    numbers = []
    for _ in range(file.count()):
        found, model, width, height = file.take("<IiQQ")
        params = file.take(f"<{parameter_count(path, model)}d")
        if found == number:
            return camera_dict(path, model_name(path, model), width, height, params)
        numbers.append(str(found))
    raise not_held(path, f"camera {number}", numbers)


def images_of(path: FilePath) -> Iterator[Listed]:
    """All images of images.bin.

    Raises
    ------
    InputError
        If the file cannot be read, or is truncated or damaged.
    """
    file = _Bytes(path)
    for _ in range(file.count()):
        number, *pose, camera = file.take("<I7dI")
        name = file.text()
        observations = file.array(_OBSERVATION, file.count())
        yield number, name, partial(_image, camera, pose, observations)


def _image(camera: int, pose: list[float], observations: NDArray[Any]) -> ModelImage:
    xy, points = observations["xy"].astype(np.float64), observations["point"].astype(np.int64)
    return ModelImage(camera, np.array(pose[:4]), np.array(pose[4:]), xy, points)


def find_points(path: FilePath, wanted: Collection[int]) -> dict[int, tuple[float, float, float]]:
    """Return the coordinates of those of the wanted points that points3D.bin holds, by their numbers.

    Raises
    ------
    InputError
        If the file cannot be read, is truncated or damaged.
    """
    file = _Bytes(path)
    points = {}
    for _ in range(file.count()):
        number, x, y, z, _, _, _, _, track_length = file.take("<Q3d3BdQ")
        file.skip(track_length * _TRACK_ENTRY_SIZE)
        if number in wanted:
            points[number] = (x, y, z)
    return points


class _Bytes:
    """The content of a file, taken value by value from its start."""

    def __init__(self, path: FilePath) -> None:
        self.path = path
        self.content = read_bytes(path)
        self.position = 0

    def take(self, layout: str) -> tuple[Any, ...]:
        start = self.skip(struct.calcsize(layout))
        return struct.unpack_from(layout, self.content, start)

    def count(self) -> int:
        return int(self.take("<Q")[0])

    def array(self, kind: np.dtype[Any], count: int) -> NDArray[Any]:
        start = self.skip(count * kind.itemsize)
        return np.frombuffer(self.content, kind, count, start)

    def text(self) -> str:
        end = self.content.find(b"\0", self.position)
        start = self.skip(end + 1 - self.position if end >= 0 else len(self.content))
        return self.content[start:end].decode(errors="replace")

    def skip(self, size: int) -> int:
        """Go on by so many bytes, and return where they start."""
        start = self.position
        self.position += size
        if self.position > len(self.content):
            problem = f"the file is truncated or damaged: its {len(self.content)} bytes end before its last row"
            raise input_error(self.path, problem, "copy or export the model again")
        return start
