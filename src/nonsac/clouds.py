"""Registration of two raw clouds: no matches, no descriptors, no initial guess (Lee et al., Sec. 4.4, and beyond)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import small_gicp

from nonsac.overlap import Overlap, distinct, inverse
from nonsac.problems import Problem
from nonsac.refine import Refinement
from nonsac.result import Alternative, Array, Hypothesis, homogeneous
from nonsac.surfaces import Surface, thin_to
from nonsac.verdict import judge_overlap

# Answers nearer to each other than this are one answer.
SAME_ANGLE = 8.0


@dataclass(frozen=True, eq=False)
class CommonFrame:
    """Both clouds near the origin and in a unit of about their size; survey coordinates keep their digits."""

    source_origin: Array
    target_origin: Array
    unit: float

    @classmethod
    def of(cls, source: Array, target: Array) -> CommonFrame:
        boxes = [np.quantile(_some(points), [0.005, 0.5, 0.995], axis=0) for points in (source, target)]
        unit = max(float(np.linalg.norm(box[2] - box[0])) for box in boxes)
        return cls(boxes[0][1], boxes[1][1], unit)

    def to_target(self, model: Array) -> Array:
        """A motion of the normalised clouds as a motion (4, 4) of the given ones."""
        T = homogeneous(model)
        T[:3, 3] = self.target_origin + self.unit * model[:, 3] - model[:, :3] @ self.source_origin
        return T


@dataclass(frozen=True)
class Agreement:
    """Stop when several samples found the lowest-cost answer by themselves and nothing else comes near it.

    Parameters
    ----------
    reach : float
        Distance, in the clouds' unit, below which two answers are the same.
    count : int
        Samples that must agree.
    lead : float
        By how much the mean residual, as a share of the threshold, must be below that of any other answer.
    """

    reach: float
    count: int = 3
    lead: float = 0.03

    def __call__(self, hypotheses: Sequence[Hypothesis], problem: Problem) -> bool:
        found = [h for h in hypotheses if h.found]
        if len(found) < self.count:
            return False
        models = np.stack([h.model for h in found])
        costs = np.array([h.residuals.mean() for h in found]) / found[0].threshold
        best = models[int(np.argmin(costs))]
        near = (problem.distance(models, best) < SAME_ANGLE) & (
            np.linalg.norm(models[:, :, 3] - best[:, 3], axis=1) < self.reach
        )
        others = costs[~near]
        return bool(near.sum() >= self.count and (others.size == 0 or others.min() - costs.min() > self.lead))


@dataclass(frozen=True, eq=False)
class SurfaceRefiner:
    """Align the best distinct answers on the dense surfaces, compare how much of them coincides, finish the winner.

    Parameters
    ----------
    coarse : Overlap
        On which the hypotheses were found.
    frame : CommonFrame
    source, target : (n, 3) float64
        The full clouds in the common frame, for the fine alignment.
    candidates : int
        Distinct answers that are compared.
    """

    coarse: Overlap
    frame: CommonFrame
    source: Array
    target: Array
    candidates: int = 20

    def refine(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], winner: int, rows: Array, threshold: float
    ) -> Refinement:
        fine = dense_overlap(self.coarse)
        models = self._distinct_answers(hypotheses)
        every = max(1, len(fine.source.coarse) // 1500)
        sparse = replace(fine, source=replace(fine.source, coarse=fine.source.coarse[::every]))
        models = sparse.aligned(models, 15)
        supports = np.array([sum(fine.support(model)) for model in models])
        order = np.argsort(-supports, kind="stable")
        models, supports = models[order], supports[order]
        kept = distinct(models, SAME_ANGLE, self.coarse.reach)
        models, supports = models[kept], supports[kept]
        best, inliers = self._finished(fine, models[0], int(supports[0]))
        total = len(fine.source.coarse) + len(fine.target.coarse)
        verdict = judge_overlap(inliers, supports[1:], total)
        alternatives = tuple(
            Alternative(self.frame.to_target(model), float(support) / total)
            for model, support in zip(models[1:4], supports[1:4], strict=True)
        )
        return Refinement(best, verdict.status, verdict.confidence, inliers, total, alternatives)

    def _distinct_answers(self, hypotheses: Sequence[Hypothesis]) -> Array:
        """The answers of all samples, those under which the coarse clouds are closest first."""
        models = np.concatenate([np.concatenate([h.model[None], h.alternatives]) for h in hypotheses if h.found])
        costs = [self.coarse.residuals(model).sum() for model in models]
        models = models[np.argsort(costs, kind="stable")]
        return models[distinct(models, SAME_ANGLE, self.coarse.reach)[: self.candidates]]

    def _finished(self, fine: Overlap, model: Array, support: int) -> tuple[Array, int]:
        """The winner after the fine alignment of the full clouds, unless that lost support."""
        finished = align_finely(self.source, self.target, model, fine.reach)
        gained = sum(fine.support(finished))
        return (finished, gained) if gained >= 0.95 * support else (model, support)


def dense_overlap(coarse: Overlap) -> Overlap:
    """The overlap of the same surfaces with all their points, at the reach that their spacing allows."""
    source, target = (replace(s, coarse=np.arange(len(s.points))) for s in (coarse.source, coarse.target))
    spacing = max(s.spacing * np.sqrt(len(s.coarse) / len(s.points)) for s in (coarse.source, coarse.target))
    reach = 2.0 * float(spacing)
    return Overlap.between(source, target, reach, 0.3 * reach)


def align_finely(source: Array, target: Array, model: Array, reach: float, points: int = 30_000) -> Array:
    """Generalised ICP between the full clouds, from a start that is nearly right (Segal et al. 2009, small_gicp)."""
    clouds = []
    for cloud in (source, target):
        prepared = small_gicp.PointCloud(thin_to(cloud, points))
        tree = small_gicp.KdTree(prepared)
        small_gicp.estimate_covariances(prepared, tree, 20)
        clouds.append((prepared, tree))
    (moving, _), (fixed, tree) = clouds
    result = small_gicp.align(
        fixed,
        moving,
        tree,
        homogeneous(model),
        registration_type="GICP",
        max_correspondence_distance=reach,
        max_iterations=30,
        rotation_epsilon=1e-5,
        translation_epsilon=1e-6,
    )
    return np.ascontiguousarray(result.T_target_source[:3])


def _some(points: Array) -> Array:
    return points[:: max(1, len(points) // 20_000)]
