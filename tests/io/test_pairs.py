import struct

import numpy as np
import pytest

from io_samples import npy, npz
from nonsac.io import read_pairs

ROWS = np.array([[1.0, 2, 3, 4, 5, 6], [7, 8, np.nan, 10, 11, 12]])


def check(source, target):
    for points, expected in ((source, ROWS[:, :3]), (target, ROWS[:, 3:])):
        assert points.dtype == np.float64
        assert points.flags.c_contiguous
        np.testing.assert_array_equal(points, expected)


@pytest.mark.parametrize("suffix", [".csv", ".txt", ".xyz"])
@pytest.mark.parametrize(
    "text",
    [
        "1 2 3 4 5 6\n7 8 nan 10 11 12\n",
        "# matched by hand\n1,2,3,4,5,6\n\n7,8,nan,10,11,12\n",
        "x1,y1,z1,x2,y2,z2\n1,2,3,4,5,6\n7,8,nan,10,11,12\n",
        "X2;Y2;Z2;score;Z1;Y1;X1\n4;5;6;good;3;2;1\n10;11;12;;nan;8;7\n",
    ],
)
def test_text(make_file, suffix, text):
    check(*read_pairs(make_file("a" + suffix, text)))


def test_npy(make_file):
    check(*read_pairs(make_file("a.npy", npy((2, 6), struct.pack("<12d", *ROWS.ravel())))))


@pytest.mark.parametrize("names", [("source", "target"), ("src", "tgt")])
def test_npz_by_name(make_file, names):
    members = {names[0]: ROWS[:, :3], names[1]: ROWS[:, 3:], "weights": [1, 2]}
    check(*read_pairs(make_file("a.npz", npz(**members))))


def test_npz_by_shape(make_file):
    check(*read_pairs(make_file("a.npz", npz(anything=ROWS, weights=[1, 2]))))


def test_two_clouds(make_file):
    source = make_file("a.xyz", "1 2 3\n7 8 nan\n")
    target = make_file("b.npy", npy((2, 3), struct.pack("<6d", *ROWS[:, 3:].ravel())))
    check(*read_pairs(source, target))


def test_two_clouds_of_different_length(make_file, refused):
    source, target = make_file("a.xyz", "1 2 3\n7 8 9\n"), make_file("b.xyz", "4 5 6\n")
    message = refused(read_pairs, source, target)
    assert f"holds 2 points and {target} holds 1" in message
    assert "use `nonsac register-clouds`" in message


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.csv", "1,2,3,4,5,6,7\n", "has 7 columns and no header, where pairs have six"),
        ("a.csv", "1,2,3\n", "has 3 columns and no header"),
        (
            "a.csv",
            "x1,y1,z1,x2,y2\n1,2,3,4,5\n",
            "the header names no z2; name the columns x1 y1 z1 x2 y2 z2",
        ),
        ("a.csv", "x1,y1,z1,x2,y2,z2\n1,2,3,4,5,6\n1,2,3,4,5\n", "line 3 has 5 columns where 6 are needed"),
        ("a.txt", "1 2 3 4 5 6\n1 2 3 4 5 six\n", "line 2: 'six' is not a number"),
        ("a.txt", "# nothing\n", "holds no pairs"),
        ("a.txt", "", "the file is empty"),
        ("a.npy", npy((6, 2), bytes(96)), "shape (6, 2) instead of (n, 6); transpose it"),
        ("a.npy", npy((2, 3), bytes(48)), "shape (2, 3) instead of (n, 6)"),
        (
            "a.npz",
            npz(p=np.ones((2, 3)), q=np.ones((2, 3))),
            "its keys are: p, q); save it under source/target or src/tgt",
        ),
        (
            "a.npz",
            npz(source=np.ones((2, 3)), target=np.ones((1, 3))),
            "holds 2 source points and 1 target points",
        ),
        (
            "a.ply",
            "ply\n",
            "this format is for one cloud, not for pairs; give the target cloud as the second file",
        ),
        ("a.doc", "1 2 3 4 5 6\n", "unknown suffix '.doc'"),
    ],
)
def test_bad_pairs(make_file, refused, name, content, expected):
    assert expected in refused(read_pairs, make_file(name, content))


def test_missing_files(tmp_path, make_file, refused):
    assert "no such file" in refused(read_pairs, tmp_path / "none.npy")
    assert "no such file" in refused(read_pairs, tmp_path / "none.ply", make_file("b.xyz", "1 2 3\n"))
