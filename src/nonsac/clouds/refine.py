"""Registration of two raw clouds: no matches, no descriptors, no initial guess (Lee et al., Sec. 4.4, and beyond)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import small_gicp
from scipy.spatial import cKDTree

from nonsac.clouds.overlap import Overlap, distinct
from nonsac.clouds.search import SAME_ANGLE
from nonsac.clouds.surfaces import Surface, neighbor_count, thin_to
from nonsac.clouds.verdict import judge_overlap
from nonsac.layouts import Array, Rows
from nonsac.method.refine import Refinement, Refiner
from nonsac.method.search import Search
from nonsac.method.verdict import alternative
from nonsac.problems import Registration
from nonsac.problems.fits import reweighted_fit
from nonsac.problems.pose import homogeneous
from nonsac.result import Hypothesis
from nonsac.running.openmp import openmp_threads

_MOST_COINCIDING = 20_000


@dataclass(frozen=True, eq=False)
class SurfaceRefiner(Refiner):
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

    def refine(self, search: Search, winner: int) -> Refinement:
        fine = dense_overlap(self.coarse)
        models, supports = self._compared(fine, self._distinct_answers(search.hypotheses))
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
                alternative(search.problem, model, float(np.isfinite(fine.surface_distances(model)).mean()))
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
        models = np.array([model for h in hypotheses if h.found for model in (h.model, *h.alternatives)])
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
        threads = openmp_threads() if prepared.size() > 2000 else 1  # on few points they cost more than they save
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
    But if the clouds are subsets of one, or surveyed landmarks, their common points match one to one, and are
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
        aligned = reweighted_fit(registration, aligned, Rows(rows), reach, 5)
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
