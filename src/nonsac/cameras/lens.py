"""Lens distortion of normalised image coordinates, and its inverse."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial.polynomial import polyder, polyroots, polyval
from numpy.typing import NDArray

from nonsac.layouts import Array

Complex = NDArray[np.complex128]


class Lens:
    """Distortion of normalised coordinates, each point one complex number z = x + i y.

    With p = p2 + i p1, OpenCV's formula is z (1 + k1 |z|^2 + k2 |z|^4 + ...) + 2 Re(conj(p) z) z + p |z|^2. That of
    its fisheye is the same, without p, for a z as long as the angle between the ray and the axis.
    """

    def __init__(self, radial: list[float], p: complex, fisheye: bool) -> None:
        self.p, self.fisheye = p, fisheye
        self.gain = np.array([1.0, *radial])  # a polynomial in |z|^2, and so is its derivative
        self.bend = polyder(self.gain)
        self.limit = self._limit()
        self.reach = np.inf
        if self.limit < np.inf:
            self.reach = self.limit * polyval(self.limit**2, self.gain) + 3 * abs(p) * self.limit**2

    def _limit(self) -> float:
        """The |z| up to which the distortion is one-to-one, and a fisheye's ray points forward.

        The Jacobian is symmetric. While it is positive definite, it is the Hessian of a convex function, whose
        gradient takes no value twice. With q = |p| |z| and g the derivative of |z| gain, its determinant is least in
        the direction against p if g > 6 q and gain > 10/3 q, and there it is (g - 6 q) (gain - 2 q).
        """
        limits = [np.pi / 2 if self.fisheye else np.inf]
        slope = self.gain * np.arange(1, 2 * len(self.gain), 2)
        for even, factor in ((slope, 6), (self.gain, 10 / 3)):
            bound = np.zeros(2 * len(even) - 1)
            bound[::2] = even
            bound[1] = -factor * abs(self.p)
            # As a polynomial in 1 / |z| its leading coefficient is 1, however small the others are.
            roots = polyroots(bound[::-1])
            limits.extend(1 / roots.real[(roots.imag == 0) & (roots.real > 1e-12)])
        return float(min(limits))

    def distort(self, z: Complex) -> Complex:
        return self._formula(_lengthen(z, np.arctan) if self.fisheye else z)

    def undistort(self, w: Complex) -> Complex:
        z = self._solve(w)
        return _lengthen(z, np.tan) if self.fisheye else z

    def _formula(self, z: Complex) -> Complex:
        square = _square(z)
        return z * (polyval(square, self.gain) + 2 * (self.p.conjugate() * z).real) + self.p * square

    def _solve(self, w: Complex) -> Complex:
        """The z within the limit with formula(z) = w, NaN if there is none: Newton's method, each row damped."""
        solution = np.full(len(w), complex(np.nan, np.nan))
        rows = np.flatnonzero(np.abs(w) < self.reach)
        w = w[rows]
        z = w * np.minimum(1.0, 0.9 * self.limit / np.abs(w))
        error, damping = self._formula(z) - w, np.ones(len(w))
        for _ in range(100):
            new = z - damping * self._newton_step(z, error)
            new_error = self._formula(new) - w
            better = (np.abs(new) < self.limit) & (np.abs(new_error) < np.abs(error))
            moving = np.abs(new - z) > 1e-9 * np.abs(z)  # after such a step, the error is about its square
            z, error = np.where(better, new, z), np.where(better, new_error, error)
            damping = np.where(better, 1.0, damping / 4)
            solved = np.abs(error) <= 1e-12 * (1 + np.abs(w))
            solution[rows[solved]] = z[solved]
            if not moving.any():
                break
            rows, w, damping = rows[moving], w[moving], damping[moving]
            z, error = z[moving], error[moving]
        return solution

    def _newton_step(self, z: Complex, error: Complex) -> Complex:
        """The d with a d + b conj(d) = error, where a and b are the derivatives by z and conj(z)."""
        square = _square(z)
        bend = polyval(square, self.bend)
        a = polyval(square, self.gain) + square * bend + 4 * (self.p.conjugate() * z).real
        b = z * (z * bend + 2 * self.p)
        return (a * error - b * error.conj()) / (a * a - _square(b))


def _square(z: Complex) -> Array:
    return z.real * z.real + z.imag * z.imag


def _lengthen(z: Complex, function: Callable[[Array], Array]) -> Complex:
    """Apply a function to the absolute values."""
    length = np.abs(z)
    return z * np.where(length > 0, function(length) / length, 1.0)
