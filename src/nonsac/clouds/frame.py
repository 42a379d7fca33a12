"""Both clouds in one frame and unit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nonsac.layouts import Array
from nonsac.problems.pose import homogeneous
from nonsac.result import Alternative, Evidence, Hypothesis, Remark, Result

_VERY_DIFFERENT = 3.0


@dataclass(frozen=True, eq=False)
class CommonFrame:
    """Both clouds near the origin and in a unit of about their size; survey coordinates keep their digits."""

    source_origin: Array
    target_origin: Array
    unit: float
    growth: float  # size of the target as a multiple of the source's

    @classmethod
    def of(cls, source: Array, target: Array) -> CommonFrame:
        boxes = [np.quantile(_some(points), [0.005, 0.5, 0.995], axis=0) for points in (source, target)]
        sizes = [float(np.linalg.norm(box[2] - box[0])) for box in boxes]
        unit, growth = max(sizes), sizes[1] / sizes[0] if min(sizes) > 0 else 1.0
        if not unit > 0:  # nearly all points are one: go by the others
            unit = max(float(np.linalg.norm(np.ptp(points, axis=0))) for points in (source, target))
        return cls(boxes[0][1], boxes[1][1], unit if unit > 0 else 1.0, growth)

    def normalised(self, points: Array, origin: Array) -> Array:
        """The points in this frame, without strays: points more than three times the clouds' size away."""
        moved = (points - origin) / self.unit
        return moved[np.abs(moved).max(axis=1) < 3.0]

    def remarks(self) -> tuple[str, ...]:
        """What is said of an answer that is not trusted, if the clouds seem to be in different units."""
        larger, smaller = ("target", "source") if self.growth > 1.0 else ("source", "target")
        factor = max(self.growth, 1.0 / self.growth)
        if factor < _VERY_DIFFERENT:
            return ()
        times = f"{float(f'{factor:.2g}'):,.10g} times"
        told = f"the {larger} is about {times} as large as the {smaller}, and no scale is estimated"
        return (Remark.SIZES_DIFFER.detailed(f"{told}; are the units the same?"),)

    def to_target(self, model: Array) -> Array:
        """A motion of the normalised clouds as a motion (4, 4) of the given ones."""
        T = homogeneous(model)
        T[:3, 3] = self.target_origin + self.unit * model[:, 3] - model[:, :3] @ self.source_origin
        return T

    def restore(self, result: Result) -> Result:
        """A result in the unit and frame of the given clouds."""
        return replace(
            result,
            model=self.to_target(result.model)[:3],
            noise=result.noise * self.unit,
            threshold=result.threshold * self.unit,
            hypotheses=tuple(map(self._restored, result.hypotheses)),
            alternatives=tuple(map(self._restored_alternative, result.alternatives)),
            evidence=Evidence(result.evidence.problem) if result.evidence else None,
        )

    def _restored_alternative(self, alternative: Alternative) -> Alternative:
        T = self.to_target(alternative.model)
        return replace(alternative, model=T[:3], T=T)

    def _restored(self, hypothesis: Hypothesis) -> Hypothesis:
        others = [self.to_target(model)[:3] for model in hypothesis.alternatives]
        return replace(
            hypothesis,
            model=self.to_target(hypothesis.model)[:3],
            residuals=hypothesis.residuals * self.unit,
            threshold=hypothesis.threshold * self.unit,
            score=hypothesis.score * self.unit,
            alternatives=np.stack(others) if others else (),
        )


def _some(points: Array) -> Array:
    return points[:: max(1, len(points) // 20_000)]
