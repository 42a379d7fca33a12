"""Which points of a model an image shows, by its matches with images of the model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nonsac.files.errors import FilePath, input_error
from nonsac.io.colmap_whole_model import WholeModel
from nonsac.io.correspondences import CameraDescription, PointMatches
from nonsac.io.image_pairs import ImagePair, ImagePairs


@dataclass(frozen=True, eq=False)
class QueryPairs:
    """The pairs of images that are to be found, each with images of a model.

    Attributes
    ----------
    model : WholeModel
    source : ImagePairs
    pairs : dict
        By the names of the images that are to be found, their pairs.
    """

    model: WholeModel
    source: ImagePairs
    pairs: dict[str, list[ImagePair]]

    @classmethod
    def of(
        cls, model: WholeModel, source: ImagePairs, chosen: Sequence[ImagePair], names: Sequence[str] | None
    ) -> QueryPairs:
        """Of some pairs those with one image of the model, and one that is not in it or is named.

        Raises
        ------
        InputError
            If there is none.
        """
        wanted = None if names is None else set(names)
        found: dict[str, list[ImagePair]] = {name: [] for name in names or ()}
        for pair in chosen:
            for query, other in (pair.names, pair.names[::-1]):
                is_query = query not in model.shown if wanted is None else query in wanted
                if is_query and other in model.shown:
                    found.setdefault(query, []).append(pair)
        if not any(found.values()):
            problem = f"holds no pair of an image of {model.path} and one that is to be found there"
            raise input_error(source.path, problem, "match the images with those of the model first")
        return cls(model, source, found)

    def read(self, query: str) -> PointMatches:
        """The keypoints of an image, and the points that the keypoints show which they are matched with.

        Raises
        ------
        InputError
            What the source raises, or if it does not fit the model.
        """
        places: list[NDArray[np.int64]] = [np.empty((0, 2), np.int64)]
        pixels, camera = np.empty((0, 2)), None
        for keypoints, points, positions, described in self._matched(query):
            camera = described
            if len(keypoints) and keypoints.max() >= len(pixels):
                pixels = np.vstack([pixels, np.full((keypoints.max() + 1 - len(pixels), 2), np.nan)])
            pixels[keypoints] = positions
            places.append(np.column_stack([keypoints, points]))
        pairs = np.unique(np.concatenate(places), axis=0)  # many images show the same point
        return PointMatches(pixels[pairs[:, 0]], self.model.points[pairs[:, 1]], camera=camera)

    def has_known_focal_length(self, query: str) -> bool:
        """Whether that of an image is more than a guess."""
        return all(self.source.is_calibrated(pair, query) for pair in self.pairs[query])

    def _matched(
        self, query: str
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], CameraDescription | None]]:
        for pair in self.pairs[query]:
            matches = self.source.read(pair)
            indices = np.asarray(matches.indices)
            is_first = pair.names[0] == query
            ours, theirs = indices.T if is_first else indices.T[::-1]
            shown = self.model.shown[pair.names[1] if is_first else pair.names[0]]
            if len(theirs) and theirs.max() >= len(shown):
                raise _unfit(self.source.path, pair, self.model.path)
            points = shown[theirs]
            has_point = points >= 0
            positions = matches.points1 if is_first else matches.points2
            camera = matches.camera1 if is_first else matches.camera2
            yield ours[has_point], points[has_point], positions[has_point], camera


def _unfit(path: FilePath, pair: ImagePair, model: FilePath) -> Exception:
    problem = f"a match of {' and '.join(pair.names)} names a keypoint that the image does not have in {model}"
    return input_error(path, problem, "give the features that the model was made of")
