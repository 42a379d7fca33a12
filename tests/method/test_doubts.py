import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import naive
import nonsac
from nonsac import simulate
from nonsac.layouts import Rows
from nonsac.method.doubts import certainty, disagreement, slippage
from nonsac.method.residuals import Residuals
from nonsac.method.verdict import Candidate, Effort, judge_rows
from nonsac.problems import AbsolutePose, Noise, Registration, RelativePose
from nonsac.result import Remark, Status
from nonsac.simulate.motions import rotation_about

PROBLEMS = {
    "registration": (Registration(), simulate.registration, ("source", "target"), 0.01),
    "relative pose": (RelativePose(), simulate.relative_pose, ("points1", "points2"), 0.002),
    "absolute pose": (AbsolutePose(), simulate.absolute_pose, ("points2d", "points3d"), 0.002),
}
CASES = pytest.mark.parametrize("case", PROBLEMS)


def matches(case, n, outliers, rng):
    """A problem, its true model, rows and their noise."""
    problem, make, names, sigma = PROBLEMS[case]
    data = make(n, outliers, sigma, rng)
    return problem, data.T[:3], np.hstack([getattr(data, name) for name in names]), Noise.given(sigma)


def apart(problem, model, rows, noise, sigma=None):
    return disagreement(problem, model, Rows(rows), noise, sigma or noise.sigma)


def slipping(problem, model, rows, noise):
    return slippage(problem, model, Rows(rows), noise, Residuals.of(problem, model, Rows(rows)))


# --- parts of the scene -----------------------------------------------------------------------------------------------


@CASES
@pytest.mark.parametrize("outliers", [0.0, 0.5, 0.8])
def test_a_right_model_agrees_with_itself(case, outliers):
    for seed in range(5):
        assert apart(*matches(case, 400, outliers, seed)) < 1.0


def two_motions(case, rng, degrees):
    """Rows of two halves of a scene, one turned so far one way and the other the other way, and what lies between."""
    turns = [rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(angle)) for angle in (degrees, -degrees)]
    if case == "registration":
        model, points = np.eye(3, 4), rng.uniform(-1, 1, (400, 3))
        centres = [np.array([side, 0.0, 0.0]) for side in (-0.5, 0.5)]
        moved = [(points - centre) @ turn.T + centre for turn, centre in zip(turns, centres, strict=True)]
        seen, before = moved, points
    else:
        model = np.column_stack([np.eye(3), [0.0, 0.0, 1.0]])
        points = np.column_stack([rng.uniform(-2, 2, (400, 2)), rng.uniform(3, 6, 400)])
        moved = [points @ turn.T + model[:, 3] for turn in turns]
        seen, before = [each[:, :2] / each[:, 2:] for each in moved], points[:, :2] / points[:, 2:]
    where = np.where(points[:, :1] < 0.0, *seen)
    where = where + 1e-3 * rng.standard_normal(where.shape)
    halves = [where, points] if case == "absolute pose" else [before, where]
    return PROBLEMS[case][0], model, np.hstack(halves)


@CASES
def test_a_model_between_two_motions_does_not_agree_with_itself(rng, case):
    noise = Noise.within(0.15 if case == "registration" else 0.1)
    ratios = [apart(*two_motions(case, rng, degrees), noise, 1e-3) for degrees in (1.0, 3.0, 8.0)]
    assert max(ratios[:2]) < 1.0 < ratios[2]


def test_parts_that_determine_little_may_differ_more(rng):
    problem, model, rows = two_motions("registration", rng, 8.0)
    ratios = [apart(problem, model, rows, Noise.within(0.15), sigma) for sigma in (1e-3, 0.1, 1.0)]
    assert ratios[0] == pytest.approx(ratios[1], rel=0.01)  # within eight degrees nobody minds
    assert ratios[2] < 0.5 * ratios[1]


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_unit_and_the_order_of_rows_do_not_matter(rng, unit):
    problem, model, rows = two_motions("registration", rng, 8.0)
    ratio = apart(problem, model, rows, Noise.within(0.15), 1e-3)
    assert ratio == pytest.approx(2 * 8.0 / 8.0, rel=0.1)
    scaled = apart(problem, model, unit * rng.permutation(rows), Noise.within(unit * 0.15), unit * 1e-3)
    assert scaled == pytest.approx(ratio, rel=0.01)  # a few steps of the fits from the same start


@CASES
def test_nothing_is_said_where_a_part_has_few_rows(rng, case):
    problem, model, rows, noise = matches(case, 100, 0.0, rng)
    inliers = rows[problem.residuals(model[None], rows)[0] < noise.threshold]
    enough = 2 * (problem.minimal_size + 2)
    assert apart(problem, model, inliers[:enough], noise) is not None
    assert apart(problem, model, inliers[: enough - 1], noise) is None


def test_nothing_is_said_of_problems_without_standard_errors(rng):
    x = rng.uniform(-1, 1, 100)
    assert apart(naive.Shift(), naive.shift_model(3.0), np.column_stack([x, x + 3.0]), Noise.given(0.1)) is None


# --- models beside the answer -----------------------------------------------------------------------------------------


@CASES
@pytest.mark.parametrize("outliers", [0.0, 0.5, 0.9])
def test_next_to_nothing_slips_among_uniform_outliers(case, outliers):
    for seed in range(10):
        assert slipping(*matches(case, 500, outliers, seed)) < 0.3


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize(("base", "wrong"), [(0.5, 0.85), (0.7, 0.93)])
def test_a_statue_is_not_turned_by_what_its_base_says(given, base, wrong):
    for seed in range(1000, 1010):
        data = simulate.statue(600, wrong, 0.01, seed, base=base)
        result = nonsac.register_pairs(data.source, data.target, noise=0.01 if given else None)
        assert not result.success or naive.angle_between(result.R, data.T[:3, :3]) < 1.0


def ring(rng, slip, n=400):
    """Pairs of a ring that a quarter turn maps, but for so many degrees along the ring."""
    angles = rng.uniform(0.0, 2.0 * np.pi, n)
    after = angles + np.radians(90.0 + slip * rng.uniform(-1, 1, n))
    halves = [np.column_stack([np.cos(a), np.sin(a), rng.uniform(-0.1, 0.1, n)]) for a in (angles, after)]
    halves[1][:, 2] = halves[0][:, 2]
    rows = np.hstack(halves)
    rows[:, 3:] += 0.01 * rng.standard_normal((n, 3))
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), np.pi / 2)
    return Registration(), np.column_stack([turn, np.zeros(3)]), rows, Noise.given(0.01)


def test_pairs_slip_along_a_ring(rng):
    assert slipping(*ring(rng, 0.0)) == 0.0
    assert slipping(*ring(rng, 15.0)) > 1.0


def test_of_a_noise_that_nobody_gave_the_middle_counts(rng):
    """A wide noise, found on pairs that slip, takes most of the slipping for its own."""
    problem, model, rows, _ = ring(rng, 15.0)
    given, found = (slipping(problem, model, rows, Noise.given(0.045, known=known)) for known in (True, False))
    assert 2.0 * given < found > 1.0


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_slipping_does_not_depend_on_the_unit(rng, unit):
    problem, model, rows, noise = ring(rng, 15.0)
    once = slipping(problem, model, rows, noise)
    assert slipping(problem, model, unit * rows, Noise.given(unit * noise.sigma)) == pytest.approx(once, rel=1e-6)


def test_what_chance_explains_does_not_slip(rng):
    problem, model, rows, noise = ring(rng, 15.0)
    residuals = problem.residuals(model[None], rows)[0]
    by_chance = [np.where(np.arange(1000) < 1000 * rate, 0.0, 9.0) for rate in (0.0, 0.02, 0.5)]
    slippages = [slippage(problem, model, Rows(rows), noise, Residuals(residuals, each)) for each in by_chance]
    assert slippages[0] > slippages[1] > slippages[2] == 0.0


def test_nothing_slips_where_no_model_beside_is_known(rng):
    rows = np.column_stack([np.zeros(100), rng.uniform(2.0, 4.0, 100)])
    assert slipping(naive.Shift(), naive.shift_model(3.0), rows, Noise.given(0.05)) == 0.0


# --- what the verdict makes of it -------------------------------------------------------------------------------------


def judged(problem, model, rows, noise):
    """After a search so long that a better model, if there were one, would have come up."""
    return judge_rows(Candidate(problem, model, Rows(rows), noise), Effort(1, 10**9))


@pytest.mark.parametrize("known", [True, False])
@CASES
def test_a_model_between_two_motions_is_partly_right_and_not_trusted(rng, case, known):
    noise = Noise.within(0.15 if case == "registration" else 0.05, known)
    verdict = judged(*two_motions(case, rng, 10.0), noise)
    assert (verdict.status, verdict.remarks) == (Status.LOW_SUPPORT, (Remark.PARTLY_RIGHT,))
    assert verdict.confidence < 0.5
    assert verdict.tests["parts"] > 1.0


def test_a_model_of_pairs_that_slip_is_not_trusted(rng):
    verdict = judged(*ring(rng, 15.0))
    assert (verdict.status, verdict.remarks) == (Status.LOW_SUPPORT, (Remark.SLIPPING,))
    assert verdict.confidence < 0.5
    assert verdict.tests["slippage"] > 1.0
    assert judged(*ring(rng, 0.0)).status is Status.OK


@CASES
@pytest.mark.parametrize("known", [True, False])
def test_doubts_leave_a_right_model_alone(rng, case, known):
    problem, model, rows, noise = matches(case, 400, 0.5, rng)
    verdict = judged(problem, model, rows, Noise.given(noise.sigma, known))
    assert verdict.status is Status.OK
    assert verdict.confidence > 0.95


# --- certainty --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ratio", "expected"), [(-1.0, 1.0), (0.0, 1.0), (0.5, 1 - 1 / 32), (1.0, 0.5), (1.1, 0.26795), (1.2, 0.0), (9, 0)]
)
def test_certainty_is_one_half_where_the_doubt_is_as_large_as_allowed(ratio, expected):
    assert certainty(ratio) == pytest.approx(expected)


@given(st.floats(0.0, 1e6), st.floats(0.0, 1e6))
def test_certainty_falls_with_the_doubt(a, b):
    low, high = sorted((a, b))
    assert 0.0 <= certainty(high) <= certainty(low) <= 1.0
