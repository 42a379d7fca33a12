"""Whether raw clouds are trusted."""

import numpy as np
import pytest

from nonsac.clouds.verdict import judge_overlap
from nonsac.result import Status


def test_points_that_form_no_surface_are_not_trusted():
    assert judge_overlap((0.9, 0.9), 1.0, 900, np.array([100])).status is Status.OK
    assert judge_overlap((0.9, 0.9), 1.0, 900, np.array([100]), surfaces=False).status is Status.LOW_SUPPORT


def test_overlap_that_is_large_and_unrivalled_is_trusted():
    assert judge_overlap((0.6, 0.6), 1.0, 600, np.array([])).confidence > 0.999
    for others in ([], [0], [60, 30]):
        verdict = judge_overlap((0.6, 0.6), 1.0, 600, np.array(others))
        assert verdict.status is Status.OK
        assert 0.9 < verdict.confidence <= 1.0


def test_overlap_that_is_rivalled_is_ambiguous():
    for others in ([590, 30], [600], [700]):
        verdict = judge_overlap((0.6, 0.6), 1.0, 600, np.array(others))
        assert verdict.status is Status.AMBIGUOUS
        assert 0.0 <= verdict.confidence < 0.5


def test_a_better_rival_lowers_the_confidence():
    for support in (150, 300, 600):
        confidences = [
            judge_overlap(2 * [support / 1000], 1.0, support, np.array([n])).confidence for n in range(0, support, 10)
        ]
        assert confidences == sorted(confidences, reverse=True)
        assert confidences[0] > 0.9
        assert confidences[-1] < 0.5


def test_the_confidence_is_above_one_half_where_the_answer_is_trusted():
    for support in (99, 100, 120, 200, 220, 500):
        for rival in range(0, support + 50, 3):
            verdict = judge_overlap(2 * [support / 1000], 1.0, support, np.array([rival]))
            assert (verdict.status is Status.OK) == (verdict.confidence >= 0.5)


@pytest.mark.parametrize("support", [0, 1, 90])
def test_little_overlap_is_not_trusted(support):
    for others in ([], [1]):
        verdict = judge_overlap(2 * [support / 1000], 1.0, support, np.array(others))
        assert (verdict.status, verdict.confidence) == (Status.LOW_SUPPORT, 0.0)


@pytest.mark.parametrize("shares", [(0.08, 0.41), (0.41, 0.08), (0.14, 0.3)])
def test_a_piece_of_one_cloud_that_meets_much_of_the_other_is_not_trusted(shares):
    verdict = judge_overlap(shares, 1.0, 1500, np.array([500]))
    assert (verdict.status, verdict.confidence) == (Status.LOW_SUPPORT, 0.0)


@pytest.mark.parametrize("shares", [(0.05, 0.8), (0.8, 0.05)])
def test_a_part_in_a_whole_is_trusted(shares):
    assert judge_overlap(shares, 1.0, 1500, np.array([500])).status is Status.OK


@pytest.mark.parametrize(("agreement", "trusted"), [(0.3, False), (0.39, False), (0.41, True), (0.8, True)])
def test_surfaces_that_meet_in_many_more_places_than_they_coincide_in_are_not_trusted(agreement, trusted):
    verdict = judge_overlap((0.3, 0.3), agreement, 1500, np.array([500]))
    assert verdict.status is (Status.OK if trusted else Status.LOW_SUPPORT)
    assert (verdict.confidence >= 0.5) == trusted


def test_less_agreement_lowers_the_confidence():
    confidences = [judge_overlap((0.6, 0.6), x, 600, np.array([])).confidence for x in (1.0, 0.7, 0.5, 0.41, 0.3, 0.0)]
    assert confidences == sorted(confidences, reverse=True)
    assert confidences[0] > 0.99
    assert confidences[-1] < 0.1
