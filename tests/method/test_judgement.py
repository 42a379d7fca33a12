"""What is said of a model besides the verdict itself; rivals are in `test_refine`."""

import math

import numpy as np
import pytest

import naive
from nonsac import Hypothesis, Noise, Registration
from nonsac.layouts import Rows
from nonsac.method.judgement import Judgement, effort_of
from nonsac.method.verdict import Effort
from nonsac.result import Remark, Status

SIGMA = 0.02


def hypothesis(share, tested=None):
    """One whose inliers are this share of a hundred rows."""
    residuals = np.where(np.arange(100) < round(100 * share), 0.0, 9.0)
    return Hypothesis(naive.shift_model(3.0), residuals, 1.0, tested=tested)


def shifted(rng, n=1000, right=500, noise=SIGMA):
    rows = np.column_stack([rng.uniform(-1, 1, n), rng.uniform(-9, 9, n)])
    rows[:right, 1] = rows[:right, 0] + 3.0 + noise * rng.standard_normal(right)
    return rows


def judged(rows, problem=None, weights=None, noise=SIGMA, known=True, shift=3.0, tested=1000):
    hypotheses = [hypothesis(0.5, tested)]
    model = naive.shift_model(shift)
    return Judgement.of(problem or naive.Shift(), model, Rows(rows, weights), Noise.given(noise, known), hypotheses)


def nothing(tested=None):
    """A search that found no model."""
    return Hypothesis(np.full((3, 4), np.nan), np.full(100, np.inf), 1.0, tested=tested)


def test_models_that_were_tested_add_up():
    hypotheses = [hypothesis(0.5, 10), hypothesis(0.1, 0), hypothesis(0.5, 7), nothing(5)]
    assert effort_of(naive.Shift(), hypotheses) == Effort(compared=22, searched=22)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.9])
@pytest.mark.parametrize(("problem", "size"), [(naive.Shift(), 1), (naive.Line(), 2), (Registration(), 3)])
def test_an_estimator_that_does_not_tell_is_taken_to_have_searched_with_99_percent(problem, size, share):
    expected = math.ceil(math.log(0.01) / math.log(1 - share**size))
    assert effort_of(problem, [hypothesis(share)]) == (expected, expected)
    three = [hypothesis(share), hypothesis(share, 5), hypothesis(share)]
    assert effort_of(problem, three) == (2 * expected + 5, 2 * expected + 5)


def test_what_is_assumed_has_bounds():
    assert effort_of(Registration(), [hypothesis(1.0)]) == (1, 1)
    assert effort_of(Registration(), [hypothesis(0.01)]) == (10**6, 10**6)


def test_one_that_tells_nothing_and_finds_nothing_may_have_compared_any_number_and_searched_for_none():
    """So it speaks against an answer as much as it can, and for none."""
    assert effort_of(Registration(), [nothing()]) == Effort(compared=10**6, searched=0)
    assert effort_of(Registration(), [nothing(), hypothesis(1.0), nothing(), hypothesis(0.5, 9)]) == (
        2 * 10**6 + 10,
        10,
    )
    assert effort_of(Registration(), []) == (0, 0)


def test_the_noise_and_the_inliers_are_those_of_the_model(rng):
    rows = shifted(rng)
    judgement = judged(rows)
    assert judgement.verdict.status is Status.OK
    assert judgement.noise == pytest.approx(SIGMA, rel=0.15)
    assert judgement.num_inliers == np.count_nonzero(np.abs(rows[:, 0] + 3.0 - rows[:, 1]) < 5 * SIGMA)


@pytest.mark.parametrize(
    ("given", "remarks"),
    [
        (SIGMA / 10, (Remark.NOISE_LARGER,)),
        (SIGMA / 2, ()),
        (2 * SIGMA, ()),
        (10 * SIGMA, (Remark.NOISE_SMALLER,)),
    ],
)
def test_a_noise_that_is_off_by_more_than_three_is_remarked_on_if_somebody_gave_it(rng, given, remarks):
    rows = shifted(rng)
    told = judged(rows, noise=given).remarks
    assert tuple(remark.partition(":")[0] for remark in told if remark != Remark.PARTLY_RIGHT) == remarks
    assert not [remark for remark in judged(rows, noise=given, known=False).remarks if remark.startswith("noise")]


def test_nothing_is_said_of_the_noise_of_a_model_without_support(rng):
    judgement = judged(rng.uniform(-9, 9, (1000, 2)), noise=1e-4)
    assert (judgement.verdict.status, judgement.remarks) == (Status.LOW_SUPPORT, ())


class Certain(naive.Shift):
    """Tells how many rows it is asked for a covariance of."""

    def covariance(self, model, inliers, noise):
        return np.full((1, 1), float(len(inliers)))


@pytest.mark.parametrize(("right", "all_of_them"), [(800, True), (20_000, False)])
def test_the_covariance_is_that_of_some_inliers_scaled_to_all(rng, right, all_of_them):
    judgement = judged(shifted(rng, 40_000, right), Certain())
    asked = min(judgement.num_inliers, 5000)
    assert (asked == judgement.num_inliers) is all_of_them
    np.testing.assert_allclose(judgement.covariance, asked * (asked / judgement.num_inliers))


def test_there_is_no_covariance_of_weighted_rows_or_of_an_answer_that_is_not_trusted(rng):
    rows = shifted(rng)
    assert judged(rows, Certain()).covariance is not None
    assert judged(rows, Certain(), weights=rng.uniform(0.5, 2.0, 1000)).covariance is None
    assert judged(rows, Certain(), shift=-30.0).covariance is None
    assert judged(rows).covariance is None
