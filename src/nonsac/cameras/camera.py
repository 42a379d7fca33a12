"""Cameras: from pixels to undistorted normalised image coordinates (x/z, y/z) and back, with COLMAP's models.

No point is shifted: points and camera must share one convention for the centres of pixels. OpenCV and most matchers
put (0, 0) at the centre of the top-left pixel, COLMAP puts (0.5, 0.5) there. With a camera from COLMAP, add 0.5 to
the points of such a matcher; with points from COLMAP, add 0.5 to the principal point that OpenCV found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from nonsac.cameras.lens import Complex, Lens
from nonsac.cameras.lenses import lens_of
from nonsac.cameras.models import checked_parameters, parameter_names
from nonsac.cameras.parse import camera_fields
from nonsac.cameras.unreadable import check_readable
from nonsac.layouts import Array
from nonsac.values.checks import real_array
from nonsac.values.numeric import as_real, printable, shown

__all__ = ["Camera", "CameraLike"]


@dataclass(frozen=True)
class Camera:
    """A camera of one of COLMAP's models.

    Attributes
    ----------
    model : str
        The name of any model of COLMAP but EQUIRECTANGULAR, of which the rays go backward, too; lower case is accepted.
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
        params = checked_parameters(model, self.params)
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
            A camera; a matrix K of shape (3, 3); the four numbers (fx, fy, cx, cy); `(K, distortion)` with the 4, 5 or
            8 coefficients k1 k2 p1 p2 k3 k4 k5 k6 of OpenCV (not those of its fisheye); a line of COLMAP's cameras.txt,
            with or without the id and the size, separated by spaces or commas; a dict as PoseLib and pycolmap make
            it, `{"model": "OPENCV", "params": [...], "width": 1600, "height": 1200}`; one of their camera objects; a
            message or dict camera_info of ROS, also its fisheye ("equidistant").
        name : str

        Raises
        ------
        ValueError, TypeError
            If it does not describe a camera of a known model, or stands for one that could not be read from its file.
        """
        if isinstance(value, Camera):
            return value
        check_readable(value)
        try:
            return cls(*camera_fields(value))
        except (TypeError, ValueError) as error:
            raise type(error)(printable(f"{name}: {error}")) from None

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
            NaN if the pixel is; if the lens maps no ray to it, or only rays beyond the radius at which its
            distortion folds the image over; and if a fisheye's ray does not point forward.
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

        As in COLMAP, the formula is applied beyond the radius at which the distortion folds over, too.

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
        fx, *fy, cx, cy = self.params[: parameter_names(self.model).index("cy") + 1]
        return fx, fy[0] if fy else fx, complex(cx, cy)

    @cached_property
    def _lens(self) -> Lens | None:
        """None if there is no distortion."""
        return lens_of(self.model, dict(zip(parameter_names(self.model), self.params, strict=True)))


CameraLike = Camera | ArrayLike | str | Mapping[str, Any]


def _as_complex(name: str, points: ArrayLike) -> Complex:
    rows = np.ascontiguousarray(real_array(name, points))
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


def _checked_size(name: str, size: Any) -> int | None:
    pixels = as_real(size)
    if size is None or pixels in (0.0, -1.0):
        return None
    if not (0.0 < pixels < np.inf and pixels.is_integer()):
        raise ValueError(f"{name} is {shown(size)}; expected a whole number of pixels, or None for an unknown one")
    return int(pixels)
