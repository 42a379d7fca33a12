"""Cameras the way COLMAP's databases and models store them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.io.errors import FilePath, input_error

# Name and number of parameters, by COLMAP's own numbers.
_MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
    11: ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    12: ("SIMPLE_DIVISION", 4),
    13: ("DIVISION", 5),
    14: ("SIMPLE_FISHEYE", 3),
    15: ("FISHEYE", 4),
    16: ("EUCM", 6),
    17: ("EQUIRECTANGULAR", 2),
}
_SUPPORTED = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE")
# Models that are a pinhole but for their distortion, by their number of focal lengths.
_FOCAL_LENGTHS = {"SIMPLE_PINHOLE": 1, "PINHOLE": 2, "SIMPLE_RADIAL": 1, "RADIAL": 1, "OPENCV": 2, "FULL_OPENCV": 2}


def model_name(path: FilePath, number: int) -> str:
    """Return the name of a camera model.

    Raises
    ------
    InputError
        If COLMAP, as far as is known here, has no model of this number.
    """
    return _look_up(path, number)[0]


def parameter_count(path: FilePath, number: int) -> int:
    """Return how many parameters a camera model has; it raises what `model_name` raises."""
    return _look_up(path, number)[1]


def camera_dict(path: FilePath, model: str, width: int, height: int, params: Sequence[float]) -> dict[str, Any]:
    """Describe a camera in the form that pycolmap and PoseLib take, and `nonsac.Camera.parse`.

    Returns
    -------
    dict
        With the keys ``model``, ``width``, ``height`` and ``params``.

    Raises
    ------
    InputError
        If nonsac cannot undo what this model does, or the number of parameters is wrong.
    """
    if model not in _SUPPORTED:
        problem = f"the camera has the model {model}, but nonsac knows only {', '.join(_SUPPORTED)}"
        raise input_error(path, problem, "undistort the images with COLMAP, and match them again")
    wanted = dict(_MODELS.values())[model]
    if len(params) != wanted:
        problem = f"a camera of model {model} has {wanted} parameters, not {len(params)}"
        raise input_error(path, problem, "copy or export the file again")
    return {"model": model, "width": int(width), "height": int(height), "params": [float(value) for value in params]}


def pinhole_matrix(model: str, params: Sequence[float]) -> NDArray[np.float64] | None:
    """Return the 3x3 matrix of a camera without its distortion, or None for a fisheye, which has no such matrix."""
    count = _FOCAL_LENGTHS.get(model)
    if count is None or len(params) < count + 2:
        return None
    matrix = np.diag([params[0], params[count - 1], 1.0])
    matrix[:2, 2] = params[count : count + 2]
    return matrix


def _look_up(path: FilePath, number: int) -> tuple[str, int]:
    if number not in _MODELS:
        problem = f"the camera model {number} is not known"
        raise input_error(path, problem, "copy the file again; if it is whole, use a camera model of COLMAP 4")
    return _MODELS[number]
