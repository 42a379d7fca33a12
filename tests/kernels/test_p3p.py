from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.kernels.p3p import p3p_poses


def solve(samples):
    models = np.full((4 * len(samples), 3, 4), np.nan)
    return models[: p3p_poses(np.ascontiguousarray(samples), models)]


def solve_each(samples):
    """Which sample each pose belongs to, and the poses of all."""
    models = np.full((len(samples), 4, 3, 4), np.nan)
    counts = [p3p_poses(samples[i : i + 1], models[i]) for i in range(len(samples))]
    filled = np.arange(4) < np.array(counts)[:, None]
    return np.nonzero(filled)[0], models[filled]


def random_problems(rng, n, field=1.0, near=0.1, far=10.0):
    """Samples (n, 3, 5) without noise, and the pose of each."""
    R, t = Rotation.random(n, random_state=rng).as_matrix(), rng.standard_normal((n, 3))
    image = rng.uniform(-field, field, (n, 3, 2))
    seen = np.concatenate([image, np.ones((n, 3, 1))], axis=2) * rng.uniform(near, far, (n, 3, 1))
    points = np.einsum("nji,nkj->nki", R, seen - t[:, None])
    return np.concatenate([image, points], axis=2), np.concatenate([R, t[..., None]], axis=2)


def random_outliers(rng, n):
    """Samples (n, 3, 5) whose image points have nothing to do with the points in the world."""
    samples = random_problems(rng, n)[0]
    samples[..., :2] = rng.uniform(-1, 1, (n, 3, 2))
    return samples


def angles(A, B):
    """Radians between rotations (n, 3, 3)."""
    return 2 * np.arcsin(np.minimum(1, np.linalg.norm(A - B, axis=(-2, -1)) / np.sqrt(8)))


def depths_and_errors(samples, poses):
    """Of each of the three points under its pose: the depth, and the distance in the image; (M, 3) each."""
    seen = np.einsum("mij,mkj->mki", poses[..., :3], samples[..., 2:]) + poses[:, None, :, 3]
    return seen[..., 2], np.linalg.norm(seen[..., :2] / seen[..., 2:] - samples[..., :2], axis=2)


def assert_valid(samples, poses, atol=1e-9):
    assert np.isfinite(poses).all()
    depths, errors = depths_and_errors(samples, poses)
    assert (depths > 0).all()
    # A point next to the camera's centre is seen anywhere.
    np.testing.assert_allclose(errors * np.minimum(1, 1000 * depths), 0, atol=atol)
    R = poses[..., :3]
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=1e-12)


def assert_same_set(first, second, atol):
    assert len(first) == len(second)
    differences = np.abs(first[:, None] - second[None]).max(axis=(2, 3))
    assert (differences.min(axis=0, initial=np.inf) < atol).all()
    assert (differences.min(axis=1, initial=np.inf) < atol).all()


def share_found(samples, truth):
    """Share of the samples whose true rotation is among the solutions, to 1e-5 rad."""
    owner, poses = solve_each(samples)
    found = np.zeros(len(samples), bool)
    np.logical_or.at(found, owner, angles(poses[..., :3], truth[owner, :, :3]) < 1e-5)
    return found.mean()


# --- all poses, and only poses ----------------------------------------------------------------------------------------


def test_the_true_pose_is_among_the_solutions(rng):
    samples, truth = random_problems(rng, 100_000)
    assert share_found(samples, truth) >= 0.9999  # all, with every seed tried


def test_the_translation_is_right_too(rng):
    samples, truth = random_problems(rng, 1000)
    owner, poses = solve_each(samples)
    best = np.full(1000, np.inf)
    np.minimum.at(best, owner, np.abs(poses - truth[owner]).max(axis=(1, 2)))
    assert np.quantile(best, 0.999) < 1e-6


def test_every_solution_sees_the_points_where_they_are(rng):
    for samples in (random_problems(rng, 50_000)[0], random_outliers(rng, 50_000)):
        owner, poses = solve_each(samples)
        assert len(poses) > 25_000
        assert_valid(samples[owner], poses)


def test_a_narrow_view_is_solved_too(rng):
    samples, truth = random_problems(rng, 10_000, field=0.05, near=5.0)
    assert share_found(samples, truth) >= 0.999


@pytest.mark.parametrize("make", [lambda rng: random_problems(rng, 500)[0], lambda rng: random_outliers(rng, 500)])
def test_equals_the_quartic_of_grunert(rng, make):
    several = 0
    for sample in make(rng):
        poses = solve(sample[None])
        assert_same_set(poses, naive.p3p(sample), 1e-5)
        several += len(poses) > 1
    assert several > 50


@pytest.mark.parametrize("make", [lambda rng: random_problems(rng, 500)[0], lambda rng: random_outliers(rng, 500)])
def test_equals_poselib(rng, make):
    poselib = pytest.importorskip("poselib")
    for sample in make(rng):
        rays = np.column_stack([sample[:, :2], np.ones(3)])
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        theirs = np.array([pose.Rt for pose in poselib.p3p(rays, sample[:, 2:])]).reshape(-1, 3, 4)
        theirs = theirs[np.isfinite(theirs).all(axis=(1, 2))]  # it returns poses of NaN as well
        assert_same_set(solve(sample[None]), theirs, 1e-6)


def test_solutions_are_different(rng):
    owner, poses = solve_each(random_problems(rng, 5000)[0])
    for i in range(5000):
        mine = poses[owner == i]
        gaps = np.abs(mine[:, None] - mine[None]).max(axis=(2, 3)) + np.eye(len(mine))
        assert gaps.min() > 1e-9


# --- symmetries -------------------------------------------------------------------------------------------------------


def test_the_order_of_the_rows_does_not_matter(rng):
    for sample in random_problems(rng, 100)[0]:
        for order in permutations(range(3)):
            assert_same_set(solve(sample[None, list(order)]), solve(sample[None]), 1e-6)


def test_moving_the_world_moves_the_poses(rng):
    for sample in random_problems(rng, 100)[0]:
        motion = naive.random_model(rng)
        elsewhere = np.hstack([sample[:, :2], naive.moved(motion, sample[:, 2:])])
        poses = solve(elsewhere[None])
        back = np.concatenate([poses[..., :3] @ motion[:, :3], poses @ np.append(motion[:, 3], 1)[:, None]], axis=2)
        assert_same_set(back, solve(sample[None]), 1e-6)


@pytest.mark.parametrize("unit", [1e-6, 1000.0, 1e9])
def test_the_unit_of_the_world_does_not_matter(rng, unit):
    for sample in random_problems(rng, 100)[0]:
        poses = solve((sample * [1, 1, unit, unit, unit])[None])
        assert_same_set(poses / [1, 1, 1, unit], solve(sample[None]), 1e-6)


def test_survey_coordinates_cost_digits_only(rng):
    samples, truth = random_problems(rng, 5000)
    offset = np.array([4.5e6, -5.2e5, 5e6])  # one unit in the last place is 1e-9
    shifted = samples + np.r_[0, 0, offset]
    owner, poses = solve_each(shifted)
    poses[..., 3] += poses[..., :3] @ offset
    depths, errors = depths_and_errors(samples[owner], poses)
    assert (depths > -1e-7).all()
    assert np.quantile(errors, 0.99) < 1e-7
    assert share_found(shifted, truth) > 0.99


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_views_with_a_mirror_symmetry(rng, order):
    """Two corners of an isosceles triangle at the same distance: a marker or a calibration target seen frontally."""
    for _ in range(20):
        half, height = rng.uniform(0.3, 2, 2)
        triangle = np.array([[0, height, 0], [-half, 0, 0], [half, 0, 0]])
        R = Rotation.from_rotvec([rng.uniform(-1, 1), 0, 0]).as_matrix()
        truth = np.column_stack([R, [0, 0, rng.uniform(3, 6)]])
        sample = np.hstack([naive.projected(naive.moved(truth, triangle)), triangle])[list(order)]
        poses = solve(sample[None])
        assert_valid(np.broadcast_to(sample, (len(poses), 3, 5)), poses)
        assert np.abs(poses - truth).max(axis=(1, 2)).min(initial=np.inf) < 1e-7


@pytest.mark.parametrize(("height", "solutions"), [(0.5, 1), (1.0, 1), (1.3, 1), (1.5, 4), (2.0, 4), (10.0, 4)])
def test_an_equilateral_triangle_seen_from_above_its_centre(rng, height, solutions):
    """With an angle of cosine c between the rays, d_i = (2 c - 1) d_j is a solution besides d_1 = d_2 = d_3."""
    corners = np.radians([90, 210, 330])
    triangle = np.column_stack([np.cos(corners), np.sin(corners), np.zeros(3)])
    truth = naive.random_model(rng)
    truth[:, 3] = 0
    sample = np.hstack([triangle[:, :2] / height, (triangle + np.array([0, 0, height])) @ truth[:, :3]])
    poses = solve(sample[None])
    assert len(poses) == solutions
    assert_valid(np.broadcast_to(sample, (len(poses), 3, 5)), poses)
    assert np.abs(poses - truth).max(axis=(1, 2)).min(initial=np.inf) < 1e-9


# --- samples that determine nothing -----------------------------------------------------------------------------------


def two_rows_the_same(rng, samples):
    samples[:, 1] = samples[:, 0]


def two_points_the_same(rng, samples):
    samples[:, 1, 2:] = samples[:, 0, 2:]


def all_points_the_same(rng, samples):
    samples[..., 2:] = samples[:, :1, 2:]


def all_rays_the_same(rng, samples):
    samples[..., :2] = samples[:, :1, :2]


def collinear_points(rng, samples):
    share = rng.uniform(-1, 2, (len(samples), 1))
    samples[:, 2, 2:] = share * samples[:, 0, 2:] + (1 - share) * samples[:, 1, 2:]


def collinear_points_seen_on_a_line(rng, samples):
    collinear_points(rng, samples)
    seen = samples[..., 2:] + [0, 0, 30]
    samples[..., :2] = seen[..., :2] / seen[..., 2:]


def nothing_but_zeros(rng, samples):
    samples[:] = 0


@pytest.mark.parametrize(
    "spoil",
    [
        two_rows_the_same,
        two_points_the_same,
        all_points_the_same,
        all_rays_the_same,
        collinear_points,
        collinear_points_seen_on_a_line,
        nothing_but_zeros,
    ],
)
def test_degenerate_samples_have_no_solution(rng, spoil):
    samples = random_problems(rng, 1000)[0]
    spoil(rng, samples)
    assert len(solve(samples)) == 0


def test_two_rays_the_same_give_valid_poses_only(rng):
    samples = random_problems(rng, 1000)[0]
    samples[:, 1, :2] = samples[:, 0, :2]
    owner, poses = solve_each(samples)
    assert_valid(samples[owner], poses)


def test_points_in_a_plane_with_the_camera_give_valid_poses_and_the_true_one(rng):
    samples, truth = random_problems(rng, 1000)
    rays = np.concatenate([samples[..., :2], np.ones((1000, 3, 1))], axis=2)
    share = rng.uniform(0, 1, (1000, 1))
    rays[:, 2] = share * rays[:, 0] + (1 - share) * rays[:, 1]
    seen = rays * rng.uniform(1, 10, (1000, 3, 1))
    samples[..., :2] = rays[..., :2]
    samples[..., 2:] = np.einsum("nji,nkj->nki", truth[..., :3], seen - truth[:, None, :, 3])
    owner, poses = solve_each(samples)
    assert_valid(samples[owner], poses)
    assert share_found(samples, truth) > 0.99


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", range(5))
def test_samples_that_are_not_finite_have_no_solution(rng, bad, column):
    samples = random_problems(rng, 30)[0]
    samples[np.arange(30), np.arange(30) % 3, column] = bad
    assert len(solve(samples)) == 0


@pytest.mark.parametrize("unit", [1e-200, 1e200])
def test_lengths_whose_square_is_no_number_have_no_solution(rng, unit):
    assert len(solve(random_problems(rng, 30)[0] * [1, 1, unit, unit, unit])) == 0


# --- batches ----------------------------------------------------------------------------------------------------------


def test_no_samples_give_no_poses():
    assert p3p_poses(np.empty((0, 3, 5)), np.empty((0, 3, 4))) == 0


def test_a_batch_gives_the_poses_of_each_sample_in_order(rng):
    samples = np.concatenate([random_problems(rng, 200)[0], random_outliers(rng, 200)])
    samples[7], samples[100, 1, 3] = 0, np.nan
    before = samples.copy()
    np.testing.assert_array_equal(solve(samples), solve_each(samples)[1])
    np.testing.assert_array_equal(samples, before)


def test_at_most_four_poses_are_written_for_a_sample(rng):
    samples = random_problems(rng, 2000)[0]
    models = np.full((4 * len(samples) + 1, 3, 4), 7.0)
    count = p3p_poses(samples, models)
    assert (models[count + 1 :] == 7.0).all()  # the first one that does not count may be half done
    assert max(np.bincount(solve_each(samples)[0])) == 4
