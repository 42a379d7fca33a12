"""What is no number, array, list or name is refused with the argument's name."""

import math

import numpy as np
import pytest

from nonsac.values import checks


@pytest.mark.parametrize("value", [[[1, 2], [3]], "abc", None, [1j], np.zeros(3, "M8[s]"), object(), [None]])
def test_no_real_array(value):
    with pytest.raises((TypeError, ValueError), match=r"^points "):
        checks.real_array("points", value)


def test_real_array():
    masked = np.ma.masked_array([1, 2], mask=[False, True])
    np.testing.assert_array_equal(checks.real_array("a", masked), [1, np.nan])
    for given in ([1, 2.5], np.array([1, 2.5], np.float32), np.array([1, 2.5], ">f8")):
        found = checks.real_array("a", given)
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, [1, 2.5])


@pytest.mark.parametrize("value", ["1", None, 1j, -1, 2.5, math.nan, 10**400])
def test_no_number(value):
    with pytest.raises(ValueError, match=r"^noise is .*; expected a share$"):
        checks.number("noise", value, 0.0, 2.0, "a share")


def test_numbers():
    found = checks.number("noise", np.float16(0.5), 0.0, 1.0, "a share")
    assert found == 0.5
    assert type(found) is float


def test_whole_numbers():
    found = checks.whole_number("count", np.int8(7), 1)
    assert found == 7
    assert type(found) is int
    for value, error in ((1.0, TypeError), (True, TypeError), ("1", TypeError), (0, ValueError), (10**30, ValueError)):
        with pytest.raises(error, match=r"^count is .*; expected an integer from 1 to 100$"):
            checks.whole_number("count", value, 1, 100)


@pytest.mark.parametrize("value", ["abc", b"abc", 3, None, np.array(3)])
def test_no_list(value):
    with pytest.raises(TypeError, match=r"^names must be some words, got "):
        checks.listed("names", value, "some words")


def test_names_of_files(tmp_path):
    assert checks.file_name("path", tmp_path) == str(tmp_path)
    for value, error in ((3, TypeError), (b"a", TypeError), (None, TypeError), ("", ValueError)):
        with pytest.raises(error, match=r"^path is "):
            checks.file_name("path", value)
