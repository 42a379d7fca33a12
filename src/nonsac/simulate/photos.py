"""Photos of one scene from many sides, with keypoints and matches, as matchers leave them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nonsac.cameras.camera import Camera
from nonsac.layouts import Array
from nonsac.seeds import canonical_seed

_DISTANCE, _HALF_SIZE = 4.0, 1.0
_REACH = 1.2  # radians to either side


@dataclass(frozen=True, eq=False)
class Photos:
    """Photos of points in a cube, from an arc around it.

    Attributes
    ----------
    camera : Camera
        Of all photos.
    poses : (n, 3, 4)
        From the world to the cameras.
    points : (k, 3)
    keypoints : list of (m, 2)
        In pixels, with noise.
    shown : list of (m,)
        Which point each keypoint shows.
    """

    camera: Camera
    poses: Array
    points: Array
    keypoints: list[Array]
    shown: list[NDArray[np.int64]]

    @classmethod
    def taken(
        cls, photos: int, points: int, noise: float, rng: int | np.random.Generator | None = 0, share: float = 0.4
    ) -> Photos:
        """Take photos; each shows a share of the points, more of them alike the nearer it is to another one."""
        random = np.random.default_rng(canonical_seed(rng))
        camera = Camera("PINHOLE", (1200.0, 1200.0, 800.0, 600.0), 1600, 1200)
        world = random.uniform(-_HALF_SIZE, _HALF_SIZE, (points, 3))
        poses, keypoints, shown = [], [], []
        for angle in np.linspace(-_REACH, _REACH, photos):
            place = np.array([np.sin(angle), random.uniform(-0.3, 0.3), -np.cos(angle)]) * _DISTANCE
            pose = _looking_at_origin(place)
            seen = world @ pose[:, :3].T + pose[:, 3]
            pixels = camera.project(seen[:, :2] / seen[:, 2:]) + random.normal(0.0, noise, (points, 2))
            # A point is seen from about the side that it is on.
            towards = world @ place + random.normal(0.0, 0.5 * _DISTANCE, points)
            chosen = np.argsort(-towards)[: int(share * points)]
            chosen = random.permutation(chosen)
            poses.append(pose)
            keypoints.append(pixels[chosen])
            shown.append(chosen)
        return cls(camera, np.stack(poses), world, keypoints, shown)

    def matches(
        self, first: int, second: int, wrong: float, rng: int | np.random.Generator | None = 0
    ) -> NDArray[np.int64]:
        """Which keypoints of two photos match (n, 2): all that show the same point, and a share of wrong ones besides.

        With a share of 1 none is right; there are as many then as there would be right ones.
        """
        random = np.random.default_rng(canonical_seed(rng))
        _, ours, theirs = np.intersect1d(self.shown[first], self.shown[second], return_indices=True)
        right = np.column_stack([ours, theirs])
        others = [
            random.permutation(np.setdiff1d(np.arange(len(self.keypoints[k])), column))
            for k, column in zip((first, second), right.T, strict=True)
        ]
        if wrong >= 1.0:
            return random.permutation(np.column_stack([ours, random.permutation(theirs)]))
        count = min(int(len(right) * wrong / (1.0 - wrong)), *map(len, others))
        keep = int(count * (1.0 - wrong) / wrong) if wrong > 0.0 else len(right)
        false = np.column_stack([column[:count] for column in others])
        return random.permutation(np.vstack([random.permutation(right)[:keep], false]))


def _looking_at_origin(place: Array) -> Array:
    """The pose (3, 4) of a camera at a place, whose y axis points down as far as it can."""
    forward = -place / np.linalg.norm(place)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return np.column_stack([rotation, -rotation @ place])
