"""What a camera may be given as: a line, a mapping, an object of another library, a matrix, OpenCV's coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nonsac.cameras.calibration import calibration_of, from_calibration, from_coefficients, params_of_matrix
from nonsac.cameras.models import parameter_names
from nonsac.values.arraylike import as_array


def camera_fields(value: Any) -> tuple[Any, ...]:
    if isinstance(value, str):
        return _from_line(value)
    calibration = calibration_of(value)
    if calibration is not None:
        return from_calibration(calibration)
    if isinstance(value, Mapping):
        return _from_mapping(value)
    if hasattr(value, "params") and (hasattr(value, "model") or hasattr(value, "model_name")):
        return _from_object(value)
    if _is_matrix_and_coefficients(value):
        return from_coefficients(*value)
    return _from_numbers(value)


def _is_matrix_and_coefficients(value: Any) -> bool:
    try:
        return isinstance(value, (tuple, list)) and len(value) == 2 and as_array(value[0], "K").shape == (3, 3)
    except (TypeError, ValueError):  # no array, or rows of different lengths
        return False


def _from_line(line: str) -> tuple[Any, ...]:
    words = line.replace(",", " ").split()
    if words and words[0].isdecimal():
        del words[0]  # the id
    if not words:
        raise ValueError(f"{line!r} names no model; expected for instance 'PINHOLE 1600 1200 1000 1000 800 600'")
    model, words = words[0].upper(), words[1:]
    names = parameter_names(model)
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        raise ValueError(f"{line!r} holds a word that is not a number; expected {model} {' '.join(names)}") from None
    if len(numbers) == len(names) + 2:
        return model, numbers[2:], *numbers[:2]
    if len(numbers) == len(names):
        return model, numbers
    raise ValueError(
        f"{line!r} holds {len(numbers)} numbers; expected {len(names)} for {model} ({', '.join(names)}), "
        f"or {len(names) + 2}, with the width and the height before them"
    )


def _from_mapping(fields: Mapping[str, Any]) -> tuple[Any, ...]:
    keys = ("model", "params", "width", "height")
    for key in fields:
        if key not in (*keys, "camera_id", "id", "has_prior_focal_length"):
            raise ValueError(f"it has the unknown key {key!r}; expected {', '.join(keys)}")
    for key in keys[:2]:
        if key not in fields:
            raise ValueError(f"it has no key {key!r}; expected {', '.join(keys)} (the last two may be missing)")
    model = getattr(fields["model"], "name", fields["model"])  # pycolmap's is an enum
    return model, fields["params"], fields.get("width"), fields.get("height")


def _from_object(camera: Any) -> tuple[Any, ...]:
    model = getattr(camera, "model_name", None) or camera.model
    model = model() if callable(model) else getattr(model, "name", model)  # PoseLib's is a method
    return model, camera.params, getattr(camera, "width", None), getattr(camera, "height", None)


def _from_numbers(value: Any) -> tuple[Any, ...]:
    try:
        given = as_array(value, "camera")
        numbers = given.astype(np.float64) if given.dtype.kind in "fiuO" else np.empty(())
    except (TypeError, ValueError, OverflowError):
        numbers = np.empty(())
    if numbers.shape == (3, 3):
        return "PINHOLE", params_of_matrix(numbers)
    if numbers.shape == (4,):
        return "PINHOLE", numbers
    what = f"numbers of shape {numbers.shape}" if numbers.ndim else f"a {type(value).__name__}"
    raise TypeError(
        f"{what} does not describe one; expected a Camera, a 3 x 3 matrix, (fx, fy, cx, cy), (K, distortion), a string "
        "such as 'PINHOLE 1000 1000 800 600', or a dict or an object with model and params"
    )
