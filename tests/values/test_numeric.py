"""Numbers of any type, for all settings; what is none is refused in one short line that names the setting."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

import nonsac
from nonsac import simulate
from nonsac.estimators import Pcr99
from nonsac.values.numeric import as_real, as_whole, shown

PAIRS = simulate.registration(60, 0.3, 0.01, 0)
NONE = [True, np.True_, "7", b"7", 1j, Decimal(7), [7], np.array([7]), float("nan")]
SETTINGS = ["noise", "samples", "sample_size", "max_samples", "time_limit", "max_memory", "rng", "scale"]


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int16, np.uint64, int])
def test_whole_numbers_of_any_type(kind):
    assert type(as_whole(kind(7))) is int
    assert as_whole(kind(7)) == as_real(kind(7)) == 7
    settings = {"samples": 3, "sample_size": 30, "max_samples": 5, "workers": 1, "rng": 4}
    expected = nonsac.register_pairs(PAIRS.source, PAIRS.target, max_memory="10 MB", **settings)
    odd = {name: kind(value) for name, value in settings.items()}
    found = nonsac.register_pairs(PAIRS.source, PAIRS.target, max_memory="10 MB", **odd)
    np.testing.assert_array_equal(found.T, expected.T)


@pytest.mark.parametrize("kind", [np.int8, np.uint64])
def test_counts_of_any_type(kind):
    source = nonsac.ArraySource(np.zeros((9, 6)))
    assert nonsac.plan(source, samples=kind(100), sample_size=kind(100)) == nonsac.plan(
        source, samples=100, sample_size=100
    )
    made = simulate.registration(kind(100), 0.3, 0.01, kind(0))
    np.testing.assert_array_equal(made.source, simulate.registration(100, 0.3, 0.01, 0).source)
    assert len(simulate.demo_scans(0, points=kind(100)).source) == len(simulate.demo_scans(0, points=100).source)
    assert Pcr99(max_drawn=kind(100)).with_budget(1000).max_drawn == 100_000


@pytest.mark.parametrize("value", [*NONE, None], ids=str)
def test_what_is_no_number(value):
    assert np.isnan(as_real(value))
    assert as_whole(value) is None


def test_numbers_of_other_libraries_and_sizes():
    assert as_real(10**400) == np.inf
    assert as_real(-(10**400)) == -np.inf
    assert as_real(Fraction(1, 2)) == as_real(np.float16(0.5)) == 0.5


def test_what_came_is_shown_on_one_short_line():
    for value in ("x" * 10**5, 10**400, np.zeros(10**5), "a\nb"):
        assert len(shown(value)) < 90
        assert "\n" not in shown(value)
    assert shown(10**5000) == "a number of 16610 bits"


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("value", [*NONE, -1, "x" * 10**5], ids=lambda value: str(value)[:9])
def test_wrong_settings_are_refused_in_a_line(name, value):
    if name == "max_memory" and value == "7":  # bytes
        return
    with pytest.raises(ValueError, match=f"^{name} must be") as refusal:
        nonsac.register_pairs(PAIRS.source, PAIRS.target, **{name: value})
    assert len(str(refusal.value)) < 300


@pytest.mark.parametrize("name", ["noise", "time_limit", "max_memory", "scale"])
@pytest.mark.parametrize("power", [400, 5000])
def test_numbers_beyond_all_bounds_are_refused(name, power):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        nonsac.register_pairs(PAIRS.source, PAIRS.target, **{name: 10**power})


@pytest.mark.parametrize("name", ["tolerance", "enough_inliers", "min_valid", "max_valid", "max_drawn"])
@pytest.mark.parametrize("value", [True, "7", -1, float("nan")])
def test_wrong_options_of_pcr99_are_refused_by_name(name, value):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        Pcr99(**{name: value})


@pytest.mark.parametrize("name", ["n", "outlier_ratio", "noise", "scale"])
@pytest.mark.parametrize("value", [True, "7", -1, float("nan"), None])
def test_wrong_options_of_simulations_are_refused_by_name(name, value):
    options = {"n": 10, "outlier_ratio": 0.3, "noise": 0.01, "rng": 0} | {name: value}
    with pytest.raises(ValueError, match=f"^{name} is .*; expected"):
        simulate.registration(**options)
