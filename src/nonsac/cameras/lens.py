"""What a lens does to normalised image coordinates, each point one complex number z = x + i y, and its inverse."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from nonsac.layouts import Array

Complex = NDArray[np.complex128]


class Lens(ABC):
    """Distortion of normalised coordinates."""

    @abstractmethod
    def distort(self, z: Complex) -> Complex:
        """Where the lens maps the rays."""

    @abstractmethod
    def undistort(self, w: Complex) -> Complex:
        """The rays that it maps there; NaN if there is none."""


class Chain(Lens):
    """One lens after the other, as light passes them."""

    def __init__(self, lenses: Sequence[Lens]) -> None:
        self.lenses = tuple(lenses)

    def distort(self, z: Complex) -> Complex:
        for lens in self.lenses:
            z = lens.distort(z)
        return z

    def undistort(self, w: Complex) -> Complex:
        for lens in reversed(self.lenses):
            w = lens.undistort(w)
        return w


class Radial(Lens):
    """A lens that changes the distance from the axis only, by one function, and back by another."""

    def __init__(self, outward: Callable[[Array], Array], inward: Callable[[Array], Array]) -> None:
        self.outward, self.inward = outward, inward

    def distort(self, z: Complex) -> Complex:
        return _lengthen(z, self.outward)

    def undistort(self, w: Complex) -> Complex:
        return _lengthen(w, self.inward)


def square_of(z: Complex) -> Array:
    """The squared absolute values."""
    return z.real * z.real + z.imag * z.imag


def _lengthen(z: Complex, function: Callable[[Array], Array]) -> Complex:
    """Apply a function to the absolute values."""
    length = np.abs(z)
    return z * np.where(length > 0, function(length) / length, 1.0)
