"""Planar targets seen by one camera: which points lie on a plane, and the second pose that nearly fits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def plane_of_points(points: Array) -> tuple[Array, Array]:
    """Centre (3,) and unit normal (3,) of the least-squares plane of points (n, 3)."""
    centre = points.mean(axis=0)
    return centre, np.linalg.svd(points - centre, full_matrices=False)[2][2]


def reflected_pose(model: Array, centre: Array, normal: Array) -> Array:
    """The pose (3, 4) that turns the plane about its centre to the other side of the line of sight.

    Without perspective both poses give the same image (Oberkampf, DeMenthon and Davis 1996; Collins and Bartoli,
    "Infinitesimal plane-based pose estimation", IJCV 2014), so with little of it the other one is a second minimum.
    """
    sight = model[:, :3] @ centre + model[:, 3]
    direction = sight / np.linalg.norm(sight)
    rotation = _mirror(direction) @ model[:, :3] @ _mirror(normal)
    return np.column_stack([rotation, sight - rotation @ centre])


def _mirror(normal: Array) -> Array:
    return np.eye(3) - 2.0 * np.outer(normal, normal)
