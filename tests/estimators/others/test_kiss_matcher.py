"""KISS-Matcher's solver as a core."""

import numpy as np
import pytest

from nonsac import Registration
from others_samples import NOISE, SEEDS, found, planted, solved

kiss_matcher = pytest.importorskip("kiss_matcher", reason="needs the extra kiss-matcher")


def directly(rows):
    """KISS-Matcher as its users call it, with a bound of our five standard deviations."""
    matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(5.0 * NOISE["Registration"]))
    answer = matcher.solve(rows[:, :3].T, rows[:, 3:].T)
    return np.column_stack([answer.rotation, np.ravel(answer.translation)])


def test_it_solves_as_much_as_the_library_itself():
    own = others = 0
    for seed in range(SEEDS):
        rows, truth = planted("Registration", 0.8, seed)
        own += solved(found("kiss-matcher", "Registration", rows).model, "Registration", truth)
        others += solved(directly(rows), "Registration", truth)
    assert own >= others
    assert own == SEEDS


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e3, 1e6])
def test_the_unit_does_not_matter(unit):
    """It refuses small bounds itself, and clamps large ones."""
    rows, truth = planted("Registration", 0.8, 0)
    model = found("kiss-matcher", "Registration", unit * rows, sigma=0.01 * unit).model
    assert solved(model, "Registration", truth)
    np.testing.assert_allclose(model[:, 3], unit * truth[:3, 3], atol=0.1 * unit)


def test_a_map_far_away_is_no_trouble():
    rows, truth = planted("Registration", 0.8, 0)
    rows[:, :3] += [5e6, 6e6, 100.0]
    assert solved(found("kiss-matcher", "Registration", rows).model, "Registration", truth)


def test_a_known_scale_is_known():
    rows, truth = planted("Registration", 0.8, 0)
    rows[:, :3] /= 2.5
    model = found("kiss-matcher", "Registration", rows, problem=Registration(2.5)).model
    assert solved(model, "Registration", truth)
    assert np.cbrt(np.linalg.det(model[:, :3])) == pytest.approx(2.5)
    np.testing.assert_allclose(model[:, 3], truth[:3, 3], atol=0.1)


def test_rows_that_would_end_the_process_are_kept_from_it():
    rows, truth = planted("Registration", 0.5, 0)
    rows[-5:] *= 1e150
    assert solved(found("kiss-matcher", "Registration", rows).model, "Registration", truth)
