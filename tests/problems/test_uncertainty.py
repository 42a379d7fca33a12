"""What is said of how far an answer may be off, against how far it is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from scipy.stats import chi, ortho_group

import naive
from nonsac import simulate
from nonsac.kernels.pose_math import tangents
from nonsac.problems import AbsolutePose, Noise, Registration, RelativePose
from nonsac.problems.pose import likely_length
from nonsac.result import Uncertainty

PROBLEMS = {
    "registration": (Registration(), simulate.registration, ("source", "target"), 0.05),
    "free scale": (Registration(None), simulate.registration, ("source", "target"), 0.05),
    "relative pose": (RelativePose(), simulate.relative_pose, ("points1", "points2"), 0.002),
    "absolute pose": (AbsolutePose(), simulate.absolute_pose, ("points2d", "points3d"), 0.005),
}
CASES = pytest.mark.parametrize("case", PROBLEMS)


def right_rows(case, n, noise, rng):
    """Rows without outliers, and the truth."""
    _, make, names, _ = PROBLEMS[case]
    data = make(n, 0.0, noise, rng)
    return np.hstack([getattr(data, name) for name in names]), data.T[:3]


def refitted(problem, truth, rows):
    return problem.refit(truth, rows, np.ones(len(rows)))


def rotation_of(model):
    return model[:, :3] / np.cbrt(np.linalg.det(model[:, :3]))


def turn_between(model, truth):
    return np.degrees(Rotation.from_matrix(rotation_of(model) @ rotation_of(truth).T).as_rotvec())


def middle_depth(model, points):
    return np.median(points @ model[2, :3] + model[2, 3])


def shift_as_angle(case, model, truth, rows):
    """How far the translation is off in degrees, as a vector: its direction, or where the scene's middle comes to be.

    The median is the middle that the parameters of the fit are about.
    """
    if case == "relative pose":
        return np.degrees(np.reshape(tangents(*truth[:, 3]), (2, 3)) @ model[:, 3])
    points = rows[:, 2:] if case == "absolute pose" else rows[:, :3]
    middle = np.median(points, axis=0)
    moved = (model - truth) @ np.append(middle, 1.0)
    extent = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
    return np.degrees(moved / (middle_depth(truth, points) if case == "absolute pose" else extent))


def uncertainty_of(problem, model, rows, noise):
    return problem.uncertainty(problem.covariance(model, rows, Noise.given(noise)), model, rows)


# --- lengths of errors ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1, 2, 3])
def test_the_likely_length_of_an_even_error_is_that_of_a_chi_distribution(size):
    """1.96 standard deviations for a number, 2.45 in the plane, 2.80 in space."""
    assert likely_length(4.0 * np.eye(size)) == pytest.approx(2.0 * chi(size).ppf(0.95))


@pytest.mark.parametrize(
    "deviations", [(1, 1, 1), (1, 0.5, 0.2), (1, 1, 0.01), (1, 0.01, 1e-4), (5, 4, 3), (1, 0.3), (7,)]
)
def test_95_percent_of_errors_are_shorter_than_the_likely_length(rng, deviations):
    size = len(deviations)
    axes = ortho_group.rvs(size, random_state=rng) if size > 1 else np.eye(1)
    errors = np.array(deviations) * rng.standard_normal((40_000, size)) @ axes.T
    covariance = axes * np.square(deviations) @ axes.T
    within = (np.linalg.norm(errors, axis=1) < likely_length(covariance)).mean()
    assert within == pytest.approx(0.95, abs=0.007)


@given(arrays(np.float64, (3, 3), elements=st.floats(-1, 1)), st.floats(1e-3, 1e3))
def test_the_likely_length_scales_with_the_error(root, factor):
    covariance = root @ root.T
    expected = factor * likely_length(covariance)
    assert likely_length(factor**2 * covariance) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_what_is_not_known_may_be_of_any_length():
    for unknown in (np.inf, np.nan):
        assert likely_length(np.full((3, 3), unknown)) == np.inf
        assert likely_length(np.diag([1.0, 1.0, unknown])) == np.inf


def test_no_error_has_no_length():
    assert likely_length(np.zeros((3, 3))) == 0.0
    assert likely_length(np.diag([4.0, 0.0, 0.0])) == pytest.approx(2.0 * 1.95996, rel=1e-4)


# --- standard errors --------------------------------------------------------------------------------------------------


def disturbed(case, rows, noise, rng):
    """The rows with noise where the problem says that it is."""
    noisy = rows + noise * rng.standard_normal(rows.shape)
    exact = {"relative pose": slice(0, 0), "absolute pose": slice(2, 5)}.get(case, slice(0, 3))
    noisy[:, exact] = rows[:, exact]
    return noisy


@CASES
def test_standard_errors_are_those_of_refits_in_the_worst_direction(rng, case):
    problem, *_, noise = PROBLEMS[case]
    rows, truth = right_rows(case, 60, 0.0, rng)
    errors = []
    for _ in range(400):
        model = refitted(problem, truth, disturbed(case, rows, noise, rng))
        errors.append(np.r_[turn_between(model, truth), shift_as_angle(case, model, truth, rows)])
    errors = np.array(errors)
    spread = [np.sqrt(np.linalg.eigvalsh(np.cov(part.T))[-1]) for part in (errors[:, :3], errors[:, 3:])]
    stated = problem.standard_errors(truth, rows, Noise.given(noise))
    # The errors of registrations are about the mean, those measured here about the median.
    assert stated == pytest.approx(spread, rel=0.25)


@CASES
def test_standard_errors_grow_with_the_noise_and_fall_with_the_rows(rng, case):
    problem, *_, noise = PROBLEMS[case]
    rows, truth = right_rows(case, 60, 0.0, rng)
    once = np.array(problem.standard_errors(truth, rows, Noise.given(noise)))
    assert problem.standard_errors(truth, rows, Noise.given(3 * noise)) == pytest.approx(3 * once)
    assert problem.standard_errors(truth, np.tile(rows, (4, 1)), Noise.given(noise)) == pytest.approx(once / 2)


@CASES
def test_what_is_not_determined_has_an_infinite_standard_error(rng, case):
    problem, *_, noise = PROBLEMS[case]
    rows, truth = right_rows(case, 60, 0.0, rng)
    assert problem.standard_errors(truth, np.repeat(rows[:1], 20, axis=0), Noise.given(noise)) == (np.inf, np.inf)


# --- uncertainty ------------------------------------------------------------------------------------------------------


@CASES
def test_nearly_95_percent_of_errors_are_within_the_uncertainty(case):
    problem, *_, noise = PROBLEMS[case]
    within = []
    for seed in range(200):
        rows, truth = right_rows(case, 100, noise, np.random.default_rng([3, seed]))
        model = refitted(problem, truth, rows)
        stated = uncertainty_of(problem, model, rows, noise)
        angle = np.linalg.norm(shift_as_angle(case, model, truth, rows))
        shift = angle if case == "relative pose" else np.linalg.norm(model[:, 3] - truth[:, 3])
        turn = np.linalg.norm(turn_between(model, truth))
        within.append([turn < stated.rotation, shift < stated.translation, angle < stated.angle])
    shares = np.mean(within, axis=0)
    assert shares.min() >= 0.9
    assert shares.max() <= 0.99


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_unit_of_length_is_that_of_the_translation_alone(rng, unit):
    for case, world in (("registration", np.full(6, unit)), ("absolute pose", np.repeat([1.0, unit], [2, 3]))):
        problem, *_, noise = PROBLEMS[case]
        rows, truth = right_rows(case, 50, noise, rng)
        scaled = np.column_stack([truth[:, :3], unit * truth[:, 3]])
        once = uncertainty_of(problem, truth, rows, noise)
        again = uncertainty_of(problem, scaled, rows * world, noise * world[0])
        assert (again.rotation, again.translation, again.angle) == pytest.approx(
            (once.rotation, unit * once.translation, once.angle), rel=1e-4
        )


@pytest.mark.parametrize("problem", [RelativePose, AbsolutePose])
def test_the_uncertainty_is_the_same_in_pixels(rng, problem):
    case, focals = ("relative pose", 2) if problem is RelativePose else ("absolute pose", 1)
    noise = PROBLEMS[case][3]
    rows, truth = right_rows(case, 50, noise, rng)
    once = uncertainty_of(problem(), truth, rows, noise)
    again = uncertainty_of(problem(*[1000.0] * focals), truth, rows, 1000.0 * noise)
    assert again.within(1.0) == pytest.approx(once.within(1.0), rel=1e-4)
    assert again.translation == pytest.approx(once.translation, rel=1e-4)


def test_the_translation_of_a_relative_pose_is_an_angle(rng):
    rows, truth = right_rows("relative pose", 50, 0.002, rng)
    stated = uncertainty_of(RelativePose(), truth, rows, 0.002)
    assert stated.translation == stated.angle > 0.0


def test_far_from_the_origin_the_translation_is_uncertain_and_its_angle_is_not(rng):
    model = naive.random_model(rng)
    rows = naive.matching_rows(rng, 100, model, noise=0.02)
    far = np.array([1000.0, 0.0, 0.0])
    shifted = np.column_stack([model[:, :3], model[:, 3] - model[:, :3] @ far])
    near_by = uncertainty_of(Registration(), model, rows, 0.02)
    away = uncertainty_of(Registration(), shifted, rows + np.r_[far, 0, 0, 0], 0.02)
    assert away.translation > 100.0 * near_by.translation
    assert (away.rotation, away.angle) == pytest.approx((near_by.rotation, near_by.angle), rel=1e-4)


@CASES
def test_an_unknown_covariance_leaves_everything_open(rng, case):
    problem, *_ = PROBLEMS[case]
    rows, truth = right_rows(case, 20, 0.0, rng)
    size = len(problem.covariance(truth, rows, Noise.given(0.1)))
    with np.errstate(invalid="ignore"):  # as in all calls
        stated = problem.uncertainty(np.full((size, size), np.inf), truth, rows)
    assert (stated.rotation, stated.translation, stated.angle) == (np.inf, np.inf, np.inf)


def test_the_translation_may_be_twice_as_uncertain_as_the_rotation():
    assert Uncertainty(4.0, 700.0, 6.0).within(5.0) == pytest.approx(0.8)
    assert Uncertainty(2.0, 700.0, 15.0).within(5.0) == pytest.approx(1.5)
    assert Uncertainty(1.0, 700.0, 2.0).within(0.5) == pytest.approx(2.0)


def test_a_multiple_is_one_of_every_number():
    assert Uncertainty(1.0, 2.0, 3.0).times(2.0) == Uncertainty(2.0, 4.0, 6.0)
