"""Raw clouds made ready for registration: thinned, with normals, and with a grid of nearest points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import small_gicp
from scipy.spatial import cKDTree

from nonsac.kernels.nearest_field import fill_cost, fill_nearest, nearest_distances, surface_distances
from nonsac.kernels.planes import fit_planes
from nonsac.layouts import Array

# Smallest difference of the mean log distances of clutter and surface, a factor of two; noise alone stays below 0.55.
_CLUTTER_GAP = 0.75

# With fewer points, ten neighbours span a good part of the cloud and their planes mean nothing.
_FEWEST_POINTS = 100

# Nine bytes a cell while a grid is filled.
_MAX_CELLS = 2e7


def _cells(points: Array, margin: float, cell: float) -> float:
    return float(np.prod(np.ceil((np.ptp(points, axis=0) + 2.0 * margin) / cell)))


@dataclass(frozen=True, eq=False)
class NearestField:
    """A grid of nearest points around a cloud; see `nonsac.kernels.nearest_field`."""

    points: Array
    normals: Array
    corner: Array
    cells_per_unit: float
    reach: float
    nearest: np.ndarray

    @classmethod
    def around(cls, points: Array, normals: Array, reach: float, cell: float) -> NearestField:
        """The field of a cloud (n, 3) with cells of size `cell`, up to the distance `reach` from its points."""
        margin = reach + cell
        volume = float(np.prod(np.ptp(points, axis=0) + 2.0 * margin))
        cell = max(cell, (volume / _MAX_CELLS) ** (1.0 / 3.0))
        while (cells := _cells(points, reach + cell, cell)) > 2.0 * _MAX_CELLS:  # a long, thin cloud
            cell *= (cells / _MAX_CELLS) ** (1.0 / 3.0)
        margin = reach + cell
        corner = points.min(axis=0) - margin
        shape = tuple(int(c) for c in np.ceil((points.max(axis=0) + margin - corner) / cell))
        nearest = np.empty(shape, np.int32)
        fill_nearest(points, corner, 1.0 / cell, reach, nearest)
        return cls(points, normals, corner, 1.0 / cell, reach, nearest)

    @cached_property
    def cost(self) -> np.ndarray:
        """Distance from each cell's centre to its nearest point as a share of `reach`, 0 to 255."""
        cost = np.empty(self.nearest.shape, np.uint8)
        fill_cost(self.points, self.corner, self.cells_per_unit, self.reach, self.nearest, cost)
        return cost

    def distances(self, model: Array, points: Array) -> Array:
        """Distance of each moved point to the cloud, at most `reach`: (n,)."""
        distances = np.empty(len(points))
        nearest_distances(
            model, points, self.points, self.corner, self.cells_per_unit, self.reach, self.nearest, distances
        )
        return distances

    def surface_distances(self, model: Array, points: Array, normals: Array, flat: float, cosine: float) -> Array:
        """Distance of each moved point to the surface, infinite for points that do not lie in it: (n,)."""
        distances = np.empty(len(points))
        surface_distances(
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
            distances,
        )
        return distances


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
    noisy : bool
        Whether the cloud had to be smoothed: its noise is as large as the distance between its points.
    thin : bool
        Whether it is a surface, after smoothing, and not points in a volume, or too few to tell.
    """

    points: Array
    normals: Array
    coarse: np.ndarray
    spacing: float
    noisy: bool
    thin: bool

    @classmethod
    def from_points(cls, points: Array, spacing: float | None = None, dense: int = 6000, coarse: int = 500) -> Surface:
        """Thin a cloud to at most about `dense` points, smooth it, and pick evenly spread coarse points.

        Coarse points are one in each cube of side `spacing`, or about `coarse` if it is not given.
        """
        thinned = thin_to(points, dense)
        planes = LocalPlanes.of(thinned)
        noisy = planes.thick
        if noisy:
            planes = LocalPlanes.of(thin_to(without_clutter(points), dense)).smoothed()
            thinned = planes.points
        spacing = spacing or voxel_for(thinned, min(coarse, int(0.8 * len(thinned))))
        is_surface = len(thinned) >= _FEWEST_POINTS and not planes.thick
        return cls(thinned, planes.normals, _coarse(thinned, spacing), spacing, noisy, is_surface)

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
        neighbors = (
            cKDTree(points).query(points, neighbor_count(len(points), 30), workers=-1)[1].reshape(len(points), -1)
        )
        moved, normals, variation = np.empty_like(points), np.empty_like(points), np.empty(len(points))
        fit_planes(points, neighbors, moved, normals, variation)
        return cls(moved, normals, variation)

    @property
    def thick(self) -> bool:
        """Whether the cloud is no thin surface at this resolution: noise as large as the spacing, or clutter."""
        return bool(np.median(self.variation) > 0.05)

    def smoothed(self, rounds: int = 4) -> LocalPlanes:
        """Planes of the points on these planes, and so on until the surface is thin."""
        planes = self
        for _ in range(rounds):
            if not planes.thick:
                break
            planes = LocalPlanes.of(planes.points)
        return planes


def neighbor_count(points: int, most: int) -> int:
    """How many neighbours describe the surface around a point of a cloud with this many points."""
    return min(points, int(np.clip(points // 150, 10, most)))


def without_clutter(points: Array) -> Array:
    """The cloud without points scattered in space, which are much further from their neighbours than scanned ones.

    The logarithms of the distances to the tenth neighbour are split in two so that the groups' variance is smallest
    (Otsu 1979). If the two groups lie close together there is no clutter, and nothing is removed.
    """
    distances = cKDTree(points).query(points, [min(10, len(points))], workers=-1)[0][:, 0]
    logs = np.log(np.maximum(distances, np.finfo(np.float64).tiny))
    ordered = np.sort(logs)
    size = np.arange(1, len(ordered))
    sums = np.cumsum(ordered)
    low_mean, high_mean = sums[:-1] / size, (sums[-1] - sums[:-1]) / (len(ordered) - size)
    split = int(np.argmax(size * (len(ordered) - size) * (high_mean - low_mean) ** 2))
    if high_mean[split] - low_mean[split] < _CLUTTER_GAP:
        return points
    return points[logs <= ordered[split]]


def _coarse(points: Array, spacing: float) -> np.ndarray:
    # A cube's mean point lies off a curved surface; the point nearest to it does not.
    return np.unique(cKDTree(points).query(thin(points, spacing))[1])


def thin(points: Array, voxel: float) -> Array:
    """One point, the mean, for each occupied cube of side `voxel`."""
    return np.asarray(small_gicp.voxelgrid_sampling(points, voxel).points())[:, :3].copy()


def thin_to(points: Array, count: int) -> Array:
    """The cloud itself if it has no more than 1.3 `count` points, else thinned to about `count`."""
    if len(points) <= 1.3 * count:
        return points
    return thin(points, voxel_for(points, count))


def voxel_for(points: Array, count: int) -> float:
    """Side of the cubes that thin a cloud to about `count` points."""
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    if len(points) > 20 * count:  # a first, fine thinning makes the search cheap, whatever the size of the cloud
        points = thin(points, 0.1 * extent / np.sqrt(count))
    voxel = 0.5 * extent / np.sqrt(count)
    for _ in range(12):  # surfaces: the number of occupied cubes goes with the inverse square of their side
        occupied = small_gicp.voxelgrid_sampling(points, voxel).size()
        if abs(occupied - count) <= 0.05 * count:
            break
        voxel = max(voxel * float(np.sqrt(occupied / count)), 1e-4 * extent)
    return voxel
