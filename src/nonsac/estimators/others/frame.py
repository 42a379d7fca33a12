"""Coordinates that every library can live with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nonsac.layouts import Array
from nonsac.problems.registration import Registration, centre


@dataclass(frozen=True)
class Frame:
    """Points about their middle, in a unit in which they are neither large nor small.

    Some libraries compute in single precision, or have bounds in metres; and the middle of a map is far away.

    Attributes
    ----------
    middle : (3,) array
    unit : float
    """

    middle: Array
    unit: float

    @classmethod
    def of(cls, points: Array, unit: float | None = None) -> Frame:
        """The frame of points (n, 3), with a unit of their own size unless another one is given."""
        middle = centre(points)
        if unit is None:
            unit = float(np.median(np.abs(points - middle).max(axis=1))) or 1.0
        return cls(middle, unit)

    def inside(self, points: Array) -> Array:
        with np.errstate(over="ignore"):
            return np.ascontiguousarray((points - self.middle) / self.unit)

    def outside(self, linear: Array, shift: Array, target_middle: Array | float = 0.0) -> Array:
        """The motion (3, 4) of the points themselves, from one of points inside to ones in the same unit."""
        return np.column_stack([linear, self.unit * np.ravel(shift) + target_middle - linear @ self.middle])


def near(values: Array, most: float) -> Array:
    """The rows that have no value beyond this one; some libraries hang or end the process on very large ones."""
    return np.ascontiguousarray(values[(np.abs(values) < most).all(axis=1)])


@dataclass(frozen=True)
class Pairs:
    """Matched points, each half in a frame of its own with the unit of the other, and of the same scale if it is known.

    Attributes
    ----------
    source, target : (n, 3) array
    """

    source: Array
    target: Array
    frames: tuple[Frame, Frame]
    scale: float

    @classmethod
    def of(cls, problem: Registration, values: Array, unit: float) -> Pairs:
        scale = problem.scale or 1.0
        source, target = scale * values[:, :3], values[:, 3:]
        frames = Frame.of(source, unit), Frame.of(target, unit)
        return cls(frames[0].inside(source), frames[1].inside(target), frames, scale)

    def model(self, linear: Array, shift: Array) -> Array:
        """The model (3, 4) of the points themselves."""
        model = self.frames[0].outside(np.asarray(linear), shift, self.frames[1].middle)
        model[:, :3] *= self.scale
        return model
