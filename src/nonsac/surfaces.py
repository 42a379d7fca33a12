"""Raw clouds made ready for registration: thinned, with normals, and with a grid of nearest points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import small_gicp
from scipy.spatial import cKDTree

from nonsac.kernels.nearest_field import fill_field, nearest_distances, supported_points
from nonsac.result import Array



@dataclass(frozen=True, eq=False)
class NearestField:
    """A grid of nearest points around a cloud; see `nonsac.kernels.nearest_field`."""

    points: Array
    normals: Array
    corner: Array
    cells_per_unit: float
    reach: float
    nearest: np.ndarray
    cost: np.ndarray

    @classmethod
    def around(cls, points: Array, normals: Array, reach: float, cell: float) -> NearestField:
        """The field of a cloud (n, 3) with cells of size `cell`, up to the distance `reach` from its points."""
        margin = reach + cell
        corner = points.min(axis=0) - margin
        shape = tuple(int(c) for c in np.ceil((points.max(axis=0) + margin - corner) / cell))
        nearest, cost = np.empty(shape, np.int32), np.empty(shape, np.uint8)
        fill_field(points, corner, 1.0 / cell, reach, nearest, cost)
        return cls(points, normals, corner, 1.0 / cell, reach, nearest, cost)

    def distances(self, model: Array, points: Array) -> Array:
        """Distance of each moved point to the cloud, at most `reach`: (n,)."""
        distances = np.empty(len(points))
        nearest_distances(
            model, points, self.points, self.corner, self.cells_per_unit, self.reach, self.nearest, distances
        )
        return distances

    def supported(self, model: Array, points: Array, normals: Array, flat: float, cosine: float) -> np.ndarray:
        """Which moved points lie in the cloud's surface, by distance, plane distance and normal: (n,) bool."""
        flags = np.empty(len(points), np.uint8)
        supported_points(
            model,
            points,
            normals,
            self.points,
            self.normals,
            self.corner,
            self.cells_per_unit,
            self.reach,
            self.nearest,
            flat,
            cosine,
            flags,
        )
        return flags.astype(bool)


@dataclass(frozen=True, eq=False)
class Surface:
    """A cloud at two resolutions, in a common unit near the origin.

    Attributes
    ----------
    points, normals : (n, 3) float64
        Some thousand points with unit normals of unknown sign.
    coarse : (k,) int64
        The numbers of some hundred of them, evenly spread.
    spacing : float
        Distance between neighbouring coarse points.
    """

    points: Array
    normals: Array
    coarse: np.ndarray
    spacing: float

    @classmethod
    def from_points(cls, points: Array, spacing: float | None = None, dense: int = 6000, coarse: int = 500) -> Surface:
        """Thin a cloud to at most about `dense` points, smooth it, and pick evenly spread coarse points.

        Coarse points are one in each cube of side `spacing`, or about `coarse` where it is not given.
        """
        planes = LocalPlanes.of(thin_to(points, dense))
        if planes.cluttered:
            planes = LocalPlanes.of(thin_to(without_clutter(points), dense))
        spacing = spacing or voxel_for(planes.points, coarse)
        return cls(planes.points, planes.normals, _coarse(planes.points, spacing), spacing)

    def with_spacing(self, spacing: float) -> Surface:
        """The same surface with other coarse points."""
        return replace(self, coarse=_coarse(self.points, spacing), spacing=spacing)

    @cached_property
    def oriented(self) -> Array:
        """Coarse points with their normals (k, 6)."""
        return np.hstack([self.points[self.coarse], self.normals[self.coarse]])


@dataclass(frozen=True, eq=False)
class LocalPlanes:
    """Planes through the neighbourhoods of a cloud's points.

    Attributes
    ----------
    points : (n, 3) float64
        The points, moved onto their planes, which takes most of the noise out.
    normals : (n, 3) float64
        Unit normals, of arbitrary sign.
    variation : (n,) float64
        Share of a neighbourhood's variance across its plane: 0 on a plane, 1/3 in a ball (Pauly et al. 2002).
    """

    points: Array
    normals: Array
    variation: Array

    @classmethod
    def of(cls, points: Array) -> LocalPlanes:
        count = int(np.clip(len(points) // 150, 10, 30))
        neighbors = cKDTree(points).query(points, min(count, len(points)), workers=-1)[1]
        centred = points[neighbors]
        means = centred.mean(axis=1)
        centred -= means[:, None]
        values, vectors = np.linalg.eigh(np.matmul(centred.transpose(0, 2, 1), centred))
        normals = np.ascontiguousarray(vectors[:, :, 0])
        offsets = np.einsum("ij,ij->i", points - means, normals)
        variation = values[:, 0] / np.maximum(values.sum(axis=1), np.finfo(np.float64).tiny)
        return cls(points - offsets[:, None] * normals, normals, variation)

    @property
    def cluttered(self) -> bool:
        """Whether a good part of the points lie in no surface."""
        return bool((self.variation > 0.1).mean() > 0.25)


def without_clutter(points: Array) -> Array:
    """The points in dense neighbourhoods, as scattered points are further from their neighbours than scanned ones.

    The logarithms of the distances to the tenth neighbour are split in two where the groups' variance is smallest
    (Otsu 1979).
    """
    distances = cKDTree(points).query(points, [min(10, len(points))], workers=-1)[0][:, 0]
    values = np.sort(np.log(np.maximum(distances, np.finfo(np.float64).tiny)))
    size = np.arange(1, len(values))
    total = np.cumsum(values)
    between = (total[:-1] / size - total[-1] / len(values)) ** 2 * size / (len(values) - size)
    return points[np.log(np.maximum(distances, np.finfo(np.float64).tiny)) <= values[int(np.argmax(between))]]


def _coarse(points: Array, spacing: float) -> np.ndarray:
    # A cube's mean point lies off a curved surface; the point nearest to it does not.
    return np.unique(cKDTree(points).query(thin(points, spacing))[1])


def thin(points: Array, voxel: float) -> Array:
    """One point, the mean, for each occupied cube of side `voxel`."""
    return np.asarray(small_gicp.voxelgrid_sampling(points, voxel).points())[:, :3].copy()


def thin_to(points: Array, count: int) -> Array:
    """The cloud itself where it has no more than 1.3 `count` points, else thinned to about `count`."""
    if len(points) <= 1.3 * count:
        return points
    return thin(points, voxel_for(points, count))


def voxel_for(points: Array, count: int) -> float:
    """Side of the cubes that thin a cloud to about `count` points."""
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    low, high = 1e-4 * extent, extent
    if len(points) > 20 * count:  # a first, fine thinning makes the search cheap, whatever the size of the cloud
        points = thin(points, extent / (4.0 * np.sqrt(count) * 2.0))
    for _ in range(20):
        voxel = float(np.sqrt(low * high))
        occupied = small_gicp.voxelgrid_sampling(points, voxel).size()
        if abs(occupied - count) <= 0.05 * count:
            break
        low, high = (voxel, high) if occupied > count else (low, voxel)
    return voxel
