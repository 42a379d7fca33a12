"""Find cameras, images and points in the .txt files of a COLMAP model."""

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.cameras.models import camera_dict
from nonsac.files.content import read_content
from nonsac.files.errors import FilePath, InputError, input_error, not_held
from nonsac.io.colmap_image import Listed, ModelImage
from nonsac.io.correspondences import Points

_FIELDS_OF_POSE = 7
_FIELDS_BEFORE_NAME = 9
_FIELDS_BEFORE_TRACK = 8
# COLMAP writes -1 for no point; its older versions wrote the largest number of 64 bits.
_NO_POINT = 2**64 - 1


def find_camera(path: FilePath, number: int) -> dict[str, Any]:
    """Return a camera of cameras.txt, as `camera_dict` describes it.

    Raises
    ------
    InputError
        If the file cannot be read, is truncated or damaged, does not hold the camera, or nonsac does not know its
        model.
    """
    numbers = []
    for line_number, (line,) in _rows(path):
        found, *fields = line.split()
        if found != str(number):
            numbers.append(found)
            continue
        try:
            model, width, height = fields[0], int(fields[1]), int(fields[2])
            params = [float(text) for text in fields[3:]]
        except (IndexError, ValueError):
            raise _invalid(path, line_number) from None
        return camera_dict(path, model, width, height, params)
    raise not_held(path, f"camera {number}", numbers)


def images_of(path: FilePath) -> Iterator[Listed]:
    """All images of images.txt.

    Raises
    ------
    InputError
        If the file cannot be read, or is truncated or damaged.
    """
    # The second line, which may be blank, holds what the image shows.
    for line_number, (line, *second) in _rows(path, 2):
        try:
            number, *pose, camera, name = line.split(maxsplit=_FIELDS_BEFORE_NAME)
            quaternion, translation = np.split(np.array(pose, dtype=np.float64), [4])
            if len(pose) != _FIELDS_OF_POSE:
                raise ValueError
            known = int(number), int(camera)
        except (OverflowError, ValueError):
            raise _invalid(path, line_number) from None
        yield known[0], name, partial(_image, path, line_number, known[1], quaternion, translation, second)


def _image(
    path: FilePath, line_number: int, camera: int, quaternion: Points, translation: Points, second: Sequence[str]
) -> ModelImage:
    try:
        return ModelImage(camera, quaternion, translation, *_parse_observations(second))
    except (OverflowError, ValueError):
        raise _invalid(path, line_number) from None


def find_points(path: FilePath, wanted: Collection[int]) -> dict[int, tuple[float, float, float]]:
    """Return the coordinates of those of the wanted points that points3D.txt holds, by their numbers.

    Raises
    ------
    InputError
        If the file cannot be read, is truncated or damaged.
    """
    points = {}
    for line_number, (line,) in _rows(path):
        try:
            number, x, y, z, *others = line.split(maxsplit=_FIELDS_BEFORE_TRACK)
            if int(number) in wanted:
                points[int(number)] = (float(x), float(y), float(z))
        except ValueError:
            raise _invalid(path, line_number) from None
        if len(others) < _FIELDS_BEFORE_TRACK - 4:
            raise _invalid(path, line_number)
    return points


def _parse_observations(line: Sequence[str]) -> tuple[Points, NDArray[np.int64]]:
    """Return keypoints and the numbers of their points, given the line that holds them, or none."""
    triples = np.array(" ".join(line).split(), dtype=object).reshape(-1, 3)
    numbers = [int(text) for text in triples[:, 2]]
    points = np.array([-1 if number == _NO_POINT else number for number in numbers], dtype=np.int64)
    return triples[:, :2].astype(np.float64), points


def _rows(path: FilePath, size: int = 1) -> Iterator[tuple[int, list[str]]]:
    """Go through the rows, of `size` lines each, as pairs of the number of the first line and the lines."""
    text = read_content(path, "text table").decode("utf-8-sig", errors="replace")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    position = 0
    while position < len(lines):
        if not lines[position].strip() or lines[position].startswith("#"):
            position += 1
            continue
        yield position + 1, [line.strip() for line in lines[position : position + size]]
        position += size


def _invalid(path: FilePath, line_number: int) -> InputError:
    problem = f"line {line_number}, or the one that belongs to it, is truncated or not valid"
    return input_error(path, problem, "copy or export the model again")
