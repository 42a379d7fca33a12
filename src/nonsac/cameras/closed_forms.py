"""Lenses that move points along the line to the axis by functions with a closed inverse."""

from __future__ import annotations

import math

import numpy as np

from nonsac.cameras.lens import Radial
from nonsac.layouts import Array

# Below this angle the field-of-view model differs from a pinhole by less than rounding.
_NO_ANGLE = 1e-8


def equidistant() -> Radial:
    """An ideal fisheye: distances are the angles between rays and axis; rays point forward."""
    return Radial(np.arctan, lambda angle: np.where(angle < np.pi / 2, np.tan(angle), np.nan))


def field_of_view(omega: float) -> Radial | None:
    """The model of Devernay and Faugeras; None if there is no distortion."""
    omega = abs(omega)
    if omega < _NO_ANGLE:
        return None
    scale = 2 * math.tan(omega / 2)

    def inward(w: Array) -> Array:
        return np.where(w * omega < np.pi / 2, np.tan(w * omega) / scale, np.nan)

    return Radial(lambda z: np.arctan(z * scale) / omega, inward)


def division(k: float) -> Radial | None:
    """Fitzgibbon's model, z = w / (1 + k |w|^2); None if there is no distortion."""
    if k == 0:
        return None

    def inward(w: Array) -> Array:
        # For k > 0 it folds over where the derivative vanishes, for k < 0 rays turn sideways.
        return np.where(abs(k) * w * w < 1, w / (1 + k * w * w), np.nan)

    return Radial(lambda z: 2 * z / (1 + np.sqrt(1 - 4 * k * z * z)), inward)


def enhanced_unified(alpha: float, beta: float) -> Radial | None:
    """The enhanced unified camera model of Khomutenko et al.; None if there is no distortion."""
    if alpha == 0:
        return None

    def outward(z: Array) -> Array:
        return np.asarray(z / (alpha * np.sqrt(beta * z * z + 1) + 1 - alpha))

    def inward(w: Array) -> Array:
        square = beta * w * w
        depth = (1 - alpha**2 * square) / (alpha * np.sqrt(1 - (2 * alpha - 1) * square) + 1 - alpha)
        return np.where(depth > 0, w / depth, np.nan)

    return Radial(outward, inward)
