import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nonsac.io import read_transform, read_truth, write_transform

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


def test_a_truth_may_be_kept_with_the_data(tmp_path, make_file):
    T = np.vstack([np.arange(12.0).reshape(3, 4), [0, 0, 0, 1]])
    write_transform(tmp_path / "T.txt", T)
    np.savez(tmp_path / "T.npz", T=T, other=np.eye(4))
    np.savez(tmp_path / "parts.npz", R=T[:3, :3], t=T[:3, 3:], x1=np.zeros((9, 2)))
    np.savez(tmp_path / "only.npz", T_tgt_src=T, src=np.zeros((9, 3)))
    make_file("T.json", f'{{"rows": 9, "T": {T.tolist()}}}')
    for name in ("T.txt", "T.npz", "parts.npz", "only.npz", "T.json"):
        np.testing.assert_array_equal(read_truth(tmp_path / name), T)


def test_files_without_a_truth_are_refused(tmp_path, make_file, refused):
    np.savez(tmp_path / "two.npz", a=np.eye(4), b=np.eye(4))
    np.savez(tmp_path / "odd.npz", R=np.eye(2), t=np.zeros(3))
    assert "holds no transform" in refused(read_truth, tmp_path / "two.npz")
    assert "R has the shape (2, 2)" in refused(read_truth, tmp_path / "odd.npz")
    for text in ("", "[1]", '{"T": 1}', '{"R": []}', '{"T": [["a"]]}', "\xff"):
        message = refused(read_truth, make_file("a.json", text))
        assert "holds no JSON with the matrix T" in message or "four rows and columns" in message
    refused(read_truth, tmp_path / "missing.json")
    refused(read_truth, tmp_path / "missing.npz")
