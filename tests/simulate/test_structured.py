import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import kstest

from nonsac import simulate
from nonsac.simulate import ImageMatches, Pairs, PointMatches

NOISE = 1e-3
MAKERS = {
    "blobs_in_images": (simulate.blobs_in_images, (8, NOISE), ImageMatches),
    "blobs_in_space": (simulate.blobs_in_space, (8, NOISE), Pairs),
    "statue": (simulate.statue, (0.4, NOISE), Pairs),
    "periodic_texture": (simulate.periodic_texture, (0.5, NOISE), ImageMatches),
    "narrow_view": (simulate.narrow_view, (0.3, NOISE), ImageMatches),
    "local_displacements": (simulate.local_displacements, (0.4, 0.02, NOISE), ImageMatches),
    "moving_object": (simulate.moving_object, (0.3, 0.2, NOISE), ImageMatches),
    "two_planes": (simulate.two_planes, (0.3, NOISE), PointMatches),
}
EACH = pytest.mark.parametrize("name", MAKERS)
NO_TRUTH = {"blobs_in_images", "blobs_in_space"}


def made(name, rng, n=600, noise=NOISE):
    make, arguments, _ = MAKERS[name]
    return make(n, *arguments[:-1], noise, rng)


def noise_of(name):
    """In the unit of the data; that of a narrow view is a share of half its width."""
    return NOISE * np.tan(np.radians(5.5)) if name == "narrow_view" else NOISE


def move(T, points):
    return points @ T[:3, :3].T + T[:3, 3]


def project(points):
    return points[:, :2] / points[:, 2:]


def rays(points):
    return np.column_stack([points, np.ones(len(points))])


def distances(data, T=None):
    """How far each match is from the truth: of a point, or of a point from its epipolar line."""
    T = data.T if T is None else T
    if isinstance(data, Pairs):
        return np.linalg.norm(data.target - move(T, data.source), axis=1)
    if isinstance(data, PointMatches):
        return np.linalg.norm(data.points2d - project(move(T, data.points3d)), axis=1)
    turned = rays(data.points1) @ T[:3, :3].T
    if not np.isfinite(T).all():
        return np.linalg.norm(data.points2 - project(turned), axis=1)
    lines = np.cross(T[:3, 3], turned)
    return np.abs((rays(data.points2) * lines).sum(axis=1)) / np.linalg.norm(lines[:, :2], axis=1)


@EACH
@pytest.mark.parametrize("n", [1, 7, 600])
def test_every_row_is_a_match_of_finite_numbers(name, n):
    data = made(name, 1, n)
    assert type(data) is MAKERS[name][2]
    assert data.T.shape == (4, 4)
    assert (data.inliers.shape, data.inliers.dtype) == ((n,), np.bool_)
    widths = {ImageMatches: (2, 2), Pairs: (3, 3), PointMatches: (2, 3)}[type(data)]
    halves = [getattr(data, field.name) for field in dataclasses.fields(data)[:2]]
    assert [half.shape for half in halves] == [(n, width) for width in widths]
    assert all(np.isfinite(half).all() for half in halves)


@EACH
def test_a_seed_gives_the_same_data_and_another_seed_others(name):
    data, rng = made(name, 7), np.random.default_rng(7)
    fields = [field.name for field in dataclasses.fields(data)]
    for again in (made(name, 7), made(name, rng)):
        for field in fields:
            np.testing.assert_array_equal(getattr(again, field), getattr(data, field))
    for other in (made(name, 8), made(name, rng)):  # the generator has moved on
        for field in fields[:2]:
            assert not np.array_equal(getattr(data, field), getattr(other, field))


@EACH
def test_the_noise_is_all_that_it_changes(name):
    clean, noisy = made(name, 3, noise=0.0), made(name, 3)
    np.testing.assert_array_equal(clean.T, noisy.T)
    np.testing.assert_array_equal(clean.inliers, noisy.inliers)
    second = dataclasses.fields(clean)[1 if name != "two_planes" else 0].name
    difference = getattr(noisy, second) - getattr(clean, second)
    assert difference.std() == pytest.approx(noise_of(name), rel=0.1)


@EACH
@pytest.mark.parametrize("rng", [None, True, -1, 0.5, "0"])
def test_a_bad_rng_is_refused(name, rng):
    with pytest.raises(TypeError, match=r"^rng is .*expected"):
        made(name, rng)


@EACH
def test_what_comes_back_is_frozen(name):
    with pytest.raises(dataclasses.FrozenInstanceError):
        made(name, 0).T = np.eye(4)


BAD = {
    "n": [0, 10.5, True],
    "blobs": [0, 1.5],
    "spread": [-1.0, np.inf, np.nan],
    "outlier_ratio": [-0.1, 1.1, np.nan],
    "noise": [-1.0, np.inf, np.nan],
    "slipped": [-0.1, 1.1],
    "displaced": [-0.1, 1.1],
    "reach": [-1.0, np.inf],
    "moving": [-0.1, 1.1],
}
PARAMETERS = {
    "blobs_in_images": ("n", "blobs", "spread"),
    "blobs_in_space": ("n", "blobs", "spread"),
    "statue": ("n", "outlier_ratio", "noise"),
    "periodic_texture": ("n", "slipped", "noise"),
    "narrow_view": ("n", "outlier_ratio", "noise"),
    "local_displacements": ("n", "displaced", "reach", "noise"),
    "moving_object": ("n", "moving", "outlier_ratio", "noise"),
    "two_planes": ("n", "outlier_ratio", "noise"),
}


@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [(name, one, value) for name, several in PARAMETERS.items() for one in several for value in BAD[one]],
)
def test_bad_arguments_are_refused(name, parameter, value):
    make, arguments, _ = MAKERS[name]
    good = dict(zip(PARAMETERS[name], (10, *arguments), strict=True))
    with pytest.raises(ValueError, match=rf"^{parameter} is .*expected"):
        make(**good | {parameter: value}, rng=0)


@pytest.mark.parametrize("base", [-0.1, 1.1, np.nan])
def test_a_bad_share_of_the_base_is_refused(base):
    with pytest.raises(ValueError, match=r"^base is .*expected"):
        simulate.statue(10, 0.5, 0.01, 0, base=base)


# --- what is true -----------------------------------------------------------------------------------------------------


@EACH
def test_the_truth_is_a_motion_where_there_is_one(name):
    for seed in range(10):
        T = made(name, seed, 20).T
        if name in NO_TRUTH:
            assert np.isnan(T).all()
            continue
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_array_equal(T[3], [0, 0, 0, 1])
        assert np.isnan(T[:3, 3]).all() if name == "local_displacements" else np.isfinite(T).all()
        if MAKERS[name][2] is ImageMatches and name != "local_displacements":
            assert np.linalg.norm(T[:3, 3]) == pytest.approx(1.0)


@pytest.mark.parametrize("name", sorted(set(MAKERS) - NO_TRUTH))
def test_inliers_obey_the_truth_and_outliers_do_not(name):
    for seed in range(5):
        data = made(name, seed, noise=0.0)
        assert 0.2 < data.inliers.mean() < 0.9
        errors = distances(data)
        assert errors[data.inliers].max() < 1e-9
        if name != "periodic_texture":  # which slips nearly along the epipolar lines
            assert np.median(errors[~data.inliers]) > 5 * noise_of(name)
        assert (errors[~data.inliers] < 1e-9).mean() < 0.05  # some may be exchanged with themselves


@pytest.mark.parametrize("name", sorted(NO_TRUTH))
def test_blobs_have_no_inliers(name):
    assert not made(name, 0).inliers.any()


@pytest.mark.parametrize("name", sorted(set(MAKERS) - NO_TRUTH))
def test_inliers_are_within_the_noise(name):
    data = made(name, 5, 4000)
    ratios = distances(data)[data.inliers] / noise_of(name)
    assert np.quantile(ratios, 0.99) < 6.0
    assert np.median(ratios) > 0.3


@pytest.mark.parametrize(
    ("make", "of_all"),
    [
        (lambda ratio: simulate.narrow_view(400, ratio, NOISE, 3), 1.0),
        (lambda ratio: simulate.two_planes(400, ratio, NOISE, 3), 1.0),
        (lambda ratio: simulate.statue(400, ratio, NOISE, 3, base=0.25), 0.75),
        (lambda ratio: simulate.moving_object(400, 0.0, ratio, NOISE, 3), 1.0),
    ],
    ids=["narrow_view", "two_planes", "statue", "moving_object"],
)
@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0])
def test_so_many_matches_are_wrong(make, of_all, ratio):
    assert make(ratio).inliers.sum() == 400 * of_all * (1.0 - ratio)


# --- what each is like ------------------------------------------------------------------------------------------------


def groups(points, apart):
    """Numbers of the blobs that points lie in, which are so far apart."""
    found = np.full(len(points), -1)
    for number in range(len(points)):
        if (found >= 0).all():
            return found
        first = points[np.flatnonzero(found < 0)[0]]
        found[(found < 0) & (np.linalg.norm(points - first, axis=1) < apart)] = number
    return found


@pytest.mark.parametrize("name", sorted(NO_TRUTH))
def test_each_blob_is_matched_with_one_other(name):
    data = made(name, 2, noise=1e-6)
    first, second = (getattr(data, field.name) for field in dataclasses.fields(data)[:2])
    of_first, of_second = groups(first, 1e-4), groups(second, 1e-4)
    assert of_first.max() == of_second.max() == 7
    assert len({*zip(of_first, of_second, strict=True)}) == 8
    middles = np.array([first[of_first == blob].mean(axis=0) for blob in range(8)])
    assert (first - middles[of_first]).std() == pytest.approx(1e-6, rel=0.1)


def test_the_base_of_a_statue_slips_along_its_rings():
    """Both its radius and its height stay; the truth turns it by 70 to 100 degrees, its matches by 30 at most."""
    for seed in range(5):
        data = simulate.statue(600, 0.0, 0.0, seed, base=0.5)
        assert data.inliers.sum() == 300
        back = move(np.linalg.inv(data.T), data.target)[~data.inliers]
        base = data.source[~data.inliers]
        np.testing.assert_allclose(np.hypot(*back.T[:2]), np.hypot(*base.T[:2]), atol=1e-9)
        np.testing.assert_allclose(back[:, 2], base[:, 2], atol=1e-9)
        slips = np.angle((back[:, 0] + 1j * back[:, 1]) / (base[:, 0] + 1j * base[:, 1]), deg=True)
        assert 40.0 <= abs(np.median(slips)) <= 130.0
        assert np.quantile(np.abs(slips - np.median(slips)), 0.5) < 15.0


def test_wrong_matches_of_a_figure_are_other_points_of_it():
    data = simulate.statue(300, 0.5, 0.0, 2, base=0.0)
    nearest, which = cKDTree(move(data.T, data.source)).query(data.target)
    assert nearest.max() < 1e-9
    assert ((which == np.arange(300)) == data.inliers).mean() > 0.98


def test_a_statue_without_base_is_all_figure():
    assert simulate.statue(300, 0.0, 0.0, 0, base=0.0).inliers.all()
    assert not simulate.statue(300, 0.0, 0.0, 0, base=1.0).inliers.any()


@pytest.mark.parametrize("scattered", [False, True])
def test_a_wall_slips_by_whole_periods(scattered):
    """Seen on the wall itself, a slipped match is .5, or up to three times as far, from where it belongs."""
    data = simulate.periodic_texture(900, 0.5, 0.0, 4, scattered)
    wall = 6.0 * rays(data.points1)[~data.inliers]
    # The camera moved by about 1, which is what the length of t was before it was made 1.
    centre = -data.T[:3, :3].T @ data.T[:3, 3]
    centre = centre / centre[0]
    sight = rays(data.points2)[~data.inliers] @ data.T[:3, :3]
    seen = centre + sight * ((6.0 - centre[2]) / sight[:, 2:])
    slips = (seen - wall)[:, 0] / 0.5
    np.testing.assert_allclose(slips, np.rint(slips), atol=1e-9)
    np.testing.assert_allclose((seen - wall)[:, 1:], 0.0, atol=1e-9)
    expected = {-3, -2, -1, 1, 2, 3} if scattered else {1}
    assert set(np.rint(slips).astype(int)) == expected
    assert 0.2 < (~data.inliers).mean() < 0.5


@pytest.mark.parametrize("degrees", [5.0, 11.0, 40.0])
def test_an_object_fills_a_narrow_view(degrees):
    data = simulate.narrow_view(2000, 0.0, 0.0, 1, degrees)
    half = np.tan(np.radians(0.5 * degrees))
    assert np.abs(data.points1).max() == pytest.approx(half)
    assert 0.7 * half < np.abs(data.points2).max() < 1.3 * half  # it turns about its middle
    width, height = np.ptp(data.points1, axis=0)
    assert height > 1.5 * half  # it is upright, and in the middle
    assert 0.5 * height < width < height
    turn = np.degrees(np.arccos((np.trace(data.T[:3, :3]) - 1.0) / 2.0))
    assert 5.0 <= turn <= 25.0


def test_the_noise_of_a_narrow_view_is_a_share_of_its_width():
    clean, noisy = (simulate.narrow_view(4000, 0.0, noise, 1, 20.0) for noise in (0.0, 0.01))
    expected = 0.01 * np.tan(np.radians(10.0))
    assert (noisy.points1 - clean.points1).std() == pytest.approx(expected, rel=0.05)


def test_displacements_are_uniform_in_a_square():
    data = simulate.local_displacements(6000, 0.5, 0.03, 0.0, 1)
    assert 0.45 < data.inliers.mean() < 0.55
    turned = project(rays(data.points1) @ data.T[:3, :3].T)
    offsets = (data.points2 - turned)[~data.inliers]
    assert all(kstest(offsets[:, axis], "uniform", (-0.03, 0.06)).pvalue > 1e-3 for axis in range(2))


def test_a_moving_object_is_small_and_obeys_another_pose():
    data = simulate.moving_object(600, 0.3, 0.0, 0.0, 2)
    assert data.inliers.sum() == 420
    extents = [np.ptp(data.points1[part], axis=0).max() for part in (~data.inliers, data.inliers)]
    assert extents[0] < 0.6 * extents[1]
    assert np.median(distances(data)[~data.inliers]) > 0.01


def test_two_planes_meet_at_a_right_angle():
    points = simulate.two_planes(600, 0.3, NOISE, 2).points3d
    on_first, on_second = points[:, 0] == 0.0, points[:, 2] == 0.0
    assert (on_first ^ on_second).all()
    assert 200 < on_first.sum() < 400


def test_a_camera_stands_before_two_planes():
    for seed in range(10):
        data = simulate.two_planes(100, 0.0, 0.0, seed)
        assert move(data.T, data.points3d)[:, 2].min() > 0.5
