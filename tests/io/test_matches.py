import re
import struct
import subprocess
import sys

import numpy as np
import pytest

from io_samples import npy, npz
from match_samples import PAIRS, POINTS, WEIGHTS, K, parquet
from nonsac.io import read_matches, read_points


def check(first, second, rows, weights, expected_weights):
    for points, expected in ((first, rows[:, :2]), (second, rows[:, 2:])):
        assert points.dtype == np.float64
        assert points.flags.c_contiguous
        np.testing.assert_array_equal(points, expected)
    if expected_weights is None:
        assert weights is None
    else:
        assert weights.dtype == np.float64
        np.testing.assert_array_equal(weights, expected_weights)


def check_matches(path, weights=None):
    matches = read_matches(path)
    check(matches.points1, matches.points2, PAIRS, matches.weights, weights)
    assert len(matches) == 2
    assert matches.indices is None
    return matches


def check_points(path, weights=None):
    matches = read_points(path)
    check(matches.points2d, matches.points3d, POINTS, matches.weights, weights)
    assert len(matches) == 2
    return matches


@pytest.mark.parametrize("suffix", [".csv", ".txt", ".xyz"])
@pytest.mark.parametrize(
    ("text", "weights"),
    [
        ("1 2 3 4\n7 8 nan 10\n", None),
        ("1,2,3,4,.5\n7,8,nan,10,.25\n", WEIGHTS),
        ("# by hand\nx1,y1,x2,y2\n1,2,3,4\n\n7,8,nan,10\n", None),
        ("Y2;weight;X2;name;Y1;X1\n4;.5;3;good;2;1\n10;.25;nan;;8;7\n", WEIGHTS),
    ],
)
def test_matches_from_text(make_file, suffix, text, weights):
    matches = check_matches(make_file("a" + suffix, text), weights)
    assert matches.camera1 is None
    assert matches.camera2 is None


@pytest.mark.parametrize(
    ("text", "weights"),
    [
        ("1 2 3 4 5\n7 8 nan 10 11\n", None),
        ("1,2,3,4,5,.5\n7,8,nan,10,11,.25\n", WEIGHTS),
        ("u v X Y Z\n1 2 3 4 5\n7 8 nan 10 11\n", None),
        ("z,weight,y,v,u,x\n5,.5,4,2,1,3\n11,.25,10,8,7,nan\n", WEIGHTS),
    ],
)
def test_points_from_text(make_file, text, weights):
    assert check_points(make_file("a.csv", text), weights).camera is None


def test_npy(make_file):
    check_matches(make_file("a.npy", npy((2, 4), struct.pack("<8d", *PAIRS.ravel()))))
    check_points(make_file("a.npy", npy((2, 5), struct.pack("<10d", *POINTS.ravel()))))
    weighted = np.column_stack([PAIRS, WEIGHTS])
    check_matches(make_file("a.npy", npy((2, 5), struct.pack("<10d", *weighted.ravel()))), WEIGHTS)
    weighted = np.column_stack([POINTS, WEIGHTS]).astype(">f4")
    check_points(make_file("a.npy", npy((2, 6), weighted.tobytes(), ">f4")), WEIGHTS)


@pytest.mark.parametrize("names", [("points1", "points2"), ("x1", "x2")])
def test_matches_from_npz(make_file, names):
    parts = {names[0]: PAIRS[:, :2], names[1]: np.asfortranarray(PAIRS[:, 2:]), "R": np.eye(3), "all": PAIRS}
    assert check_matches(make_file("a.npz", npz(**parts))).camera1 is None
    parts |= {"weights": WEIGHTS, "camera1": "PINHOLE 640 480 500 510 320 240", "K2": K.astype(np.float32)}
    matches = check_matches(make_file("a.npz", npz(**parts)), WEIGHTS)
    assert matches.camera1 == "PINHOLE 640 480 500 510 320 240"
    np.testing.assert_array_equal(matches.camera2, K)
    assert matches.camera2.dtype == np.float64


@pytest.mark.parametrize("names", [("points2d", "points3d", "camera"), ("x", "X", "K")])
def test_points_from_npz(make_file, names):
    parts = {names[0]: POINTS[:, :2], names[1]: POINTS[:, 2:], "t": np.zeros(3), "weights": WEIGHTS}
    assert check_points(make_file("a.npz", npz(**parts)), WEIGHTS).camera is None
    np.testing.assert_array_equal(check_points(make_file("a.npz", npz(**parts, **{names[2]: K})), WEIGHTS).camera, K)


def test_npz_by_shape(make_file):
    check_matches(make_file("a.npz", npz(anything=PAIRS, R=np.eye(3), size=[1, 2])))
    matches = check_matches(make_file("a.npz", npz(anything=PAIRS, weights=WEIGHTS, K1=K)), WEIGHTS)
    np.testing.assert_array_equal(matches.camera1, K)
    assert matches.camera2 is None
    check_points(make_file("a.npz", npz(anything=np.column_stack([POINTS, WEIGHTS]))), WEIGHTS)


def test_values_that_are_never_needed_are_never_loaded(make_file):
    parts = {"x1": PAIRS[:, :2], "x2": PAIRS[:, 2:], "names": np.array([{}], dtype=object)}
    check_matches(make_file("a.npz", npz(**parts)))


def test_parquet(make_file):
    columns = {"name": ["a", "b"], "y2": [4, 10], "x2": [3.0, None], "x1": np.float32([1, 7]), "y1": [2, 8]}
    check_matches(make_file("a.parquet", parquet(**columns)))
    check_matches(make_file("a.parquet", parquet(**columns, weight=WEIGHTS)), WEIGHTS)
    columns = dict(zip(["u", "v", "X", "Y", "Z"], POINTS.T, strict=True))
    check_points(make_file("a.parquet", parquet(**columns, x=[0, 0])))
    columns = dict(zip(["u", "v", "x", "y", "z"], POINTS.T, strict=True))
    check_points(make_file("a.PARQUET", parquet(**columns, weight=WEIGHTS)), WEIGHTS)


def test_bad_parquet(make_file, refused):
    columns = dict(zip(["x1", "y1", "x2", "y2"], PAIRS.T, strict=True))
    whole = parquet(**columns)
    for content in (whole[:-1], whole[:-20], whole[: len(whole) // 2], whole[:4], whole[:40] + bytes(40) + whole[80:]):
        assert "is truncated or damaged" in refused(read_matches, make_file("a.parquet", content))
    text = parquet(**columns | {"x1": ["1", "2"]})
    assert "holds an array of type" in refused(read_matches, make_file("a.parquet", text))
    message = refused(read_matches, make_file("a.parquet", parquet(x1=[1], y1=[2], z=[3])))
    assert "the header names no x2, y2 (it names x1, y1, z); name the columns x1 y1 x2 y2" in message
    message = refused(read_matches, make_file("a.parquet", "x1,y1\n"))
    assert "is not a Parquet file, it looks like a text table" in message
    assert "holds no matches" in refused(
        read_matches, make_file("a.parquet", parquet(**{name: np.zeros(0) for name in columns}))
    )


def test_parquet_under_a_wrong_name(make_file, refused):
    message = refused(read_matches, make_file("a.csv", parquet(x1=[1.0])))
    assert "it looks like a Parquet file; if it is one, rename it to end in .parquet" in message


def test_pyarrow_missing(make_file, refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    message = refused(read_matches, make_file("a.parquet", b"PAR1"))
    assert message.endswith('reading Parquet files needs pyarrow; pip install "nonsac[parquet]"')


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.csv", "1,2,3\n", "has 3 columns and no header, where 4 are needed, or 5 with a weight; keep these"),
        ("a.csv", "1,2,3,4,5,6\n", "has 6 columns and no header"),
        ("a.csv", "x1,y1,x2\n1,2,3\n", "the header names no y2 (it names x1, y1, x2); name the columns x1 y1 x2 y2"),
        ("a.txt", "1 2 3 4\n1 2 3\n", "line 2 has 3 columns where 4 are needed"),
        ("a.txt", "x1 y1 x2 y2 weight\n1 2 3 4 high\n", "line 2: 'high' is not a number"),
        ("a.txt", "x1 y1 x2 y2\n", "holds no matches"),
        ("a.txt", "# nothing\n", "holds no matches"),
        ("a.txt", "", "the file is empty"),
        ("a.npy", npy((4, 2), bytes(64)), "shape (4, 2) instead of (n, 4); transpose it"),
        ("a.npy", npy((2, 6), bytes(96)), "shape (2, 6) instead of (n, 4)"),
        ("a.npy", npy((4,), bytes(32)), "shape (4,) instead of (n, 4)"),
        ("a.npy", npy((2, 4), bytes(63)), "truncated or damaged"),
        ("a.npy", npy((1, 4), bytes(64), "<c16"), "holds an array of type complex128"),
        ("a.npz", npz(a=PAIRS, b=PAIRS), "its keys are: a, b); save it under points1/points2 or x1/x2"),
        ("a.npz", npz(x1=np.ones((2, 3)), x2=np.ones((2, 2))), "shape (2, 3) instead of (n, 2)"),
        ("a.npz", npz(x1=np.ones((2, 2)), x2=np.ones((3, 2))), "parts of different lengths (2, 3); save one row"),
        ("a.npz", npz(x1=np.ones((2, 2)), x2=np.ones((2, 2)), weights=[1]), "parts of different lengths (1, 2)"),
        ("a.npz", npz(p=PAIRS, weights=[[1, 2]]), "the array weights has the shape (1, 2) and the type int64"),
        ("a.npz", npz(p=PAIRS, weights=["a", "b"]), "the array weights has the shape (2,) and the type <U1"),
        ("a.npz", npz(p=PAIRS, K1=np.ones((2, 2))), "the array K1 has the shape (2, 2) and the type float64; save"),
        ("a.npz", npz(p=PAIRS, K2=["PINHOLE"]), "the array K2 has the shape (1,)"),
        ("a.npz", npz(p=PAIRS, K1=np.array({})), "holds pickled objects, which are never loaded"),
        ("a.npz", npz(x1=np.zeros((0, 2)), x2=np.zeros((0, 2))), "holds no matches"),
        ("a.npz", npz(p=PAIRS)[:60], "truncated or damaged"),
        ("a.ply", "ply\n", "unknown suffix '.ply'; use one of .npz, .npy, .xyz, .txt, .csv, .asc, .pts, .parquet"),
        ("a.h5", b"\x89HDF\r\n\x1a\n", "give both files to nonsac.io.read_hloc"),
        ("a.db", b"SQLite format 3\x00", "holds the matches of many images; name two, as image1 and image2"),
    ],
)
def test_bad_matches(make_file, refused, name, content, expected):
    assert expected in refused(read_matches, make_file(name, content))


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.csv", "1,2,3,4\n", "has 4 columns and no header, where 5 are needed, or 6 with a weight"),
        ("a.csv", "u,v,x,y\n1,2,3,4\n", "the header names no z (it names u, v, x, y); name the columns u v X Y Z"),
        ("a.npz", npz(X=np.ones((2, 3)), x=np.ones((2, 3))), "shape (2, 3) instead of (n, 2)"),
        ("a.npz", npz(p=PAIRS), "save it under points2d/points3d or x/X"),
        ("a.npz", npz(p=POINTS, K=np.ones(4)), "the array K has the shape (4,)"),
        ("a.npy", npy((2, 4), bytes(64)), "shape (2, 4) instead of (n, 5)"),
    ],
)
def test_bad_points(make_file, refused, name, content, expected):
    assert expected in refused(read_points, make_file(name, content))


def test_images_of_tables(make_file, refused, tmp_path):
    path = make_file("a.csv", "1,2,3,4\n")
    assert "is not an SQLite database, it looks like a text table" in refused(read_matches, path, "a", "b")
    assert "name two, as image1 and image2" in refused(read_matches, path, "a")
    assert "is no model of COLMAP" in refused(read_points, path, "a")
    assert "a model holds many images; name one of them, as image" in refused(read_points, tmp_path)
    assert "is a folder" in refused(read_matches, tmp_path)
    assert "no such file" in refused(read_matches, tmp_path / "none.db", "a", "b")
    assert "no such file" in refused(read_points, tmp_path / "none.npz")
    assert "no such file" in refused(read_points, tmp_path / "none", "a")


def test_real_matches(data):
    paths = sorted((data / "strecha").glob("rel_*.npz"))
    for path in paths:
        matches, raw = read_matches(path), np.load(path)
        np.testing.assert_array_equal(matches.points1, raw["x1"])
        np.testing.assert_array_equal(matches.points2, raw["x2"])
        np.testing.assert_array_equal(matches.camera1, raw["K1"])
        np.testing.assert_array_equal(matches.camera2, raw["K2"])
    assert paths


def test_real_points(data):
    paths = sorted((data / "strecha").glob("pnp_*.npz"))
    for path in paths:
        matches, raw = read_points(path), np.load(path)
        np.testing.assert_array_equal(matches.points2d, raw["x"])
        np.testing.assert_array_equal(matches.points3d, raw["X"])
        np.testing.assert_array_equal(matches.camera, raw["K"])
    assert paths


def test_optional_libraries_are_imported_late():
    code = "import sys, nonsac.io; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"h5py", "pyarrow", "pycolmap", "torch"} & set(re.split(r"\s+", done.stdout))
