"""What calibration with OpenCV and ROS gives: a matrix K and the coefficients of the lens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nonsac.layouts import Array
from nonsac.values.arraylike import as_array

_FIELDS = {
    "K": ("K", "k", "camera_matrix", "cameraMatrix", "mtx"),
    "D": ("D", "d", "distortion_coefficients", "distCoeffs", "dist_coeffs", "dist"),
    "model": ("distortion_model",),
    "width": ("width", "image_width"),
    "height": ("height", "image_height"),
    "binning": ("binning_x", "binning_y"),
}
# What ROS and Kalibr call OpenCV's coefficients, and those of its fisheye.
_OPENCV = ("", "none", "plumb_bob", "rational_polynomial", "radtan")
_FISHEYE = ("equidistant", "fisheye", "equi")
_COUNTS = (4, 5, 8, 12, 14)  # of OpenCV's coefficients: k1 k2 p1 p2 k3 k4 k5 k6, thin prism, tilted sensor
# What moves no point of a photo by a thousandth of a pixel: skew in focal lengths, and numbers in the bottom row of K.
_SKEW_ROUNDING = 1e-7
_PROJECTIVE_ROUNDING = 1e-9


def calibration_of(value: Any) -> dict[str, Any] | None:
    """Fields of a message or file camera_info of ROS, or a dict of OpenCV's results; None if it is something else."""
    is_mapping = isinstance(value, Mapping)
    if not is_mapping and not hasattr(value, "distortion_model"):
        return None
    found = {}
    for field, names in _FIELDS.items():
        values = [value.get(name) if is_mapping else getattr(value, name, None) for name in names]
        found[field] = next((value for value in values if value is not None), None)
    return None if found["K"] is None else found


def from_calibration(fields: dict[str, Any]) -> tuple[Any, ...]:
    """The fields of a camera, given those of a calibration."""
    K, coefficients = (_numbers(name, fields[name]) for name in ("K", "D"))
    model = str(fields["model"] or "").lower()
    if fields["binning"] not in (None, 0, 1):
        raise ValueError(f"binning_x is {fields['binning']}; expected 1: give the camera of the image that is there")
    if K.size != 9:
        raise ValueError(f"K holds {K.size} numbers; expected 9")
    if model in _FISHEYE:
        if coefficients.size != 4:
            raise ValueError(f"the fisheye has {coefficients.size} coefficients; expected 4: k1, k2, k3, k4")
        camera: tuple[Any, ...] = ("OPENCV_FISHEYE", [*params_of_matrix(K.reshape(3, 3)), *coefficients])
    elif model in _OPENCV:
        camera = from_coefficients(K.reshape(3, 3), coefficients)
    else:
        raise ValueError(f"distortion_model is {model!r}; expected {', '.join((*_OPENCV[1:], *_FISHEYE))}")
    return *camera, fields["width"], fields["height"]


def from_coefficients(K: Any, coefficients: Any) -> tuple[str, Sequence[float]]:
    """The shortest model that holds OpenCV's coefficients."""
    matrix, given = _numbers("K", K).reshape(3, 3), _numbers("distortion", coefficients)
    if given.size not in (0, *_COUNTS):
        counts = ", ".join(map(str, _COUNTS))
        raise ValueError(f"the distortion holds {given.size} numbers; expected {counts}, in OpenCV's order")
    k1, k2, p1, p2, *others = np.concatenate([given, np.zeros(14 - given.size)])
    if any(others[4:]):
        raise ValueError(
            "the lens has a thin prism or a tilted sensor (more than 8 coefficients of OpenCV), which no camera of "
            "COLMAP has: undistort the points with cv2.undistortPoints, and leave the camera out"
        )
    params = params_of_matrix(matrix)
    if any(others):
        return "FULL_OPENCV", [*params, k1, k2, p1, p2, *others[:4]]
    return ("OPENCV", [*params, k1, k2, p1, p2]) if given.any() else ("PINHOLE", params)


def params_of_matrix(K: Array) -> list[float]:
    """fx, fy, cx and cy of a matrix (3, 3), which may be off by rounding."""
    if not np.abs(K[2] - [0, 0, 1]).max() <= _PROJECTIVE_ROUNDING:
        raise ValueError(f"the bottom row of K is {K[2]}; expected 0 0 1 (divide K by K[2, 2], or transpose it)")
    K = K / K[2, 2]
    if not np.abs([K[0, 1], K[1, 0]]).max() <= _SKEW_ROUNDING * min(abs(K[0, 0]), abs(K[1, 1])):
        raise ValueError(f"K has the skew {K[0, 1]} (and K[1, 0] is {K[1, 0]}); expected 0, as in all models")
    return [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])]


def _numbers(name: str, value: Any) -> Array:
    """Flat numbers, also of a dict of rows, columns and data, as YAML files have them; none are given as None."""
    if isinstance(value, Mapping):
        value = value.get("data")
    try:
        return np.asarray([] if value is None else as_array(value, name), dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise TypeError(f"{name} is {value!r}, which is not numbers") from None
