import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import kstest

from nonsac import simulate
from nonsac.simulate import cloud_pair, demo_scans, random_rotation, registration


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
    ],
    ids=["registration", "cloud_pair", "demo_scans"],
)


@makers
def test_a_seed_gives_the_same_data_and_another_seed_others(make):
    data, rng = make(7), np.random.default_rng(7)
    assert_same(data, make(rng))
    assert not np.array_equal(data.source, make(8).source)
    assert not np.array_equal(data.source, make(rng).source)  # the generator has moved on


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
        distances = simulate._distance(points)
        assert distances.std() == pytest.approx(0.002, rel=0.15)
        assert abs(distances.mean()) < 2e-4


def test_demo_scans_overlap_as_promised(scans):
    assert 0.6 < scans.overlap < 0.7
    # Where a scan is covered by the other one, a neighbour is near.
    distances = cKDTree(scans.target).query(move(scans.T, scans.source))[0]
    assert np.mean(distances < 0.03) == pytest.approx(scans.overlap, abs=0.06)


def test_demo_scans_are_partial_and_share_no_point(scans):
    surface, _ = simulate._surface(simulate._cells_at_surface(), 20_000, np.random.default_rng(1))
    for points in (move(scans.T, scans.source), scans.target):
        covered = np.mean(cKDTree(points).query(surface)[0] < 0.04)
        assert 0.3 < covered < 0.55
    clean = demo_scans(0, points=500, noise=0.0)
    assert cKDTree(clean.target).query(move(clean.T, clean.source))[0].min() > 1e-6


def test_what_a_scan_sees_is_in_front():
    sensor = simulate._SENSORS[0]
    points, normals = simulate._scan(sensor, 500, np.random.default_rng(0))
    assert (normals @ sensor).min() > 0
    steps = np.linspace(0.03, 1.8, 60)
    on_the_way = points[:, None] + steps[:, None] * sensor
    assert (simulate._distance(on_the_way.reshape(-1, 3)) > -0.005).all()


def test_the_elephant_is_its_own_image_under_no_motion(scans):
    points = scans.target - scans.target.mean(axis=0)
    tree = cKDTree(points)
    turns = [np.diag(signs) for signs in ([1.0, -1, -1], [-1.0, 1, -1], [-1.0, -1, 1])]
    axes = np.linalg.eigh(points.T @ points)[1]
    for turn in turns:
        assert np.sqrt(np.mean(tree.query(points @ axes @ turn @ axes.T)[0] ** 2)) > 0.05


def test_surface_points_are_uniform(monkeypatch):
    """On a ball, the uniform distribution is known: each coordinate is uniform (Archimedes)."""
    monkeypatch.setattr(simulate, "_distance", lambda points: np.linalg.norm(points, axis=1) - 0.4)
    monkeypatch.setattr(simulate, "_BOX", np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]]))
    points, normals = simulate._surface(simulate._cells_at_surface.__wrapped__(), 20_000, np.random.default_rng(2))
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
