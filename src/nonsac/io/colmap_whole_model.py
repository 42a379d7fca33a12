"""All images of a COLMAP model, and where the points are that they show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nonsac.files.errors import FilePath, input_error
from nonsac.io.colmap_model import find_model
from nonsac.io.correspondences import Points


@dataclass(frozen=True, eq=False)
class WholeModel:
    """What is needed of a model to find where other images were taken.

    Attributes
    ----------
    path : path-like
        For messages.
    shown : dict
        By the names of images, which point each of their keypoints shows, -1 if none (n,).
    points : (k, 3)
        Where these points are.
    """

    path: FilePath
    shown: Mapping[str, NDArray[np.int64]]
    points: Points

    @classmethod
    def read(cls, path: FilePath) -> WholeModel:
        """Read the folder of a model, or one of its files.

        Raises
        ------
        InputError
            If the files are missing, cannot be read, are truncated or damaged, or do not fit each other.
        """
        reader, place, suffix = find_model(path)
        images = {name: read() for _, name, read in reader.images_of(place / f"images{suffix}")}
        if not images:
            raise input_error(place / f"images{suffix}", "holds no images", "give a model that has some")
        wanted = np.unique(np.concatenate([np.unique(image.points) for image in images.values()]))
        wanted = wanted[wanted >= 0]
        file: Path = place / f"points3D{suffix}"
        found = reader.find_points(file, frozenset(wanted.tolist()))
        missing = [number for number in wanted.tolist() if number not in found]
        if missing:
            raise input_error(file, f"holds no point {missing[0]}, which an image shows", "export the model again")
        points = np.array([found[number] for number in wanted.tolist()], np.float64).reshape(-1, 3)
        shown = {name: _places(image.points, wanted) for name, image in images.items()}
        return cls(path, shown, points)


def _places(numbers: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where the numbers of points are in a sorted list of them; -1 for none."""
    places = np.searchsorted(wanted, numbers)
    return np.where(numbers >= 0, places, -1)
