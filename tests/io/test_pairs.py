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


@pytest.mark.parametrize("suffix", [".csv", ".txt", ".xyz", ".doc", ""])
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
        (
            "a.csv",
            "1,2,3,4,5,6,7,8\n",
            "rows of 8 columns, not of 6 (x1 y1 z1 x2 y2 z2), or 7 with a weight; choose columns, or name them in a "
            "header line: x1 y1 z1 x2 y2 z2",
        ),
        ("a.csv", "1,2,3\n", "rows of 3 columns, not of 6 (x1 y1 z1 x2 y2 z2), or 7 with a weight; choose columns of"),
        (
            "a.csv",
            "x1,y1,z1,x2,y2\n1,2,3,4,5\n",
            "rows of 5 columns (x1 y1 z1 x2 y2), of which none is called z2; rename the columns, or choose them, by "
            "name or position (columns=, --columns), in the order of x1 y1 z1 x2 y2 z2",
        ),
        ("a.csv", "x1,y1,z1,x2,y2,z2\n1,2,3,4,5,6\n1,2,3,4,5\n", "line 3 has 5 columns where 6 are needed"),
        ("a.txt", "1 2 3 4 5 6\n1 2 3 4 5 six\n", "line 2: 'six' is not a number"),
        ("a.txt", "# nothing\n", "the file holds no rows; export it again with its rows"),
        ("a.txt", "x1 y1 z1 x2 y2 z2\n", "the file holds no matches; export it again with its matches"),
        ("a.txt", "", "the file is empty"),
        (
            "a.npy",
            npy((6, 2), bytes(96)),
            "rows of 2 columns, not of 6 (x1 y1 z1 x2 y2 z2), or 7 with a weight; transpose it, one row per match",
        ),
        ("a.npy", npy((2, 3), bytes(48)), "rows of 3 columns, not of 6 (x1 y1 z1 x2 y2 z2), or 7 with a weight"),
        (
            "a.npz",
            npz(p=np.ones((2, 3)), q=np.ones((2, 3))),
            "its keys are: p, q); save it under source/target or src/tgt",
        ),
        (
            "a.npz",
            npz(source=np.ones((2, 3)), target=np.ones((1, 3))),
            "its arrays have 2 and 1 rows, which should match one by one; save one row of each for every match; for "
            "unmatched clouds use `nonsac register-clouds`",
        ),
        ("a.ply", "ply\n", "this format is for one cloud, not for pairs; give the target as the second file"),
        ("a.LAZ", "1 2 3\n", "this format is for one cloud, not for pairs; give the target as the second file"),
        ("a.bin", "LASF", "this format is for one cloud, not for pairs; give the target as the second file"),
        ("a.doc", b"\x00\x01", "is no table of rows, it looks like an unknown binary file; give one of Parquet file,"),
    ],
)
def test_bad_pairs(make_file, refused, name, content, expected):
    assert expected in refused(read_pairs, make_file(name, content))


def test_missing_files(tmp_path, make_file, refused):
    assert "no such file" in refused(read_pairs, tmp_path / "none.npy")
    assert "no such file" in refused(read_pairs, tmp_path / "none.ply", make_file("b.xyz", "1 2 3\n"))
