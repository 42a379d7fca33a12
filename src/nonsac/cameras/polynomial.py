"""Distortion by polynomials, which Newton's method inverts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyder, polymul, polyroots, polysub, polyval

from nonsac.cameras.lens import Complex, Lens, square_of
from nonsac.layouts import Array

_NONE = (0j, 0j)


class Polynomial(Lens):
    """Radial, tangential and thin prism distortion, as OpenCV and COLMAP write it.

    With u = |z|^2 it is z N(u) / D(u) + 2 Re(conj(p) z) z + (p + s) u + t u^2, for p = p2 + i p1 of OpenCV, the prism
    s + t u, and polynomials N and D that are 1 at the axis.

    Parameters
    ----------
    numerator, denominator : sequence of float
        The coefficients of N and D after the leading 1.
    p : complex
    prism : pair of complex
        s and t.
    within : float
        The |z| beyond which there are no rays.
    """

    def __init__(
        self,
        numerator: Sequence[float] = (),
        denominator: Sequence[float] = (),
        p: complex = 0j,
        prism: tuple[complex, complex] = _NONE,
        within: float = np.inf,
    ) -> None:
        self.p, (self.s, self.t) = p, prism
        self.top = np.array([1.0, *numerator])
        self.bottom = np.array([1.0, *denominator]) if any(denominator) else None
        pole = np.inf if self.bottom is None else _first_root(self.bottom)
        self.limit = min(self._limit(), pole, within)
        self.reach = np.inf if self.limit == pole else self._reach()

    def distort(self, z: Complex) -> Complex:
        square = square_of(z)
        bent = z * (self._gain(square) + 2 * (self.p.conjugate() * z).real) + self.p * square
        return bent if (self.s, self.t) == _NONE else bent + (self.s + self.t * square) * square

    def undistort(self, w: Complex) -> Complex:
        """The z within the limit that is mapped to w, NaN if there is none: Newton's method, each row damped."""
        solution = np.full(len(w), complex(np.nan, np.nan))
        rows = np.flatnonzero(np.abs(w) < self.reach)
        w = w[rows]
        z = w * np.minimum(1.0, 0.9 * self.limit / np.abs(w))
        error, damping = self.distort(z) - w, np.ones(len(w))
        for _ in range(100):
            new = z - damping * self._newton_step(z, error)
            new_error = self.distort(new) - w
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
        square = square_of(z)
        bend = self._bend(square)
        a: Any = self._gain(square) + square * bend + 4 * (self.p.conjugate() * z).real
        b = z * (z * bend + 2 * self.p)
        if (self.s, self.t) != _NONE:
            prism = self.s + 2 * self.t * square
            a, b = a + prism * z.conj(), b + prism * z
        return (a.conj() * error - b * error.conj()) / (square_of(a) - square_of(b))

    def _gain(self, square: Array) -> Array:
        """N / D, by which the distance from the axis is multiplied."""
        top = np.asarray(polyval(square, self.top))
        return top if self.bottom is None else top / polyval(square, self.bottom)

    def _bend(self, square: Array) -> Array:
        """The derivative of the gain."""
        slope = polyval(square, polyder(self.top))
        if self.bottom is None:
            return np.asarray(slope)
        bottom = polyval(square, self.bottom)
        return np.asarray((slope - self._gain(square) * polyval(square, polyder(self.bottom))) / bottom)

    def _limit(self) -> float:
        """The |z| up to which the distortion is one-to-one.

        A map of a disc takes no value twice as long as the symmetric part of its Jacobian is positive definite.
        Without a prism, the Jacobian is symmetric. With q = |p| |z| and g the derivative of |z| gain, its determinant
        is then least in the direction against p if g > 6 q and gain > 10/3 q, and there it is (g - 6 q) (gain - 2 q).
        A prism takes at most e = 2 |s| |z| + 4 |t| |z|^3 from both eigenvalues, as a smaller gain would. All is
        multiplied by denominators, which are positive.
        """
        top, bottom = self.top, np.ones(1) if self.bottom is None else self.bottom
        twice = 2 * np.arange(len(bottom))
        slope: Array = polysub(polymul(top * np.arange(1, 2 * len(top), 2), bottom), polymul(top, bottom * twice))
        p, s, t = abs(self.p), abs(self.s), abs(self.t)
        along = polymul([6 * p + 2 * s, 4 * t], polymul(bottom, bottom))
        across = polymul([10 / 3 * p + 2 * s, 4 * t], bottom)
        return min(_first_root(slope, along), _first_root(top, across))

    def _reach(self) -> float:
        """No point within the limit is mapped further out."""
        if self.limit == np.inf:
            return np.inf
        square = self.limit**2
        prism = (abs(self.s) + abs(self.t) * square) * square
        return float(self.limit * self._gain(np.asarray(square)) + 3 * abs(self.p) * square + prism)


def _first_root(even: Array, odd: Array | None = None) -> float:
    """The least x > 0 with even(x^2) = x odd(x^2), given the coefficients, infinity if there is none; even(0) is 1."""
    odd = np.zeros(1) if odd is None else odd
    bound = np.zeros(2 * max(len(even), len(odd)))
    bound[: 2 * len(even) : 2] = even
    bound[1 : 2 * len(odd) : 2] = -odd
    if not np.isfinite(bound).all():
        return 0.0
    # As a polynomial in 1 / x its leading coefficient is 1, however small the others are.
    roots = polyroots(np.trim_zeros(bound, "b")[::-1])
    positive = roots.real[(roots.imag == 0) & (roots.real > 1e-12)]
    return float(1 / positive.max(initial=0.0)) if len(positive) else np.inf
