"""Random motions, and the checks of what is asked for."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nonsac.values.numeric import as_real, as_whole, shown

Floats = NDArray[np.float64]
Seed = int | np.random.Generator


def random_rotation(rng: Seed) -> Floats:
    """Rotation drawn uniformly from all rotations.

    Parameters
    ----------
    rng : int or numpy.random.Generator

    Returns
    -------
    ndarray, shape (3, 3)
    """
    quaternion = generator_of(rng).standard_normal(4)
    return np.asarray(Rotation.from_quat(quaternion).as_matrix(), dtype=np.float64)


def rotation_about(axis: Floats, angle: float) -> Floats:
    """Rotation (3, 3) by an angle in radians about an axis of any length."""
    return np.asarray(Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix(), dtype=np.float64)


def random_motion(generator: np.random.Generator, scale: float = 1.0) -> Floats:
    T = np.eye(4)
    T[:3, :3] = scale * random_rotation(generator)
    T[:3, 3] = generator.uniform(-1.0, 1.0, 3)
    return T


def move(T: Floats, points: Floats) -> Floats:
    return points @ T[:3, :3].T + T[:3, 3]


def generator_of(rng: Seed) -> np.random.Generator:
    if isinstance(rng, np.random.Generator):
        return rng
    seed = as_whole(rng)
    if seed is None or seed < 0:
        raise TypeError(f"rng is {shown(rng)}; expected a whole number of at least 0 or a numpy.random.Generator")
    return np.random.default_rng(seed)


def check_count(name: str, value: int) -> None:
    if not 1 <= (as_whole(value) or 0) <= 2**53:
        raise ValueError(f"{name} is {shown(value)}; expected a whole number of at least 1, and less than 10^16")


def check_share(name: str, value: float) -> None:
    if not 0.0 <= as_real(value) <= 1.0:
        raise ValueError(f"{name} is {shown(value)}; expected a number from 0 to 1")


def check_not_negative(name: str, value: float) -> None:
    if not 0.0 <= as_real(value) < np.inf:
        raise ValueError(f"{name} is {shown(value)}; expected a finite number of at least 0")
