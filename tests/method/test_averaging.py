"""Robust averages of hypotheses as a rule and as an answer, over non-minimal and over minimal hypotheses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import naive
import nonsac
from nonsac import simulate
from nonsac.method.average_refiner import HypothesisAverage
from nonsac.method.averaging import AVERAGES, l1_average, trimmed_average, truncated_average
from nonsac.method.scoring import NearestToAverage, select
from nonsac.problems import AbsolutePose, Registration, RelativePose
from nonsac.result import Hypothesis
from nonsac.testing import check_refiner

PROBLEM, NO_ROWS = Registration(), np.empty((0, 6))
kinds = pytest.mark.parametrize("kind", AVERAGES)


def motions(rng, truth, count, share, degrees=3.0):
    """Motions around a true one, of which a share is turned and moved anyhow."""
    wrong = round(share * count)
    right = Rotation.from_rotvec(np.radians(degrees) * rng.standard_normal((count - wrong, 3))).as_matrix()
    rotations = np.concatenate([right @ truth[:, :3], Rotation.random(wrong, rng).as_matrix()])
    places = np.concatenate(
        [truth[:, 3] + 0.05 * rng.standard_normal((count - wrong, 3)), rng.uniform(-9, 9, (wrong, 3))]
    )
    return np.concatenate([rotations, places[:, :, None]], axis=2)


def errors(average, rng, count, share, trials=15):
    """Largest angle and largest distance of the averages from the truth."""
    angles, shifts = [], []
    for _ in range(trials):
        truth = naive.random_model(rng)
        found = average(PROBLEM, motions(rng, truth, count, share), NO_ROWS)
        angles.append(naive.angle_between(found, truth))
        shifts.append(np.linalg.norm(found[:, 3] - truth[:, 3]))
    return max(angles), max(shifts)


@kinds
def test_forty_percent_of_wrong_hypotheses_are_borne_by_each(kind, rng):
    angle, shift = errors(AVERAGES[kind], rng, 100, 0.4)
    assert angle < 5.0
    assert shift < 0.2


def test_trimming_bears_more_than_the_l1_mean_and_truncation_the_most(rng):
    assert errors(trimmed_average, rng, 100, 0.6)[0] < 2.0 < errors(l1_average, rng, 100, 0.6)[0]
    assert errors(truncated_average, rng, 200, 0.9)[0] < 4.0 < errors(trimmed_average, rng, 200, 0.9)[0]


def test_truncation_bears_ninety_nine_percent_if_the_right_ones_are_enough(rng):
    """The claim of Lee and Civera's abstract."""
    angle, shift = errors(truncated_average, rng, 1500, 0.99, trials=5)
    assert angle < 6.0
    assert shift < 0.2


def test_if_no_two_agree_all_are_averaged():
    places = [naive.shift_model(place) for place in (0.0, 100.0, 250.0)]
    assert truncated_average(naive.Shift(), np.stack(places), np.empty((0, 2)))[0, 3] == 100.0


@kinds
def test_the_frames_do_not_matter(kind, rng):
    left, right = naive.random_model(rng), naive.random_model(rng)
    models = motions(rng, naive.random_model(rng), 40, 0.3)

    def framed(model):
        square = [np.vstack([each, [0, 0, 0, 1.0]]) for each in (left, model, right)]
        return (square[0] @ square[1] @ square[2])[:3]

    expected = framed(AVERAGES[kind](PROBLEM, models, NO_ROWS))
    # The same place in the other frame: averaging about another one would give another translation.
    back = np.linalg.inv(np.vstack([right, [0, 0, 0, 1.0]]))
    place = np.tile([*back[:3, 3], 0.0, 0.0, 0.0], (5, 1))
    found = AVERAGES[kind](PROBLEM, np.stack([framed(model) for model in models]), place)
    np.testing.assert_allclose(found, expected, atol=1e-7)


@kinds
def test_a_problem_of_no_motion_takes_the_best_of_its_models(kind):
    lines = np.stack([naive.line_model(angle, 1.0) for angle in (10.0, 12.0, 13.0, 70.0)])
    np.testing.assert_array_equal(AVERAGES[kind](naive.Line(), lines, np.empty((0, 2))), lines[1])


@kinds
def test_the_rule_selects_the_hypothesis_nearest_to_the_average(kind, rng):
    models = motions(rng, naive.random_model(rng), 12, 0.25)
    models[3] = np.nan
    hypotheses = [Hypothesis(model, np.zeros(4), 1.0) for model in models]
    index, scores = select(NearestToAverage(kind), hypotheses, PROBLEM)
    average = AVERAGES[kind](PROBLEM, np.delete(models, 3, axis=0), NO_ROWS)
    distances = np.array([naive.angle_between(model, average) if i != 3 else np.inf for i, model in enumerate(models)])
    assert index == np.argmin(distances)
    np.testing.assert_allclose(scores, -distances, atol=1e-6)


def rows_of(problem, outliers, rng):
    """Rows (n, D) of a simulation, their noise and the true motion."""
    if isinstance(problem, Registration):
        data, noise = simulate.registration(n=6000, outlier_ratio=outliers, noise=0.01, rng=rng), 0.01
        return np.hstack([data.source, data.target]), noise, data.T
    if isinstance(problem, AbsolutePose):
        points, noise = simulate.absolute_pose(n=6000, outlier_ratio=outliers, noise=0.005, rng=rng), 0.005
        return np.hstack([points.points2d, points.points3d]), noise, points.T
    views, noise = simulate.relative_pose(n=6000, outlier_ratio=outliers, noise=0.001, rng=rng), 0.001
    return np.hstack([views.points1, views.points2]), noise, views.T


problems = pytest.mark.parametrize(
    "problem", [Registration(), AbsolutePose(), RelativePose()], ids=lambda p: type(p).__name__
)


@problems
@kinds
def test_non_minimal_hypotheses_are_averaged_to_a_right_answer(problem, kind, rng):
    rows, noise, truth = rows_of(problem, 0.6, rng)
    result = nonsac.estimate(
        nonsac.ArraySource(rows), problem, noise=noise, samples=8, sample_size=500, refine=HypothesisAverage(kind)
    )
    assert result.success
    assert naive.angle_between(result.model, truth) < 0.5
    hypotheses = np.stack([h.model for h in result.hypotheses])
    np.testing.assert_allclose(result.model, AVERAGES[kind](problem, hypotheses, rows), atol=1e-3)


@problems
def test_minimal_hypotheses_are_averaged_to_a_right_answer(problem, rng):
    """Hypothesis averaging as the paper's Table 1 has it: one minimal model a sample, held against the others only."""
    rows, noise, truth = rows_of(problem, 0.4, rng)
    result = nonsac.estimate(
        nonsac.ArraySource(rows), problem, nonsac.Ransac(1), noise=noise, samples=400, sample_size=15, refine="average"
    )
    errors = [naive.angle_between(h.model, truth) for h in result.hypotheses if h.found]
    assert np.median(errors) > 2.0
    assert naive.angle_between(result.model, truth) < 2.0


def test_the_refiner_does_what_refiners_do(rng):
    rows, noise, _ = rows_of(Registration(), 0.3, rng)
    for kind in AVERAGES:
        check_refiner(HypothesisAverage(kind), Registration(), rows, noise)


def test_motions_are_averaged_where_the_rows_are(rng):
    """In map coordinates t differs by kilometres between hypotheses that agree on the rows."""
    rows, noise, _ = rows_of(Registration(), 0.9, rng)
    rows[:, :3] += [5e5, 4e6, 100.0]
    result = nonsac.estimate(
        nonsac.ArraySource(rows), Registration(), noise=noise, samples=6, sample_size=400, refine="average"
    )
    shifts = np.stack([h.model[:, 3] for h in result.hypotheses if h.found])
    assert np.ptp(shifts, axis=0).max() > 1000.0
    assert result.success
    assert np.median(result.residuals[result.inliers]) < 2 * noise


def test_the_rule_does_not_change_the_average(rng):
    rows, noise, _ = rows_of(Registration(), 0.8, rng)
    first, second = (
        nonsac.register_pairs(rows[:, :3], rows[:, 3:], noise=noise, samples=4, rule=rule, refine="average").model
        for rule in ("tlp_0.1", "l1_average")
    )
    np.testing.assert_array_equal(first, second)


def test_an_unknown_average_is_refused():
    with pytest.raises(ValueError, match="kind must be one of"):
        HypothesisAverage("l2")
