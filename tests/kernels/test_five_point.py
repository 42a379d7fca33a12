from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
from nonsac.kernels.five_point import five_point_poses, polish
from nonsac.kernels.polynomial import LANES


def solve(samples):
    models = np.full((10 * len(samples), 3, 4), np.nan)
    return models[: five_point_poses(np.ascontiguousarray(samples), models)]


def solve_each(samples):
    """Which sample each pose belongs to, and the poses of all."""
    models = np.full((len(samples), 10, 3, 4), np.nan)
    counts = [five_point_poses(samples[i : i + 1], models[i]) for i in range(len(samples))]
    filled = np.arange(10) < np.array(counts)[:, None]
    return np.nonzero(filled)[0], models[filled]


def homogeneous(image):
    return np.concatenate([image, np.ones((*image.shape[:-1], 1))], axis=-1)


def random_problems(rng, n, field=1.0, near=0.1, far=10.0, degrees=90.0):
    """Samples (n, 5, 4) without noise, and the pose of each; the baseline is 1, and both cameras see +-field."""
    samples, truth = np.empty((0, 5, 4)), np.empty((0, 3, 4))
    while len(samples) < n:
        axes, t = rng.standard_normal((2, n, 3))
        turns = np.radians(rng.uniform(0, degrees, (n, 1))) * axes / np.linalg.norm(axes, axis=1, keepdims=True)
        R, t = Rotation.from_rotvec(turns).as_matrix(), t / np.linalg.norm(t, axis=1, keepdims=True)
        image = rng.uniform(-field, field, (n, 30, 2))
        X = np.einsum("nij,nkj->nki", R, homogeneous(image) * rng.uniform(near, far, (n, 30, 1))) + t[:, None]
        seen = (X[..., 2] > near) & (np.abs(X[..., :2]) < field * X[..., 2:]).all(axis=2)
        enough = np.flatnonzero(seen.sum(axis=1) >= 5)
        five = np.argsort(~seen[enough], axis=1, kind="stable")[:, :5]
        rows = np.concatenate([image, X[..., :2] / X[..., 2:]], axis=2)[enough[:, None], five]
        samples = np.concatenate([samples, rows])
        truth = np.concatenate([truth, np.concatenate([R, t[..., None]], axis=2)[enough]])
    return samples[:n], truth[:n]


def random_outliers(rng, n):
    """Samples (n, 5, 4) of matches that have nothing to do with each other."""
    return rng.uniform(-1, 1, (n, 5, 4))


def angles(A, B):
    """Radians between rotations (n, 3, 3)."""
    return 2 * np.arcsin(np.minimum(1, np.linalg.norm(A - B, axis=(-2, -1)) / np.sqrt(8)))


def epipolar_errors(samples, poses):
    """x2^T [t]x R x1 of each of the five matches under its pose, (M, 5)."""
    turned = np.einsum("mij,mkj->mki", poses[..., :3], homogeneous(samples[..., :2]))
    return np.einsum("mki,mki->mk", homogeneous(samples[..., 2:]), np.cross(poses[:, None, :, 3], turned))


def depths(samples, poses):
    """Depths (M, 5, 2) in both cameras of the triangulated points, times the squared sine between their rays.

    From the normal equations of d2 x2 - d1 R x1 = t.
    """
    a = np.einsum("mij,mkj->mki", poses[..., :3], homogeneous(samples[..., :2]))
    b = homogeneous(samples[..., 2:])
    a, b, t = a / np.linalg.norm(a, axis=2)[..., None], b / np.linalg.norm(b, axis=2)[..., None], poses[:, None, :, 3]
    ab, at, bt = (a * b).sum(axis=2), (a * t).sum(axis=2), (b * t).sum(axis=2)
    return np.stack([ab * bt - at, bt - ab * at], axis=2)


def assert_valid(samples, poses, least=0.0):
    assert np.isfinite(poses).all()
    R, t = poses[..., :3], poses[..., 3]
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-13)
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(t, axis=1), 1, atol=1e-13)
    np.testing.assert_allclose(epipolar_errors(samples, poses), 0, atol=1e-9)
    assert (depths(samples, poses) > least).all()


def same_set(first, second, atol):
    if len(first) != len(second):
        return False
    differences = np.abs(first[:, None] - second[None]).max(axis=(2, 3))
    return bool((differences.min(axis=0, initial=9) < atol).all() and (differences.min(axis=1, initial=9) < atol).all())


def least_errors(samples, truth):
    """Of each sample: the least angle between the rotation of a solution and the true one."""
    owner, poses = solve_each(samples)
    errors = np.full(len(samples), np.pi)
    np.minimum.at(errors, owner, angles(poses[..., :3], truth[owner, :, :3]))
    return errors


def share_found(samples, truth, radians=1e-5):
    return np.mean(least_errors(samples, truth) < radians)


# --- all poses, and only poses ----------------------------------------------------------------------------------------


def test_the_true_pose_is_among_the_solutions(rng):
    samples, truth = random_problems(rng, 100_000)
    errors = least_errors(samples, truth)
    assert np.mean(errors < 1e-5) >= 0.9998
    assert np.mean(errors < 1e-8) >= 0.9995


def test_the_translation_is_right_too(rng):
    samples, truth = random_problems(rng, 1000)
    owner, poses = solve_each(samples)
    best = np.full(1000, np.inf)
    np.minimum.at(best, owner, np.abs(poses - truth[owner]).max(axis=(1, 2)))
    assert np.quantile(best, 0.99) < 1e-8


def test_every_solution_is_a_pose_that_explains_the_matches(rng):
    for samples, least in ((random_problems(rng, 40_000)[0], 80_000), (random_outliers(rng, 100_000), 20_000)):
        owner, poses = solve_each(samples)
        assert len(poses) > least
        assert_valid(samples[owner], poses)


def test_solutions_are_different(rng):
    owner, poses = solve_each(random_problems(rng, 5000)[0])
    for i in range(5000):
        mine = poses[owner == i]
        gaps = np.abs(mine[:, None] - mine[None]).max(axis=(2, 3)) + np.eye(len(mine))
        assert gaps.min() > 1e-7


def test_a_pose_is_polished_only_where_the_points_are_in_front(rng):
    samples, truth = random_problems(rng, 200)
    for sample, pose in zip(samples, truth, strict=True):
        near = naive.nudged(rng, pose, 1e-4, direction=True)
        assert polish(sample, np.empty((5, 6)), near)
        np.testing.assert_allclose(epipolar_errors(sample[None], near[None]), 0, atol=1e-11)
        assert not polish(sample, np.empty((5, 6)), pose * [1, 1, 1, -1])


@pytest.mark.parametrize("field", [0.3, 0.1, 0.01, 0.001])
def test_narrow_views_are_solved_too(rng, field):
    samples, truth = random_problems(rng, 2000, field, near=1 / field, far=3 / field, degrees=10 * field)
    assert share_found(samples, truth, 1e-3 * field) >= 0.99


@pytest.mark.parametrize("t", [*np.eye(3), *-np.eye(3)])
@pytest.mark.parametrize("quarters", range(4))
def test_a_motion_along_an_axis_is_solved_too(rng, t, quarters):
    """Many entries of E are 0 then."""
    truth = np.column_stack([Rotation.from_euler("z", 90 * quarters, degrees=True).as_matrix().round(), t])
    samples = np.array([naive.two_view_rows(rng, 5, truth) for _ in range(500)])
    assert share_found(samples, np.broadcast_to(truth, (500, 3, 4))) >= 0.99


def test_points_on_a_plane_are_solved_too(rng):
    found = 0
    for _ in range(500):
        truth = naive.random_pose(rng, 20)
        image = rng.uniform(-0.5, 0.5, (5, 2))
        points = naive.lifted(image, 4 / (homogeneous(image) @ [*rng.uniform(-0.3, 0.3, 2), 1]))
        sample = np.hstack([image, naive.projected(naive.moved(truth, points))])
        found += share_found(sample[None], truth[None])
    assert found >= 495


# --- by other routes --------------------------------------------------------------------------------------------------

CUBIC = [(3, 0, 0), (2, 1, 0), (1, 2, 0), (0, 3, 0), (2, 0, 1), (1, 1, 1), (0, 2, 1), (1, 0, 2), (0, 1, 2), (0, 0, 3)]
LOWER = [(2, 0, 0), (1, 1, 0), (0, 2, 0), (1, 0, 1), (0, 1, 1), (0, 0, 2), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)]


def monomials(exponents, xyz):
    return np.prod(xyz[:, None] ** np.array(exponents), axis=2)


def constraints(E):
    return np.append(2 * E @ E.T @ E - np.trace(E @ E.T) * E, np.linalg.det(E))


def essential_matrices(sample):
    """All complex ones, by the action matrix (Stewenius, Engels and Nister 2006); its eigenvectors hold x, y and z."""
    rows = np.einsum("ki,kj->kij", homogeneous(sample[:, 2:]), homogeneous(sample[:, :2])).reshape(5, 9)
    basis = np.linalg.svd(rows)[2][5:].reshape(4, 3, 3)
    xyz = np.random.default_rng(0).uniform(-1, 1, (40, 3))
    values = [constraints(np.tensordot([*p, 1], basis, 1)) for p in xyz]
    coefficients = np.linalg.lstsq(monomials(CUBIC + LOWER, xyz), np.array(values), rcond=None)[0].T
    reduced = -np.linalg.solve(coefficients[:, :10], coefficients[:, 10:])
    action = np.zeros((10, 10))
    for i, exponents in enumerate(LOWER):
        product = (exponents[0] + 1, *exponents[1:])
        action[i] = reduced[CUBIC.index(product)] if product in CUBIC else np.eye(10)[LOWER.index(product)]
    vectors = np.linalg.eig(action)[1].T
    return np.tensordot(vectors[:, 6:] / vectors[:, 9:], basis, 1)


def poses_of(E, sample):
    """The four poses of an essential matrix that have the five points in front."""
    u, _, vt = np.linalg.svd(E)
    W = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    candidates = [u @ turn @ vt for turn in (W, W.T)]
    candidates = np.array([np.column_stack([R * np.linalg.det(R), s * u[:, 2]]) for R in candidates for s in (1, -1)])
    return candidates[(depths(np.broadcast_to(sample, (4, 5, 4)), candidates) > 0).all(axis=(1, 2))]


@pytest.mark.parametrize("make", [lambda rng: random_problems(rng, 300)[0], lambda rng: random_outliers(rng, 600)])
def test_equals_the_action_matrix(rng, make):
    compared, several = 0, 0
    for sample in make(rng):
        E = essential_matrices(sample)
        E /= np.linalg.norm(E, axis=(1, 2))[:, None, None]
        imaginary = np.abs(E.imag).max(axis=(1, 2))
        if ((imaginary > 1e-8) & (imaginary < 1e-3)).any():
            continue  # nearly a double root: which of them are real is a matter of rounding
        expected = np.concatenate([poses_of(e.real, sample) for e in E[imaginary <= 1e-8]] or [np.empty((0, 3, 4))])
        assert same_set(solve(sample[None]), expected, 1e-5)
        compared, several = compared + 1, several + (len(expected) > 1)
    assert compared > 280
    assert several > 5


@pytest.mark.parametrize(
    ("make", "least"),
    [(lambda rng: random_problems(rng, 1000)[0], 980), (lambda rng: random_outliers(rng, 3000), 2990)],
)
def test_equals_poselib(rng, make, least):
    """But for one sample in a hundred, where either one misses a pose or takes nearly a double root for one."""
    poselib = pytest.importorskip("poselib")
    same = 0
    for sample in make(rng):
        rays = homogeneous(sample.reshape(5, 2, 2))
        rays /= np.linalg.norm(rays, axis=2)[..., None]
        theirs = np.array([pose.Rt for pose in poselib.relpose_5pt(rays[:, 0], rays[:, 1])]).reshape(-1, 3, 4)
        same += same_set(solve(sample[None]), theirs, 1e-4)
    assert same >= least


# --- symmetries -------------------------------------------------------------------------------------------------------


def inverse(poses):
    R = poses[..., :3].transpose(0, 2, 1)
    return np.concatenate([R, -R @ poses[..., 3:]], axis=2)


def share_same(pairs, atol=1e-6):
    return np.mean([same_set(first, second, atol) for first, second in pairs])


def test_the_order_of_the_rows_does_not_matter(rng):
    samples = random_problems(rng, 20)[0]
    orders = list(permutations(range(5)))
    assert share_same((solve(x[None, list(order)]), solve(x[None])) for x in samples for order in orders) > 0.99


def test_swapping_the_images_inverts_the_poses(rng):
    samples = np.concatenate([random_problems(rng, 500)[0], random_outliers(rng, 500)])
    assert share_same((solve(x[None][..., [2, 3, 0, 1]]), inverse(solve(x[None]))) for x in samples) > 0.99


@pytest.mark.parametrize("camera", [0, 1])
def test_turning_a_camera_turns_the_poses(rng, camera):
    def pairs():
        for sample in random_problems(rng, 1000, field=0.5)[0]:
            Q = naive.random_pose(rng, 30)[:, :3]
            turned, columns = sample.copy(), slice(2 * camera, 2 * camera + 2)
            turned[:, columns] = naive.projected(homogeneous(sample[:, columns]) @ Q.T)
            poses = solve(sample[None])
            if camera:
                yield solve(turned[None]), Q @ poses
            else:
                yield solve(turned[None]), np.concatenate([poses[..., :3] @ Q.T, poses[..., 3:]], axis=2)

    assert share_same(pairs()) > 0.99


def test_a_mirror_mirrors_the_poses(rng):
    """x to -x in both images."""
    samples = random_problems(rng, 1000)[0]
    mirror = np.array([-1.0, 1, 1])
    signs = mirror[:, None] * np.append(mirror, 1.0)
    assert share_same((solve(x[None] * [-1, 1, -1, 1]), solve(x[None]) * signs) for x in samples) > 0.99


# --- samples that do not determine a pose -----------------------------------------------------------------------------


def on_a_line(rng):
    return np.linspace(-1, 1, 5)[:, None] * rng.uniform(-0.5, 0.5, 2) + rng.uniform(-0.5, 0.5, 2)


def matches_of(points, pose):
    return np.hstack([naive.projected(points), naive.projected(naive.moved(pose, points))])


def two_coincide(rng, sample, pose):
    sample[3] = sample[1]


def all_coincide(rng, sample, pose):
    sample[:] = sample[0]


def zeros(rng, sample, pose):
    sample[:] = 0


def on_a_line_in_the_first_image(rng, sample, pose):
    sample[:, :2] = on_a_line(rng)


def on_a_line_in_the_second_image(rng, sample, pose):
    sample[:, 2:] = on_a_line(rng)


def on_a_line_in_both_images(rng, sample, pose):
    sample[:] = np.hstack([on_a_line(rng), on_a_line(rng)])


def on_a_line_in_space(rng, sample, pose):
    sample[:] = matches_of([0, 0, 5] + np.linspace(-1, 1, 5)[:, None] * rng.uniform(-1, 1, 3), pose)


def pure_rotation(rng, sample, pose):
    sample[:, 2:] = naive.projected(homogeneous(sample[:, :2] / 2) @ pose[:, :3].T)
    sample[:, :2] /= 2


def no_motion(rng, sample, pose):
    sample[:, 2:] = sample[:, :2]


def a_number_that_is_not_finite(rng, sample, pose):
    sample[rng.integers(5), rng.integers(4)] = rng.choice([np.nan, np.inf, -np.inf])


def a_row_that_is_not_finite(rng, sample, pose):
    sample[rng.integers(5)] = rng.choice([np.nan, np.inf, -np.inf])


def far_too_large(rng, sample, pose):
    sample *= 1e200


UNDETERMINED = [
    two_coincide,
    all_coincide,
    zeros,
    on_a_line_in_the_first_image,
    on_a_line_in_the_second_image,
    on_a_line_in_both_images,
    on_a_line_in_space,
    pure_rotation,
    no_motion,
    a_number_that_is_not_finite,
    a_row_that_is_not_finite,
    far_too_large,
]


def spoilt(rng, spoil):
    pose = naive.random_pose(rng)
    sample = naive.two_view_rows(rng, 5, pose)
    spoil(rng, sample, pose)
    return sample


@pytest.mark.parametrize("spoil", UNDETERMINED)
def test_samples_that_do_not_determine_a_pose_have_none(rng, spoil):
    assert len(solve([spoilt(rng, spoil) for _ in range(1000)])) == 0


def in_the_plane_through_a_centre(rng, sample, pose):
    """The points look collinear in the first image, not so in the second one."""
    sample[:] = matches_of(naive.lifted(0.5 * on_a_line(rng), rng.uniform(2, 8, 5)), pose)


def two_coincide_in_one_image(rng, sample, pose):
    sample[3, :2] = sample[1, :2]


def four_on_a_line(rng, sample, pose):
    sample[:4, :2] = on_a_line(rng)[:4]


def whole_numbers(rng, sample, pose):
    sample[:] = rng.integers(-1, 2, (5, 4))


@pytest.mark.parametrize(
    ("spoil", "most"),
    [
        (in_the_plane_through_a_centre, 60),
        (two_coincide_in_one_image, 5000),
        (four_on_a_line, 2000),
        (whole_numbers, 1000),
    ],
)
def test_odd_samples_have_valid_poses_or_none(rng, spoil, most):
    owner, poses = solve_each(samples := np.array([spoilt(rng, spoil) for _ in range(3000)]))
    assert_valid(samples[owner], poses, least=-1e-9)
    assert len(poses) <= most


# --- batches ----------------------------------------------------------------------------------------------------------


def test_no_samples_have_no_poses():
    assert len(solve(np.empty((0, 5, 4)))) == 0


@pytest.mark.parametrize("count", [1, 2, LANES - 1, LANES, LANES + 1, 3 * LANES + 5])
def test_a_batch_equals_its_samples_one_by_one(rng, count):
    """To the last bit, and samples that determine nothing change nothing."""
    samples = np.array([spoilt(rng, rng.choice(UNDETERMINED)) for _ in range(count)])
    good = rng.random(count) < 0.7
    samples[good] = random_problems(rng, count)[0][good]
    np.testing.assert_array_equal(solve(samples), solve_each(samples)[1])


def test_what_is_beyond_the_count_is_left_alone(rng):
    samples = random_outliers(rng, 100)
    models = np.full((1000, 3, 4), np.nan)
    count = five_point_poses(samples, models)
    assert np.isfinite(models[:count]).all()
    assert np.isnan(models[count + 1 :]).all()


def test_samples_are_not_changed(rng):
    samples = random_problems(rng, 50)[0]
    before = samples.copy()
    solve(samples)
    np.testing.assert_array_equal(samples, before)
