"""Arrays as other libraries have them: tensors, tables, clouds, keypoints, masked and missing numbers."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.values.quiet import quiet

# What libraries call the coordinates of a cloud, those that are scaled and shifted first.
_COORDINATES = ("xyz", "points", "vertices")


def as_array(value: Any, name: str, expected: str = "an array of real numbers") -> NDArray[Any]:
    """An array of what was passed as `name`, of its own type and not copied if that can be.

    What is masked or missing is NaN. Tensors are taken off their graph and device.

    Raises
    ------
    TypeError, ValueError
        If it is no array; the message says what is expected and, as far as this is known, what to pass instead.
    """
    if type(value) is np.ndarray:
        return _at_most_double(value)
    _refuse_what_is_none(value, name, expected)
    try:
        return _at_most_double(_converted(value))
    except (TypeError, ValueError, RuntimeError, AttributeError) as error:
        kind = ValueError if isinstance(error, ValueError) else TypeError
        what = f"{name} must be {expected}, got {type(value).__name__}"
        raise kind(f"{what} that NumPy cannot take: {' '.join(str(error).split())}") from None


def cloud_array(value: Any, name: str, expected: str) -> NDArray[Any]:
    """As `as_array`, also of the clouds and meshes of Open3D, laspy, trimesh, PyVista and such: their coordinates."""
    if not hasattr(value, "__array__") and not isinstance(value, Sequence):
        tensors = getattr(value, "point", None)  # Open3D's clouds of tensors
        if tensors is not None and "positions" in tensors:
            return as_array(tensors["positions"].cpu().numpy(), name, expected)
        for attribute in _COORDINATES:
            if hasattr(value, attribute) and not hasattr(value, "columns"):
                return as_array(getattr(value, attribute), name, expected)
    return as_array(value, name, expected)


def column_names(value: Any) -> tuple[str, ...]:
    """What the columns of a DataFrame are called; empty if it is none, or if they have no names."""
    columns = getattr(value, "columns", None)
    if columns is None or not hasattr(value, "to_numpy"):
        return ()
    return tuple(columns) if all(isinstance(column, str) for column in columns) else ()


def _converted(value: Any) -> NDArray[Any]:
    if np.ma.isMaskedArray(value):
        return np.asarray(np.ma.filled(value.astype(np.float64), np.nan))
    if hasattr(value, "detach"):
        return _of_tensor(value)
    if hasattr(value, "__cuda_array_interface__") and hasattr(value, "get"):  # CuPy
        return np.asarray(value.get())
    if hasattr(value, "to_numpy"):
        return _of_table(value)
    if isinstance(value, (list, tuple)) and len(value):
        if hasattr(value[0], "pt"):
            return np.array([point.pt for point in value], dtype=np.float64)
        if hasattr(value[0], "detach"):
            return np.stack([_converted(row) for row in value])
    array = np.asarray(value)
    if array.dtype.kind == "V" and "float" in array.dtype.name:  # the bfloat16 of JAX
        return array.astype(np.float64)
    return array


@quiet
def _at_most_double(array: NDArray[Any]) -> NDArray[Any]:
    """Numbers of more than 64 bits, which may be too large for a double, as doubles."""
    return array.astype(np.float64) if array.dtype.kind == "f" and array.dtype.itemsize > 8 else array


def _of_tensor(tensor: Any) -> NDArray[Any]:
    """An array of a tensor, which may have a gradient, lie on an accelerator or be of a type that NumPy lacks."""
    tensor = tensor.detach().cpu()
    try:
        return np.asarray(tensor.numpy())
    except (AttributeError, TypeError):
        return np.asarray(tensor.double())


def _of_table(table: Any) -> NDArray[Any]:
    """An array of a DataFrame or a column, of which numbers may be missing."""
    array = np.asarray(table.to_numpy())
    if array.dtype.kind != "O":
        return array
    try:
        return np.asarray(table.to_numpy(dtype=np.float64, na_value=np.nan))
    except (TypeError, ValueError):
        return array  # words, say


def _refuse_what_is_none(value: Any, name: str, expected: str) -> None:
    must = f"{name} must be {expected}"
    if value is None:
        raise TypeError(f"{must}, got None")
    if isinstance(value, (str, bytes, os.PathLike)):
        raise TypeError(
            f"{must}, got the path {os.fspath(value)!r}: read the file first, with nonsac.io.read_cloud or "
            "nonsac.open_source"
        )
    if isinstance(value, (list, tuple)) and len(value) and hasattr(value[0], "queryIdx"):
        raise TypeError(
            f"{must}, got matches of OpenCV: pass the points that they name, "
            "[keypoints1[m.queryIdx].pt for m in matches] and [keypoints2[m.trainIdx].pt for m in matches]"
        )
