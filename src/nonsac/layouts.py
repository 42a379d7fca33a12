"""What columns a row has, by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WEIGHT = "weight"


@dataclass(frozen=True)
class Columns:
    """The columns of a row, as tables name them, and how many of them each part of it has."""

    names: tuple[str, ...]
    widths: tuple[int, ...]

    def parts(self, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """The columns of each part."""
        return tuple(np.split(rows[:, : len(self.names)], np.cumsum(self.widths)[:-1], axis=1))


MATCHES = Columns(("x1", "y1", "x2", "y2"), (2, 2))
POINTS = Columns(("u", "v", "X", "Y", "Z"), (2, 3))
PAIRS = Columns(("x1", "y1", "z1", "x2", "y2", "z2"), (3, 3))
