"""Ways to register two raw clouds: ours, and what people use today.

Each takes a source (n, 3), a target (k, 3) and a seed, and returns a transform (4, 4) and whether it claims success.
The rivals' one length, the voxel, is a share of the target's diagonal, the same for all of them: of 2, 2.5, 3 and
5 %, 2 % did best for them on every sixth pair of the bunny scans, clean, noisy and thinned.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import nonsac

Array = NDArray[np.float64]
Answer = tuple[Array, bool]
Method = Callable[[Array, Array, int], Answer]

VOXEL = 0.02
# Share of the source's points with a neighbour in the target above which the rivals are taken to claim success.
CLAIM = 0.3

_KISS_VOXEL = 0.3


def nonsac_clouds(source: Array, target: Array, seed: int) -> Answer:
    result = nonsac.register_clouds(source, target, rng=seed)
    return result.T, result.success


def open3d_ransac(source: Array, target: Array, seed: int) -> Answer:
    """FPFH and RANSAC as in Open3D's tutorial on global registration, then point-to-plane ICP."""
    import open3d

    open3d.utility.random.seed(seed)
    voxel = voxel_of(target)
    clouds = [_open3d_cloud(points) for points in (source, target)]
    thinned = [cloud.voxel_down_sample(voxel) for cloud in clouds]
    registration = open3d.pipelines.registration
    reach = 1.5 * voxel
    found = registration.registration_ransac_based_on_feature_matching(
        *thinned,
        *(_fpfh(cloud, voxel) for cloud in thinned),
        True,
        reach,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(reach),
        ],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    )
    return _plane_icp(clouds, found.transformation, voxel)


def kiss_matcher(source: Array, target: Array, seed: int) -> Answer:
    """KISS-Matcher as in its own example, then the same ICP; its claim is `valid` and five inliers, as there."""
    import kiss_matcher

    voxel = voxel_of(target)
    matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(_KISS_VOXEL))
    # Single precision about the origin, in a unit in which the voxel is its default: it refuses small ones.
    unit = voxel / _KISS_VOXEL
    origins = source.mean(axis=0), target.mean(axis=0)
    clouds = [np.float32((cloud - origin) / unit) for cloud, origin in zip((source, target), origins, strict=True)]
    found = matcher.estimate(*clouds)
    R = np.array(found.rotation, np.float64)
    T = _rigid(R, origins[1] + unit * np.ravel(found.translation) - R @ origins[0])
    claimed = bool(found.valid) and matcher.get_num_final_inliers() >= 5
    if not np.isfinite(T).all():
        return T, False
    T, _ = _plane_icp([_open3d_cloud(points) for points in (source, target)], T, voxel)
    return T, claimed


def gicp_starts(source: Array, target: Array, seed: int, starts: int = 200) -> Answer:
    """Generalised ICP (small_gicp) from random rotations about the centroids; the answer with the closest clouds."""
    import small_gicp

    voxel = voxel_of(target)
    origins = source.mean(axis=0), target.mean(axis=0)
    centred = [cloud - origin for cloud, origin in zip((source, target), origins, strict=True)]
    (moving, _), (fixed, tree) = (small_gicp.preprocess_points(cloud, 2.0 * voxel) for cloud in centred)
    options: dict[str, Any] = {"rotation_epsilon": 1e-3, "translation_epsilon": 0.01 * voxel}
    rng = np.random.default_rng(seed)
    probes = np.asarray(moving.points())[:, :3]
    neighbors = cKDTree(np.asarray(fixed.points())[:, :3])
    best, least = np.eye(4), np.inf
    for _ in range(starts):
        start = _rigid(nonsac.simulate.random_rotation(rng), np.zeros(3))
        found = small_gicp.align(fixed, moving, tree, start, max_correspondence_distance=6.0 * voxel, **options)
        T = np.asarray(found.T_target_source)
        cost = np.minimum(neighbors.query(_moved(T, probes), distance_upper_bound=voxel)[0], voxel).mean()
        if cost < least:
            best, least = T, cost
    fine = [small_gicp.preprocess_points(cloud, 0.4 * voxel, num_threads=os.cpu_count() or 1) for cloud in centred]
    found = small_gicp.align(
        fine[1][0],
        fine[0][0],
        fine[1][1],
        best,
        max_correspondence_distance=voxel,
        num_threads=os.cpu_count(),
        **options,
    )
    T = np.array(found.T_target_source)
    near = neighbors.query(_moved(T, probes), distance_upper_bound=voxel)[0] < voxel
    T[:3, 3] += origins[1] - T[:3, :3] @ origins[0]
    return T, bool(near.mean() > CLAIM)


# Name in the tables, the modules it needs, the function.
METHODS: dict[str, tuple[str, tuple[str, ...], Method]] = {
    "nonsac": ("nonsac `register_clouds`", (), nonsac_clouds),
    "open3d": ("Open3D FPFH + RANSAC + ICP", ("open3d",), open3d_ransac),
    "gicp": ("small_gicp from 200 rotations", ("small_gicp",), gicp_starts),
    "kiss": ("KISS-Matcher + ICP", ("kiss_matcher", "open3d"), kiss_matcher),
}


def voxel_of(target: Array) -> float:
    return VOXEL * float(np.linalg.norm(np.ptp(target, axis=0)))


def _open3d_cloud(points: Array) -> Any:
    import open3d

    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))


def _fpfh(cloud: Any, voxel: float) -> Any:
    import open3d

    search = open3d.geometry.KDTreeSearchParamHybrid
    cloud.estimate_normals(search(2.0 * voxel, 30))
    return open3d.pipelines.registration.compute_fpfh_feature(cloud, search(5.0 * voxel, 100))


def _plane_icp(clouds: list[Any], T: Array, voxel: float) -> Answer:
    """Point-to-plane ICP within 0.4 voxels, as in Open3D's tutorial; claims by Open3D's fitness.

    On clouds thinned to a quarter of a voxel, as on all 300,000 points of a room it takes most of a minute.
    """
    import open3d

    source, target = (cloud.voxel_down_sample(0.25 * voxel) for cloud in clouds)
    target.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(30))
    registration = open3d.pipelines.registration
    found = registration.registration_icp(
        source, target, 0.4 * voxel, T, registration.TransformationEstimationPointToPlane()
    )
    return np.array(found.transformation), found.fitness > CLAIM


def _rigid(R: Array, t: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def _moved(T: Array, points: Array) -> Array:
    return points @ T[:3, :3].T + T[:3, 3]
