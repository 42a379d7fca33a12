import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import ks_2samp, kstest

from nonsac.simulate import (
    absolute_pose,
    cloud_pair,
    demo_scans,
    elephant,
    random_rotation,
    registration,
    relative_pose,
)


def move(T, points):
    return points @ T[:3, :3].T + T[:3, 3]


def assert_rigid(T):
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_array_equal(T[3], [0, 0, 0, 1])


def assert_same(first, second):
    for field in dataclasses.fields(first):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name))


def a_cloud(n=2000):
    return np.random.default_rng(5).standard_normal((n, 3)) * [3.0, 1.0, 2.0] + [100.0, -50.0, 7.0]


makers = pytest.mark.parametrize(
    "make",
    [
        lambda rng: registration(50, 0.4, 0.01, rng),
        lambda rng: cloud_pair(a_cloud(), rng, points=40),
        lambda rng: demo_scans(rng, points=60),
        lambda rng: relative_pose(50, 0.4, 0.01, rng),
        lambda rng: absolute_pose(50, 0.4, 0.01, rng),
    ],
    ids=["registration", "cloud_pair", "demo_scans", "relative_pose", "absolute_pose"],
)


@makers
def test_a_seed_gives_the_same_data_and_another_seed_others(make):
    data, rng = make(7), np.random.default_rng(7)
    assert_same(data, make(rng))
    for other in (make(8), make(rng)):  # the generator has moved on
        for name in {field.name for field in dataclasses.fields(data)} - {"overlap", "T"}:
            assert not np.array_equal(getattr(data, name), getattr(other, name))


@makers
def test_what_comes_back_is_frozen(make):
    data = make(0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        data.T = np.eye(4)


@makers
@pytest.mark.parametrize("rng", [None, True, -1, 0.5, "0"])
def test_a_bad_rng_is_refused(make, rng):
    with pytest.raises(TypeError, match=r"^rng is .*expected"):
        make(rng)


def test_random_rotation_is_uniform():
    rng = np.random.default_rng(1)
    R = np.array([random_rotation(rng) for _ in range(2000)])
    np.testing.assert_allclose(R @ R.swapaxes(1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    assert np.all(np.linalg.det(R) > 0)
    # Every entry is uniform in [-1, 1] (Archimedes), and the angle has the density (1 - cos a) / pi.
    assert all(kstest(R[:, i, j], "uniform", (-1, 2)).pvalue > 1e-4 for i in range(3) for j in range(3))
    angles = np.arccos(np.clip((np.trace(R, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert kstest(angles, lambda a: (a - np.sin(a)) / np.pi).pvalue > 1e-3


@pytest.mark.parametrize("scale", [1.0, 0.2, 30.0])
def test_registration_maps_inliers_within_the_noise(scale):
    data = registration(6000, 0.3, 0.01, 3, scale)
    assert data.inliers.sum() == 4200
    assert_rigid(np.vstack([data.T[:3] / [scale, scale, scale, 1], data.T[3]]))
    residuals = (data.target - move(data.T, data.source))[data.inliers]
    assert residuals.std() == pytest.approx(0.01, rel=0.03)
    assert kstest(residuals.ravel() / 0.01, "norm").pvalue > 1e-3


def test_registration_source_is_uniform_in_the_unit_cube():
    source = registration(4000, 0.9, 0.01, 4).source
    assert all(kstest(source[:, axis], "uniform").pvalue > 1e-3 for axis in range(3))


def test_registration_outliers_are_uniform_in_the_ball_about_the_moved_cube():
    data = registration(5000, 0.8, 0.01, 6, scale=2.0)
    offsets = (data.target - move(data.T, np.full((1, 3), 0.5)))[~data.inliers] / np.sqrt(3.0)
    radii = np.linalg.norm(offsets, axis=1)
    assert radii.max() <= 1
    assert kstest(radii**3, "uniform").pvalue > 1e-3
    assert all(kstest(offsets[:, k] / radii, "uniform", (-1, 2)).pvalue > 1e-3 for k in range(3))


def test_registration_outliers_are_in_random_rows():
    inliers = registration(2000, 0.5, 0.0, 2).inliers
    assert 430 < inliers[:1000].sum() < 570


@pytest.mark.parametrize(("ratio", "expected"), [(0.0, 200), (1.0, 0), (0.995, 1), (0.99, 2)])
def test_registration_counts_outliers(ratio, expected):
    data = registration(200, ratio, 0.0, 0)
    assert data.inliers.sum() == expected
    np.testing.assert_allclose(data.target[data.inliers], move(data.T, data.source[data.inliers]), atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ((0, 0.5, 0.01, 0), "n"),
        ((10.5, 0.5, 0.01, 0), "n"),
        ((10, 1.1, 0.01, 0), "outlier_ratio"),
        ((10, np.nan, 0.01, 0), "outlier_ratio"),
        ((10, 0.5, -1.0, 0), "noise"),
        ((10, 0.5, 0.01, 0, 0.0), "scale"),
    ],
)
def test_registration_refuses(arguments, name):
    with pytest.raises(ValueError, match=rf"^{name} is .*expected"):
        registration(*arguments)


def project(points):
    return points[:, :2] / points[:, 2:]


def epipolar_errors(data):
    """x2' [t] R x1 of each match."""
    first, second = (np.column_stack([points, np.ones(len(points))]) for points in (data.points1, data.points2))
    return (second * np.cross(data.T[:3, 3], first @ data.T[:3, :3].T)).sum(axis=1)


def triangulate(data):
    """Depths in the first and the second camera, from d2 x2 = d1 R x1 + t."""
    first, second = (np.column_stack([points, np.ones(len(points))]) for points in (data.points1, data.points2))
    systems = np.stack([second, -first @ data.T[:3, :3].T], axis=2)
    depths = np.array([np.linalg.lstsq(system, data.T[:3, 3])[0] for system in systems])
    return depths[:, 1], depths[:, 0]


both = pytest.mark.parametrize("make", [relative_pose, absolute_pose])


@pytest.mark.parametrize("n", [1, 100_000])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_relative_pose_matches_obey_the_epipolar_constraint(n, seed):
    data = relative_pose(n, 0.0, 0.0, seed)
    assert data.points1.shape == data.points2.shape == (n, 2)
    assert data.inliers.all()
    assert_rigid(data.T)
    assert np.linalg.norm(data.T[:3, 3]) == pytest.approx(1.0)
    assert np.abs(epipolar_errors(data)).max() < 1e-12
    assert max(np.abs(data.points1).max(), np.abs(data.points2).max()) <= 1.0


def test_relative_pose_points_are_in_front_of_both_cameras():
    for seed in range(10):
        first, second = triangulate(relative_pose(200, 0.0, 0.0, seed))
        assert 0.1 - 1e-6 < first.min() < first.max() < 10 + 1e-6
        assert second.min() > 0.1 - 1e-6


@pytest.mark.parametrize("n", [1, 100_000])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_absolute_pose_projects_the_points(n, seed):
    data = absolute_pose(n, 0.0, 0.0, seed)
    assert data.points2d.shape == (n, 2)
    assert data.points3d.shape == (n, 3)
    assert data.inliers.all()
    assert_rigid(data.T)
    assert np.linalg.norm(data.T[:3, :3].T @ data.T[:3, 3]) == pytest.approx(1.0)
    camera = move(data.T, data.points3d)
    np.testing.assert_allclose(project(camera), data.points2d, atol=1e-12)
    assert camera[:, 2].min() > 0.1
    assert np.abs(data.points2d).max() <= 1.0
    # The frame of the world is the first camera, which sees the points, too.
    assert 0.1 <= data.points3d[:, 2].min() <= data.points3d[:, 2].max() <= 10
    assert np.abs(project(data.points3d)).max() <= 1.0 + 1e-12


def test_both_cameras_see_the_same_scene_for_one_seed():
    pair, single = relative_pose(300, 0.3, 0.0, 5), absolute_pose(300, 0.3, 0.0, 5)
    np.testing.assert_array_equal(pair.T, single.T)
    np.testing.assert_array_equal(pair.T, relative_pose(7, 0.0, 1.0, 5).T)
    np.testing.assert_allclose(project(single.points3d)[pair.inliers], pair.points1[pair.inliers])


def test_points_are_uniform_where_both_cameras_see_them():
    """Rejection leaves a uniform density: compare with all of the first camera's view, as far as it is shared."""
    data = absolute_pose(4000, 0.0, 0.0, 3)
    rng = np.random.default_rng(0)
    depths = rng.uniform(0.1, 10, (40_000, 1))
    view = np.hstack([rng.uniform(-1, 1, (40_000, 2)) * depths, depths])
    camera = move(data.T, view)
    shared = view[(camera[:, 2] > 0.1) & (np.abs(camera[:, :2]).max(axis=1) <= camera[:, 2])]
    assert len(shared) > 0.2 * len(view)
    ours, theirs = (np.column_stack([project(points), points[:, 2]]) for points in (data.points3d, shared))
    assert all(ks_2samp(ours[:, k], theirs[:, k]).pvalue > 1e-3 for k in range(3))


def test_poses_vary_as_much_as_they_may():
    poses = np.array([relative_pose(1, 0.0, 0.0, seed).T for seed in range(600)])
    angles = np.degrees(np.arccos(np.clip((np.trace(poses[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert angles.min() < 20
    assert 80 < np.median(angles) < 120
    assert angles.max() > 175
    axes = np.degrees(np.arccos(poses[:, 2, 2]))
    assert axes.min() < 10
    assert 75 < axes.max() < 110
    rolls = np.arctan2(poses[:, 1, 0] - poses[:, 0, 1], poses[:, 0, 0] + poses[:, 1, 1])
    assert kstest(rolls, "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-3
    centres = -np.einsum("kji,kj->ki", poses[:, :3, :3], poses[:, :3, 3])
    np.testing.assert_allclose(np.linalg.norm(centres, axis=1), 1.0)
    assert (centres.min(axis=0) < -0.9).all()
    assert (centres.max(axis=0) > 0.9).all()


def test_every_pose_shows_a_fifth_of_the_first_view():
    rng = np.random.default_rng(0)
    depths = rng.uniform(0.1, 10, (5000, 1))
    view = np.hstack([rng.uniform(-1, 1, (5000, 2)) * depths, depths])
    shares = []
    for seed in range(100):
        camera = move(relative_pose(1, 0.0, 0.0, seed).T, view)
        shares.append(((camera[:, 2] > 0.1) & (np.abs(camera[:, :2]).max(axis=1) <= camera[:, 2])).mean())
    assert 0.17 < min(shares) < 0.25
    assert max(shares) > 0.7


@pytest.mark.parametrize("noise", [0.001, 0.02])
def test_noise_is_on_the_image_points(noise):
    clean, noisy = (relative_pose(6000, 0.25, level, 3) for level in (0.0, noise))
    np.testing.assert_array_equal(clean.inliers, noisy.inliers)
    for name in ("points1", "points2"):
        residuals = (getattr(noisy, name) - getattr(clean, name))[noisy.inliers] / noise
        assert kstest(residuals.ravel(), "norm").pvalue > 1e-3
    clean, noisy = (absolute_pose(6000, 0.25, level, 3) for level in (0.0, noise))
    np.testing.assert_array_equal(clean.points3d, noisy.points3d)
    residuals = (noisy.points2d - project(move(noisy.T, noisy.points3d)))[noisy.inliers] / noise
    assert kstest(residuals.ravel(), "norm").pvalue > 1e-3


def test_outliers_are_uniform_in_the_images():
    pair, single = relative_pose(5000, 0.8, 0.01, 6), absolute_pose(5000, 0.8, 0.01, 6)
    for points in (pair.points1[~pair.inliers], pair.points2[~pair.inliers], single.points2d[~single.inliers]):
        assert points.shape == (4000, 2)
        assert all(kstest(points[:, k], "uniform", (-1, 2)).pvalue > 1e-3 for k in range(2))
    assert abs(np.corrcoef(pair.points1[~pair.inliers].T, pair.points2[~pair.inliers].T)[:2, 2:]).max() < 0.06


@both
@pytest.mark.parametrize(("ratio", "expected"), [(0.0, 200), (1.0, 0), (0.995, 1), (0.63, 74)])
def test_poses_count_outliers_in_random_rows(make, ratio, expected):
    assert make(200, ratio, 0.0, 0).inliers.sum() == expected
    assert 430 < make(2000, 0.5, 0.0, 2).inliers[:1000].sum() < 570


@both
@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ((0, 0.5, 0.01, 0), "n"),
        ((10.5, 0.5, 0.01, 0), "n"),
        ((True, 0.5, 0.01, 0), "n"),
        ((10, -0.1, 0.01, 0), "outlier_ratio"),
        ((10, np.nan, 0.01, 0), "outlier_ratio"),
        ((10, 0.5, -1.0, 0), "noise"),
        ((10, 0.5, np.inf, 0), "noise"),
    ],
)
def test_poses_refuse(make, arguments, name):
    with pytest.raises(ValueError, match=rf"^{name} is .*expected"):
        make(*arguments)


@pytest.mark.parametrize("overlap", [0.0, 0.25, 0.5, 1.0])
def test_cloud_pair_shares_exactly_the_overlap(overlap):
    pair = cloud_pair(a_cloud(), 3, points=300, overlap=overlap, noise=0.0)
    assert_rigid(pair.T)
    distances = cKDTree(pair.target).query(move(pair.T, pair.source))[0]
    assert np.count_nonzero(distances < 1e-9) == 300 * overlap
    assert pair.overlap == overlap
    assert len(np.unique(pair.source, axis=0)) == len(np.unique(pair.target, axis=0)) == 300


def test_cloud_pair_fits_the_cloud_into_the_unit_cube():
    cloud = a_cloud(500)
    pair = cloud_pair(cloud, 3, points=500, overlap=1.0)
    assert pair.source.min() == 0.0
    assert pair.source.max() == 1.0
    longest = np.ptp(cloud, axis=0).max()
    np.testing.assert_allclose(np.ptp(pair.source, axis=0), np.ptp(cloud, axis=0) / longest)


def test_cloud_pair_noise_is_on_the_target():
    clean, noisy = (cloud_pair(a_cloud(), 9, points=900, overlap=0.5, noise=noise) for noise in (0.0, 0.01))
    np.testing.assert_array_equal(clean.source, noisy.source)
    assert (noisy.target - clean.target).std() == pytest.approx(0.01, rel=0.05)


def test_cloud_pair_rows_leak_no_correspondence():
    pair = cloud_pair(a_cloud(), 4, points=1000, overlap=0.5, noise=0.0)
    distances, match = cKDTree(pair.target).query(move(pair.T, pair.source))
    shared = np.flatnonzero(distances < 1e-9)
    assert abs(np.corrcoef(shared, match[shared])[0, 1]) < 0.2
    assert 200 < np.count_nonzero(shared < 500) < 300
    assert 200 < np.count_nonzero(match[shared] < 500) < 300
    # Nor do the rows follow those of the cloud.
    cloud = a_cloud()
    unit = (cloud - cloud.min(axis=0)) / np.ptp(cloud, axis=0).max()
    rows = cKDTree(unit).query(pair.source)[1]
    assert abs(np.corrcoef(np.arange(1000), rows)[0, 1]) < 0.15


@pytest.mark.parametrize(
    ("cloud", "options", "message"),
    [
        (np.zeros((5, 2)), {}, r"^cloud has shape \(5, 2\).*expected"),
        (np.full((2000, 3), 4.0), {}, "^cloud has 2000 points and no extent.*expected"),
        (np.zeros((0, 3)), {}, "^cloud has 0 points.*expected"),
        (np.full((2000, 3), np.nan), {}, "^cloud holds NaN.*expected"),
        (a_cloud(100), {}, "^cloud has 100 points; expected at least 750"),
        (a_cloud(), {"points": 0}, "^points is 0.*expected"),
        (a_cloud(), {"overlap": 1.5}, "^overlap is 1.5.*expected"),
        (a_cloud(), {"noise": -0.1}, "^noise is -0.1.*expected"),
    ],
)
def test_cloud_pair_refuses(cloud, options, message):
    with pytest.raises(ValueError, match=message):
        cloud_pair(cloud, 0, **options)


@pytest.fixture(scope="module")
def scans():
    return demo_scans(0, points=3000, noise=0.002)


def test_demo_scans_lie_on_the_elephant(scans):
    assert_rigid(scans.T)
    for points in (move(scans.T, scans.source), scans.target):
        assert points.shape == (3000, 3)
        distances = elephant._distance(points)
        assert distances.std() == pytest.approx(0.002, rel=0.15)
        assert abs(distances.mean()) < 2e-4


def test_demo_scans_overlap_as_promised(scans):
    assert 0.6 < scans.overlap < 0.7
    # Where a scan is covered by the other one, a neighbour is near.
    distances = cKDTree(scans.target).query(move(scans.T, scans.source))[0]
    assert np.mean(distances < 0.03) == pytest.approx(scans.overlap, abs=0.06)


def test_demo_scans_are_partial_and_share_no_point(scans):
    surface, _ = elephant._surface(elephant._cells_at_surface(), 20_000, np.random.default_rng(1))
    for points in (move(scans.T, scans.source), scans.target):
        covered = np.mean(cKDTree(points).query(surface)[0] < 0.04)
        assert 0.3 < covered < 0.55
    clean = demo_scans(0, points=500, noise=0.0)
    assert cKDTree(clean.target).query(move(clean.T, clean.source))[0].min() > 1e-6


def test_what_a_scan_sees_is_in_front():
    sensor = elephant._SENSORS[0]
    points, normals = elephant._scan(sensor, 500, np.random.default_rng(0))
    assert (normals @ sensor).min() > 0
    steps = np.linspace(0.03, 1.8, 60)
    on_the_way = points[:, None] + steps[:, None] * sensor
    assert (elephant._distance(on_the_way.reshape(-1, 3)) > -0.005).all()


def test_the_elephant_is_its_own_image_under_no_motion(scans):
    points = scans.target - scans.target.mean(axis=0)
    tree = cKDTree(points)
    turns = [np.diag(signs) for signs in ([1.0, -1, -1], [-1.0, 1, -1], [-1.0, -1, 1])]
    axes = np.linalg.eigh(points.T @ points)[1]
    for turn in turns:
        assert np.sqrt(np.mean(tree.query(points @ axes @ turn @ axes.T)[0] ** 2)) > 0.05


def test_surface_points_are_uniform(monkeypatch):
    """On a ball, the uniform distribution is known: each coordinate is uniform (Archimedes)."""
    monkeypatch.setattr(elephant, "_distance", lambda points: np.linalg.norm(points, axis=1) - 0.4)
    monkeypatch.setattr(elephant, "_BOX", np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]]))
    points, normals = elephant._surface(elephant._cells_at_surface.__wrapped__(), 20_000, np.random.default_rng(2))
    assert len(points) > 2000
    assert len(points) < 15_000
    np.testing.assert_allclose(points, 0.4 * normals, atol=1e-5)
    assert all(kstest(points[:, axis], "uniform", (-0.4, 0.8)).pvalue > 1e-3 for axis in range(3))


@pytest.mark.parametrize(
    ("options", "message"),
    [({"points": 0}, "^points is 0.*expected"), ({"noise": np.nan}, "^noise is nan.*expected")],
)
def test_demo_scans_refuses(options, message):
    with pytest.raises(ValueError, match=message):
        demo_scans(0, **options)


# --- a second camera that sees all ------------------------------------------------------------------------------------


def test_the_camera_of_the_paper_sees_all_that_the_first_one_sees():
    rng, turns = np.random.default_rng(0), []
    for seed in range(40):
        T = relative_pose(1, 0.0, 0.0, seed, sees_all=True).T
        depths = np.concatenate([rng.uniform(0.1, 10.0, 2000), [0.1, 10.0]])[:, None]
        image = np.concatenate([rng.uniform(-1.0, 1.0, (2000, 2)), [[1.0, -1.0], [-1.0, -1.0]]])
        seen = move(T, np.column_stack([image * depths, depths]))
        assert (seen[:, 2] > 0.1).all()
        assert (np.abs(seen[:, :2]) <= seen[:, 2:] + 1e-12).all()
        assert np.linalg.norm(T[:3, 3]) == pytest.approx(1.0)
        turns.append(np.degrees(np.arccos(np.clip((np.trace(T[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))))
    quarters = np.rint(np.array(turns) / 90.0)
    assert set(quarters) == {0.0, 1.0, 2.0}
    assert np.abs(turns - 90.0 * quarters).max() < 6.0


def test_both_problems_and_all_sizes_have_the_same_such_camera():
    pair, single = (make(300, 0.3, 0.01, 5, sees_all=True) for make in (relative_pose, absolute_pose))
    np.testing.assert_array_equal(pair.T, single.T)
    np.testing.assert_array_equal(pair.T, relative_pose(7, 0.0, 1.0, 5, sees_all=True).T)
    assert not np.array_equal(pair.T, relative_pose(300, 0.3, 0.01, 5).T)
    assert pair.inliers.sum() == single.inliers.sum() == 210
