import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nonsac.io import read_transform, write_transform

finite = st.floats(allow_nan=False, allow_infinity=False, width=64)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arrays(np.float64, (4, 4), elements=finite))
def test_round_trip_keeps_every_bit(tmp_path, transform):
    path = tmp_path / "transform.txt"
    write_transform(path, transform)
    assert read_transform(path).tobytes() == transform.tobytes()
    assert os.listdir(tmp_path) == ["transform.txt"]


def test_form(tmp_path):
    transform = np.eye(4)
    transform[:3, 3] = [0.1, -2, 1e300]
    write_transform(tmp_path / "t.mat", transform)
    expected = "1 0 0 0.10000000000000001\n0 1 0 -2\n0 0 1 1.0000000000000001e+300\n0 0 0 1\n"
    assert (tmp_path / "t.mat").read_text() == expected


def test_reads_what_others_write(make_file):
    expected = np.vstack([np.arange(12.0).reshape(3, 4), [0, 0, 0, 1]])
    for text in ("0 1 2 3\n4 5 6 7\n8 9 10 11\n0 0 0 1", "# T\n0,1,2,3\n4,5,6,7\n\n8,9,10,11\n0,0,0,1.0\n"):
        np.testing.assert_array_equal(read_transform(make_file("t", text)), expected)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n", "shape (3, 4); give four lines of four numbers"),
        ("1 0 0\n0 1 0\n0 0 1\n", "shape (3, 3)"),
        ("1 0 0 0\n0 1 0 0\n0 0 1\n0 0 0 1\n", "line 3 has 3 columns where 4 are needed"),
        ("1 0 0 0\n0 1 0 0\n0 0 1 zero\n0 0 0 1\n", "line 3: 'zero' is not a number"),
        ("1 0 0 0\n0 1 0 0\n0 0 1 nan\n0 0 0 1\n", "not finite"),
        ("a b c d\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "its first line holds no numbers"),
        ("# nothing\n", "shape (0, 1)"),
        ("", "the file is empty"),
        (b"\x93NUMPY", "it looks like a NumPy array"),
    ],
)
def test_bad_files(make_file, refused, text, expected):
    assert expected in refused(read_transform, make_file("t.txt", text))


def test_bad_matrices(tmp_path, refused):
    assert "shape (3, 3)" in refused(write_transform, tmp_path / "t.txt", np.eye(3))
    assert "not finite" in refused(write_transform, tmp_path / "t.txt", np.full((4, 4), np.inf))
    assert os.listdir(tmp_path) == []
