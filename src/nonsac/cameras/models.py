"""COLMAP's camera models: their numbers, names and parameters, and cameras the way its files store them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nonsac.files.errors import FilePath, input_error
from nonsac.values.checks import real_array
from nonsac.values.numeric import shown

# What COLMAP's models have as parameters, by its own numbers and names.
_MODELS = {
    0: ("SIMPLE_PINHOLE", "f cx cy"),
    1: ("PINHOLE", "fx fy cx cy"),
    2: ("SIMPLE_RADIAL", "f cx cy k"),
    3: ("RADIAL", "f cx cy k1 k2"),
    4: ("OPENCV", "fx fy cx cy k1 k2 p1 p2"),
    5: ("OPENCV_FISHEYE", "fx fy cx cy k1 k2 k3 k4"),
    6: ("FULL_OPENCV", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    7: ("FOV", "fx fy cx cy omega"),
    8: ("SIMPLE_RADIAL_FISHEYE", "f cx cy k"),
    9: ("RADIAL_FISHEYE", "f cx cy k1 k2"),
    10: ("THIN_PRISM_FISHEYE", "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"),
    11: ("RAD_TAN_THIN_PRISM_FISHEYE", "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3"),
    12: ("SIMPLE_DIVISION", "f cx cy k"),
    13: ("DIVISION", "fx fy cx cy k"),
    14: ("SIMPLE_FISHEYE", "f cx cy"),
    15: ("FISHEYE", "fx fy cx cy"),
    16: ("EUCM", "fx fy cx cy alpha beta"),
    17: ("EQUIRECTANGULAR", "width height"),
}
_PARAMETERS = {name: tuple(parameters.split()) for name, parameters in _MODELS.values()}
# A camera that sees all around has neither a focal length nor normalised coordinates.
SUPPORTED = tuple(name for name in _PARAMETERS if name != "EQUIRECTANGULAR")
# These are a pinhole but for their distortion.
_PINHOLES = (
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "FULL_OPENCV",
    "SIMPLE_DIVISION",
    "DIVISION",
)

# What parameters of lenses must be, besides finite.
_RANGES: dict[str, tuple[Callable[[float], bool], str]] = {
    "omega": (lambda angle: abs(angle) < math.pi, "an angle below pi, in radians"),
    "alpha": (lambda alpha: 0 <= alpha <= 1, "a number from 0 to 1"),
    "beta": (lambda beta: beta > 0, "a number above 0"),
}


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
    return len(_PARAMETERS[_look_up(path, number)[0]])


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
    if model not in SUPPORTED:
        problem = f"the camera has the model {model}, but nonsac knows only {', '.join(SUPPORTED)}"
        fix = "give a camera of your own, or undistort the images with COLMAP and match them again"
        raise input_error(path, problem, fix)
    wanted = len(_PARAMETERS[model])
    if len(params) != wanted:
        problem = f"a camera of model {model} has {wanted} parameters, not {len(params)}"
        raise input_error(path, problem, "copy or export the file again")
    return {"model": model, "width": int(width), "height": int(height), "params": [float(value) for value in params]}


def pinhole_matrix(model: str, params: Sequence[float]) -> NDArray[np.float64] | None:
    """Return the 3x3 matrix of a camera without its distortion, or None for a fisheye, which has no such matrix."""
    focal_lengths = _PARAMETERS[model].index("cx") if model in _PINHOLES else len(params)
    if len(params) < focal_lengths + 2:
        return None
    matrix = np.diag([params[0], params[focal_lengths - 1], 1.0])
    matrix[:2, 2] = params[focal_lengths : focal_lengths + 2]
    return matrix


def _look_up(path: FilePath, number: int) -> tuple[str, str]:
    if number not in _MODELS:
        problem = f"the camera model {number} is not known"
        raise input_error(path, problem, "copy the file again; if it is whole, use a camera model of COLMAP 4")
    return _MODELS[number]


def parameter_names(model: str) -> tuple[str, ...]:
    """What the parameters of a supported model are called, in COLMAP's order; a ValueError for other models."""
    if model not in SUPPORTED:
        raise ValueError(f"model is {model!r}; expected one of {', '.join(SUPPORTED)}")
    return _PARAMETERS[model]


def checked_parameters(model: str, params: ArrayLike) -> tuple[float, ...]:
    """The parameters of a supported model as floats, which must be finite, and focal lengths positive."""
    names = parameter_names(model)
    expected = f"expected {len(names)} for {model}: {', '.join(names)}"
    try:
        numbers = real_array("params", params)
    except (TypeError, ValueError):
        raise TypeError(f"params is {shown(params)}, which is not numbers; {expected}") from None
    if numbers.shape != (len(names),):
        raise ValueError(f"params holds {numbers.size} numbers in shape {numbers.shape}; {expected}")
    for name, number in zip(names, numbers, strict=True):
        if not np.isfinite(number):
            raise ValueError(f"{name} is {number}; expected a finite number")
        if name.startswith("f") and number <= 0:
            raise ValueError(f"{name} is {number}; expected a focal length above 0, in pixels")
        if name in _RANGES and not _RANGES[name][0](number):
            raise ValueError(f"{name} is {number}; expected {_RANGES[name][1]}")
    return tuple(numbers.tolist())


def model_number(model: str) -> int:
    """COLMAP's own number of a model; a KeyError if there is none of this name."""
    return {name: number for number, (name, _) in _MODELS.items()}[model]
