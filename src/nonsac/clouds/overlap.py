"""How well two raw clouds overlap under a motion, and motions that make them overlap better."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nonsac.clouds.surfaces import NearestField, Surface
from nonsac.kernels.nearest_field import align_to_field, keep_distinct, score_models
from nonsac.layouts import Array


@dataclass(frozen=True, eq=False)
class Overlap:
    """Truncated nearest-neighbour distances between two clouds, in both directions.

    Parameters
    ----------
    source, target : Surface
    source_field, target_field : NearestField
        Around their dense points.
    """

    source: Surface
    target: Surface
    source_field: NearestField
    target_field: NearestField

    @classmethod
    def between(cls, source: Surface, target: Surface, reach: float, cell: float) -> Overlap:
        fields = (NearestField.around(s.points, s.normals, reach, cell) for s in (source, target))
        return cls(source, target, *fields)

    @property
    def reach(self) -> float:
        """Distance beyond which points do not overlap."""
        return self.target_field.reach

    def best(self, models: Array, keep: int, first: int = 32) -> Array:
        """The `keep` models under which the source lies closest to the target, best first.

        All are scored on the `first` coarse points (which are spread evenly), the more promising ones on all.
        """
        points = self.source.points[self.source.coarse]
        stride = max(1, len(points) // first)
        scores = self._scores(models, points[::stride])
        promising = np.argsort(scores, kind="stable")[: 6 * keep]
        scores = self._scores(models[promising], points)
        return models[promising[np.argsort(scores, kind="stable")[:keep]]]

    def aligned(self, models: Array, iterations: int = 15) -> Array:
        """The models moved to near minima of the source's distances to the target."""
        field = self.target_field
        moved = np.ascontiguousarray(models).copy()
        align_to_field(
            moved,
            self.source.points[self.source.coarse],
            field.points,
            field.normals,
            field.corner,
            field.cells_per_unit,
            field.reach,
            field.nearest,
            iterations,
        )
        return moved

    def residuals(self, model: Array) -> Array:
        """Distances of both clouds' coarse points to the other cloud, at most `reach`: (k + l,)."""
        forward = self.target_field.distances(model, self.source.points[self.source.coarse])
        backward = self.source_field.distances(inverse(model), self.target.points[self.target.coarse])
        return np.concatenate([forward, backward])

    def surface_distances(self, model: Array) -> Array:
        """Distance of both clouds' coarse points to the other's surface, infinite if they lie in none: (k + l,).

        In the surface are points with a neighbour within `reach`, its plane within a quarter of that, and the same
        normal up to sign and 26 degrees.
        """
        flat, cosine = self._flat, 0.9
        source, target = self.source, self.target
        return np.concatenate(
            [
                self.target_field.surface_distances(
                    model, source.points[source.coarse], source.normals[source.coarse], flat, cosine
                ),
                self.source_field.surface_distances(
                    inverse(model), target.points[target.coarse], target.normals[target.coarse], flat, cosine
                ),
            ]
        )

    def support(self, model: Array) -> float:
        """How many coarse points of both clouds lie in the other's surface, by Tukey's weights of their distances.

        Under the right motion the distances keep to the noise; by coincidence they are spread over all that is allowed.
        """
        distances = self.surface_distances(model)
        ratios = distances[np.isfinite(distances)] / self._flat
        return float(((1.0 - ratios**2) ** 2).sum())

    def agreement(self, model: Array) -> float:
        """Mean weight of the points that come within `reach` of the other cloud, 0 for those outside its surface."""
        near = int((self.residuals(model) < self.reach).sum())
        return self.support(model) / max(near, 1)

    @property
    def _flat(self) -> float:
        return 0.25 * self.reach

    def _scores(self, models: Array, points: Array) -> np.ndarray:
        field = self.target_field
        scores = np.empty(len(models), np.int32)
        columns = np.ascontiguousarray(points.T, np.float32)
        score_models(models, columns, field.corner, field.cells_per_unit, field.cost, scores)
        return scores


def inverse(model: Array) -> Array:
    """The inverse of a rigid motion (3, 4)."""
    rotation = model[:, :3].T
    return np.ascontiguousarray(np.column_stack([rotation, -rotation @ model[:, 3]]))


def distinct(models: Array, angle: float, distance: float) -> np.ndarray:
    """Numbers of the models that differ from all before them by more than `angle` degrees or `distance`."""
    chord = np.sqrt(8.0) * np.sin(np.radians(angle) / 2.0)
    kept = np.empty(len(models), np.int64)
    return kept[: keep_distinct(np.ascontiguousarray(models), chord**2, distance**2, kept)]
