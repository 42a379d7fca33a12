"""Registration of two raw clouds: no matches, no descriptors, no initial guess (Lee et al., Sec. 4.4, and beyond)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import small_gicp
from scipy.spatial import cKDTree

from nonsac.executors import cores
from nonsac.fitting import reweighted_fit
from nonsac.overlap import Overlap, distinct
from nonsac.problems import Problem, Registration
from nonsac.refine import Refinement, Rows
from nonsac.result import Alternative, Array, Hypothesis, Result, homogeneous
from nonsac.surfaces import Surface, neighbor_count, thin_to
from nonsac.verdict import judge_overlap

# Answers nearer to each other than this are one answer.
SAME_ANGLE = 8.0

_MOST_COINCIDING = 20_000


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
        if not unit > 0:  # nearly all points are one: go by the others
            unit = max(float(np.linalg.norm(np.ptp(points, axis=0))) for points in (source, target))
        return cls(boxes[0][1], boxes[1][1], unit if unit > 0 else 1.0)

    def normalised(self, points: Array, origin: Array) -> Array:
        """The points in this frame, without strays: points more than three times the clouds' size away."""
        moved = (points - origin) / self.unit
        return moved[np.abs(moved).max(axis=1) < 3.0]

    def to_target(self, model: Array) -> Array:
        """A motion of the normalised clouds as a motion (4, 4) of the given ones."""
        T = homogeneous(model)
        T[:3, 3] = self.target_origin + self.unit * model[:, 3] - model[:, :3] @ self.source_origin
        return T

    def restore(self, result: Result) -> Result:
        """A result in the unit and frame of the given clouds."""
        return replace(
            result,
            T=self.to_target(result.T[:3]),
            noise=result.noise * self.unit,
            threshold=result.threshold * self.unit,
            hypotheses=tuple(map(self._restored, result.hypotheses)),
            alternatives=tuple(replace(a, T=self.to_target(a.T[:3])) for a in result.alternatives),
            evidence=None,
        )

    def _restored(self, hypothesis: Hypothesis) -> Hypothesis:
        others = [self.to_target(model)[:3] for model in hypothesis.alternatives]
        return replace(
            hypothesis,
            model=self.to_target(hypothesis.model)[:3],
            residuals=hypothesis.residuals * self.unit,
            threshold=hypothesis.threshold * self.unit,
            score=hypothesis.score * self.unit,
            alternatives=np.stack(others) if others else hypothesis.alternatives,
        )


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
    source, target : (n, 3) float64
        The full clouds, for the fine alignment.
    candidates : int
        Distinct answers that are compared.
    """

    coarse: Overlap
    source: Array
    target: Array
    candidates: int = 60

    def refine(
        self, problem: Problem, hypotheses: Sequence[Hypothesis], winner: int, union: Rows, threshold: float
    ) -> Refinement:
        fine = dense_overlap(self.coarse)
        models, supports = self._compared(fine, self._distinct_answers(hypotheses))
        best = self._finished(fine, models[0], supports[0])
        distances = fine.surface_distances(best)
        inside = np.isfinite(distances)
        shares = [float(half.mean()) for half in np.split(inside, [len(fine.source.coarse)])]
        verdict = judge_overlap(
            shares, fine.agreement(best), fine.support(best), supports[1:], fine.source.thin and fine.target.thin
        )
        distances, total = distances[inside], len(distances)
        return Refinement(
            best,
            verdict.status,
            verdict.confidence,
            num_inliers=len(distances),
            num_rows=total,
            alternatives=tuple(
                Alternative(homogeneous(model), float(np.isfinite(fine.surface_distances(model)).mean()))
                for model in models[1:4]
            ),
            noise=1.4826 * float(np.median(distances)) if len(distances) else float("nan"),
            threshold=fine.reach,
        )

    def _compared(self, fine: Overlap, models: Array) -> tuple[Array, np.ndarray]:
        """The distinct answers after alignment on the dense surfaces, and their supports, best first."""
        every = max(1, len(fine.source.coarse) // 1500)
        sparse = replace(fine, source=replace(fine.source, coarse=fine.source.coarse[::every]))
        models = sparse.aligned(models)
        supports = np.array([fine.support(model) for model in models])
        order = np.argsort(-supports, kind="stable")
        kept = order[distinct(models[order], SAME_ANGLE, self.coarse.reach)]
        return models[kept], supports[kept]

    def _distinct_answers(self, hypotheses: Sequence[Hypothesis]) -> Array:
        """The answers of all samples, those under which the coarse clouds are closest first."""
        models = np.concatenate([np.concatenate([h.model[None], h.alternatives]) for h in hypotheses if h.found])
        costs = [self.coarse.residuals(model).sum() for model in models]
        models = models[np.argsort(costs, kind="stable")]
        return models[distinct(models, SAME_ANGLE, self.coarse.reach)[: self.candidates]]

    def _finished(self, fine: Overlap, model: Array, support: float) -> Array:
        """The winner after a fine alignment, unless that lost support."""
        if fine.source.noisy or fine.target.noisy:
            finished = align_finely(fine.source.points, fine.target.points, model, 0.5 * fine.reach)
        else:
            finished = align_finely(self.source, self.target, model, 0.25 * fine.reach)
        if fine.support(finished) < 0.97 * support:
            finished = model
        return align_coinciding(self.source, self.target, finished)


def coarse_overlap(source: Surface, target: Surface) -> Overlap:
    """The overlap of two surfaces thinned to one spacing, on which motions are ranked.

    The finer of the two spacings is used, so that a small object in a large scene keeps its points, but not finer
    than half the coarser one.
    """
    spacings = source.spacing, target.spacing
    spacing = max(min(spacings), 0.5 * max(spacings))
    return Overlap.between(source.with_spacing(spacing), target.with_spacing(spacing), 1.5 * spacing, 0.6 * spacing)


def dense_overlap(coarse: Overlap) -> Overlap:
    """The overlap of the same surfaces with all their points, at the reach that their spacing allows."""
    source, target = (replace(s, coarse=np.arange(len(s.points))) for s in (coarse.source, coarse.target))
    spacing = max(s.spacing * np.sqrt(len(s.coarse) / len(s.points)) for s in (coarse.source, coarse.target))
    reach = 2.0 * float(spacing)
    return Overlap.between(source, target, reach, 0.3 * reach)


def align_finely(source: Array, target: Array, model: Array, reach: float, points: int = 10_000) -> Array:
    """Generalised ICP between the full clouds, from a start that is nearly right (Segal et al. 2009, small_gicp)."""
    clouds = []
    for cloud in (source, target):
        prepared = small_gicp.PointCloud(thin_to(cloud, points))
        tree = small_gicp.KdTree(prepared)
        threads = cores() if prepared.size() > 2000 else 1  # starting threads costs more than they save on few points
        small_gicp.estimate_covariances(prepared, tree, neighbor_count(prepared.size(), 20), num_threads=threads)
        clouds.append((prepared, tree))
    (moving, _), (fixed, tree) = clouds
    result = small_gicp.align(
        fixed,
        moving,
        tree,
        homogeneous(model),
        registration_type="GICP",
        max_correspondence_distance=reach,
        rotation_epsilon=2e-4,
        translation_epsilon=2e-5,
    )
    return np.ascontiguousarray(result.T_target_source[:3])


def align_coinciding(source: Array, target: Array, model: Array, rounds: int = 10) -> Array:
    """Align clouds that hold the same physical points, in part, by these points; other clouds stay as they are.

    Two scans sample a surface independently, and matching their points to each other adds the sampling to the noise.
    But where the clouds are subsets of one, or surveyed landmarks, their common points match one to one, and are
    better evidence than any surface. They betray themselves by nearest neighbours that are nearer than independent
    sampling explains: the eight neighbours around a target point, out to d, give the chance 1 - exp(-8 (r / d)^2) of
    a point within r on a surface.

    Larger clouds than 20,000 points are left alone: their surfaces are dense enough.
    """
    if max(len(source), len(target)) > _MOST_COINCIDING:
        return model
    tree = cKDTree(target)
    scale = tree.query(target, [min(9, len(target))])[0][:, 0]
    registration, aligned, reach = Registration(), model, 0.5 * float(np.median(scale))
    for _ in range(rounds):
        distances, nearest = tree.query(apply(aligned, source))
        matched = distances < reach
        if matched.sum() < 10:
            return model
        rows = np.hstack([source, target[nearest]])[matched]
        aligned = reweighted_fit(registration, aligned, rows, reach, 5)
        # Four standard deviations of a coordinate: the median length of a 3D Gaussian vector is 1.54 of them.
        reach = min(reach, 4.0 / 1.54 * float(np.median(distances[matched])))
    distances, nearest = tree.query(apply(aligned, source))
    overlapping = int((distances < scale[nearest]).sum())
    near = int((distances < 0.2 * scale[nearest]).sum())
    chance = 1.0 - np.exp(-8.0 * 0.2**2)
    explained = overlapping * chance + 5.0 * np.sqrt(overlapping * chance * (1.0 - chance))
    return aligned if near > explained else model


def apply(model: Array, points: Array) -> Array:
    return points @ model[:, :3].T + model[:, 3]


def _some(points: Array) -> Array:
    return points[:: max(1, len(points) // 20_000)]
