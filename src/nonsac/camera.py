"""Cameras: from pixels to undistorted normalised image coordinates (x/z, y/z) and back, with COLMAP's models.

No point is shifted: points and camera must share one convention for the centres of pixels. OpenCV and most matchers
put (0, 0) at the centre of the top-left pixel, COLMAP puts (0.5, 0.5) there. With a camera from COLMAP, add 0.5 to
the points of such a matcher; with points from COLMAP, add 0.5 to the principal point that OpenCV found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyder, polyroots, polyval
from numpy.typing import ArrayLike, NDArray

from nonsac.result import Array

__all__ = ["Camera", "CameraLike"]

Complex = NDArray[np.complex128]

_PARAMS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}


@dataclass(frozen=True)
class Camera:
    """A camera of one of COLMAP's models.

    Attributes
    ----------
    model : str
        SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV or OPENCV_FISHEYE; lower case is accepted.
    params : tuple of float
        In COLMAP's order; focal lengths and principal point in pixels.
    width, height : int or None
        Size of the image in pixels; 0 and -1, which COLMAP and PoseLib write for an unknown one, become None.
    """

    model: str
    params: tuple[float, ...]
    width: int | None = None
    height: int | None = None

    def __post_init__(self) -> None:
        model = str(self.model).upper()
        params = _checked_params(model, self.params)
        width, height = _checked_size("width", self.width), _checked_size("height", self.height)
        if (width is None) != (height is None):
            raise ValueError(f"width is {self.width} and height is {self.height}; expected both or neither")
        self.__dict__.update(model=model, params=params, width=width, height=height)

    @classmethod
    def parse(cls, value: CameraLike, name: str = "camera") -> Camera:
        """Make a camera of anything that describes one; errors call it `name`.

        Parameters
        ----------
        value : Camera, array_like, str, mapping or object
            A camera; a matrix K of shape (3, 3); the four numbers (fx, fy, cx, cy); a line of COLMAP's cameras.txt,
            with or without the id and the size, separated by spaces or commas; a dict as PoseLib and pycolmap make
            it, `{"model": "OPENCV", "params": [...], "width": 1600, "height": 1200}`; one of their camera objects.
        name : str

        Raises
        ------
        ValueError, TypeError
            If it does not describe a camera of a known model.
        """
        if isinstance(value, Camera):
            return value
        try:
            return cls(*_fields(value))
        except (TypeError, ValueError) as error:
            raise type(error)(f"{name}: {error}") from None

    def __str__(self) -> str:
        """The line of COLMAP's cameras.txt, without the id; `parse` reads it back exactly."""
        size = () if self.width is None else (self.width, self.height)
        return " ".join(map(str, (self.model, *size, *self.params)))

    @property
    def K(self) -> Array:
        """The matrix (3, 3) of the camera without its distortion."""
        fx, fy, centre = self._intrinsics
        return np.array([[fx, 0.0, centre.real], [0.0, fy, centre.imag], [0.0, 0.0, 1.0]])

    @property
    def focal(self) -> float:
        """Geometric mean of fx and fy, in pixels: a length in pixels divided by it is a normalised one."""
        fx, fy, _ = self._intrinsics
        return math.sqrt(fx * fy)

    def normalise(self, pixels: ArrayLike) -> Array:
        """Undistorted normalised coordinates (x/z, y/z) of pixels.

        Parameters
        ----------
        pixels : array_like, shape (n, 2)

        Returns
        -------
        ndarray, shape (n, 2)
            NaN where the pixel is; where the lens maps no ray to it, or only rays beyond the radius at which its
            distortion folds the image over; and where a fisheye's ray does not point forward.
        """
        w = _as_complex("pixels", pixels)
        fx, fy, centre = self._intrinsics
        out, z = _empty(len(w))
        with np.errstate(all="ignore"):
            np.subtract(w, centre, out=z)
            _scale(out, 1 / fx, 1 / fy)
            if self._lens is not None:
                z[:] = self._lens.undistort(z)
        return out

    def project(self, normalised: ArrayLike) -> Array:
        """Pixels of normalised coordinates: the inverse of `normalise`.

        As in COLMAP, the formula is applied beyond the radius where the distortion folds over, too.

        Parameters
        ----------
        normalised : array_like, shape (n, 2)
            (x/z, y/z) of points in front of the camera.

        Returns
        -------
        ndarray, shape (n, 2)
        """
        z = _as_complex("normalised", normalised)
        fx, fy, centre = self._intrinsics
        out, w = _empty(len(z))
        with np.errstate(all="ignore"):
            w[:] = z if self._lens is None else self._lens.distort(z)
            _scale(out, fx, fy)
            w += centre
        return out

    @cached_property
    def _intrinsics(self) -> tuple[float, float, complex]:
        """The focal lengths fx and fy, and the principal point cx + i cy."""
        fx, *fy, cx, cy = self.params[: _PARAMS[self.model].index("cy") + 1]
        return fx, fy[0] if fy else fx, complex(cx, cy)

    @cached_property
    def _lens(self) -> _Lens | None:
        """None where there is no distortion."""
        named = dict(zip(_PARAMS[self.model], self.params, strict=True))
        radial = [value for name, value in named.items() if name.startswith("k")]
        p = complex(named.get("p2", 0.0), named.get("p1", 0.0))
        fisheye = self.model == "OPENCV_FISHEYE"
        return _Lens(radial, p, fisheye) if fisheye or p or any(radial) else None


CameraLike = Camera | ArrayLike | str | Mapping[str, Any]


class _Lens:
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
        """The z within the limit with formula(z) = w, NaN where there is none: Newton's method, each row damped."""
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


def _as_complex(name: str, points: ArrayLike) -> Complex:
    rows = np.asarray(points, dtype=np.float64, order="C")
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise ValueError(f"{name} has shape {rows.shape}; expected (n, 2), a row for each point")
    return rows.view(np.complex128)[:, 0]


def _empty(n: int) -> tuple[Array, Complex]:
    """Room for n points, and the same memory as complex numbers, which NumPy handles several times faster."""
    out = np.empty((n, 2))
    return out, out.view(np.complex128)[:, 0]


def _scale(points: Array, x: float, y: float) -> None:
    if x == y:
        points *= x
    else:
        points[:, 0] *= x
        points[:, 1] *= y


# --- what a camera is given as: (model, params, width, height) ----------------------------


def _fields(value: Any) -> tuple[Any, ...]:
    if isinstance(value, str):
        return _from_line(value)
    if isinstance(value, Mapping):
        return _from_mapping(value)
    if hasattr(value, "params") and (hasattr(value, "model") or hasattr(value, "model_name")):
        return _from_object(value)
    return _from_numbers(value)


def _from_line(line: str) -> tuple[Any, ...]:
    words = line.replace(",", " ").split()
    if words and words[0].isdecimal():
        del words[0]  # the id
    if not words:
        raise ValueError(f"{line!r} names no model; expected for instance 'PINHOLE 1600 1200 1000 1000 800 600'")
    model, words = words[0].upper(), words[1:]
    names = _names(model)
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
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(())
    if numbers.shape == (3, 3):
        return "PINHOLE", _params_of_matrix(numbers)
    if numbers.shape == (4,):
        return "PINHOLE", numbers
    what = f"numbers of shape {numbers.shape}" if numbers.ndim else f"a {type(value).__name__}"
    raise TypeError(
        f"{what} does not describe one; expected a Camera, a 3 x 3 matrix, (fx, fy, cx, cy), a string such as "
        "'PINHOLE 1000 1000 800 600', or a dict or an object with model and params"
    )


def _params_of_matrix(K: Array) -> list[float]:
    if not np.array_equal(K[2], [0, 0, 1]):
        raise ValueError(f"the bottom row of K is {K[2]}; expected 0 0 1 (divide K by K[2, 2], or transpose it)")
    if K[0, 1] != 0 or K[1, 0] != 0:
        raise ValueError(f"K has the skew {K[0, 1]} (and K[1, 0] is {K[1, 0]}); expected 0, as in all models")
    return [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]


def _names(model: str) -> tuple[str, ...]:
    if model not in _PARAMS:
        raise ValueError(f"model is {model!r}; expected one of {', '.join(_PARAMS)}")
    return _PARAMS[model]


def _checked_params(model: str, params: ArrayLike) -> tuple[float, ...]:
    names = _names(model)
    expected = f"expected {len(names)} for {model}: {', '.join(names)}"
    try:
        numbers = np.asarray(params, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"params is {params!r}, which is not numbers; {expected}") from None
    if numbers.shape != (len(names),):
        raise ValueError(f"params holds {numbers.size} numbers in shape {numbers.shape}; {expected}")
    for name, number in zip(names, numbers, strict=True):
        if not np.isfinite(number):
            raise ValueError(f"{name} is {number}; expected a finite number")
        if name.startswith("f") and number <= 0:
            raise ValueError(f"{name} is {number}; expected a focal length above 0, in pixels")
    return tuple(numbers.tolist())


def _checked_size(name: str, size: Any) -> int | None:
    if size is None or size in (0, -1):
        return None
    if not (isinstance(size, (int, float, np.integer)) and size > 0 and float(size).is_integer()):
        raise ValueError(f"{name} is {size!r}; expected a whole number of pixels, or None for an unknown one")
    return int(size)
