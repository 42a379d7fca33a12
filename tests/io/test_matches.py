import re
import struct
import subprocess
import sys

import numpy as np
import pytest

from io_samples import npy, npz
from match_samples import PAIRS, POINTS, WEIGHTS, K, parquet
from nonsac.io import InputError, read_matches, read_points


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
    message = refused(read_matches, make_file("a.parquet", text))
    assert "column 'x1' holds string, not numbers; save one column of numbers under this name" in message
    message = refused(read_matches, make_file("a.parquet", parquet(x1=[1], y1=[2], z=[3])))
    assert "rows of 3 columns (x1 y1 z), of which none is called x2 y2; rename the columns, or choose them" in message
    assert message.endswith("in the order of x1 y1 x2 y2")
    assert "holds no matches" in refused(
        read_matches, make_file("a.parquet", parquet(**{name: np.zeros(0) for name in columns}))
    )


def test_the_kind_of_a_table_is_that_of_its_content(make_file, refused):
    columns = dict(zip(["x1", "y1", "x2", "y2"], PAIRS.T, strict=True))
    check_matches(make_file("a.csv", parquet(**columns)))
    check_matches(make_file("a.parquet", "x1,y1,x2,y2\n1,2,3,4\n7,8,nan,10\n"))
    check_matches(make_file("a.doc", npy((2, 4), struct.pack("<8d", *PAIRS.ravel()))))
    check_points(make_file("a.npy", "1 2 3 4 5\n7 8 nan 10 11\n"))
    message = refused(read_matches, make_file("a.parquet", "x1,y1\n1,2\n"))
    assert "rows of 2 columns (x1 y1), of which none is called x2 y2" in message


@pytest.mark.parametrize("kind", ["arrow", "hdf5", "zarr", "folder"])
def test_tables_of_other_kinds(tmp_path, kind):
    table = np.column_stack([POINTS, WEIGHTS])
    columns = dict(zip(["u", "v", "X", "Y", "Z", "weight"], table.T, strict=True))
    if kind == "arrow":
        pytest.importorskip("pyarrow.feather").write_feather(
            pytest.importorskip("pyarrow").table(columns), str(tmp_path / "a")
        )
    elif kind == "hdf5":
        with pytest.importorskip("h5py").File(tmp_path / "a", "w") as file:
            file["rows"] = table
    elif kind == "zarr":
        pytest.importorskip("zarr").save_array(str(tmp_path / "a"), table)
    else:
        (tmp_path / "a").mkdir()
        for number in (0, 1):
            part = {name: column[[number]] for name, column in columns.items()}
            (tmp_path / "a" / f"{number}.parquet").write_bytes(parquet(**part))
    check_points(tmp_path / "a", WEIGHTS)


def test_pyarrow_missing(make_file, refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    message = refused(read_matches, make_file("a.parquet", b"PAR1"))
    assert message.endswith('reading Parquet and Arrow files needs pyarrow; pip install "nonsac[parquet]"')


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        (
            "a.csv",
            "1,2,3\n",
            "rows of 3 columns, not of 4 (x1 y1 x2 y2), or 5 with a weight; choose columns of a table that has all 4",
        ),
        (
            "a.csv",
            "1,2,3,4,5,6\n",
            "rows of 6 columns, not of 4 (x1 y1 x2 y2), or 5 with a weight; choose columns, or name them in a header "
            "line: x1 y1 x2 y2",
        ),
        (
            "a.csv",
            "x1,y1,x2\n1,2,3\n",
            "rows of 3 columns (x1 y1 x2), of which none is called y2; rename the columns, or choose them, by name or "
            "position (columns=, --columns), in the order of x1 y1 x2 y2",
        ),
        ("a.csv", "x1,y1,x2,y2\n1,2,3\n", "its header names 4 columns, its rows have 3; name every column, or remov"),
        ("a.txt", "1 2 3 4\n1 2 3\n", "line 2 has 3 columns where 4 are needed"),
        ("a.txt", "x1 y1 x2 y2 weight\n1 2 3 4 high\n", "line 2: 'high' is not a number"),
        ("a.txt", "x1 y1 x2 y2\n", "holds no matches"),
        ("a.txt", "# nothing\n", "the file holds no rows; export it again with its rows"),
        ("a.txt", "", "the file is empty"),
        (
            "a.npy",
            npy((4, 2), bytes(64)),
            "rows of 2 columns, not of 4 (x1 y1 x2 y2), or 5 with a weight; transpose it, one row per match",
        ),
        ("a.npy", npy((2, 6), bytes(96)), "rows of 6 columns, not of 4 (x1 y1 x2 y2), or 5 with a weight; choose colu"),
        ("a.npy", npy((4,), bytes(32)), "shape (4,) instead of (n, D)"),
        ("a.npy", npy((2, 4), bytes(63)), "the file is truncated: its header promises 2 array rows, it holds 1"),
        ("a.npy", npy((1, 4), bytes(64), "<c16"), "holds an array of type complex128"),
        ("a.npz", npz(a=PAIRS, b=PAIRS), "its keys are: a, b); save it under points1/points2 or x1/x2"),
        ("a.npz", npz(x1=np.ones((2, 3)), x2=np.ones((2, 2))), "shape (2, 3) instead of (n, 2)"),
        ("a.npz", npz(x1=np.ones((2, 2)), x2=np.ones((3, 2))), "its arrays have 2 and 3 rows, which should mat"),
        ("a.npz", npz(x1=np.ones((2, 2)), x2=np.ones((3, 2))), "match one by one; save one row of each for every matc"),
        (
            "a.npz",
            npz(x1=np.ones((2, 2)), x2=np.ones((2, 2)), weights=[1]),
            "the array weights has the shape (1,) and the type int64; save one number for every match",
        ),
        ("a.npz", npz(p=PAIRS, weights=[[1, 2]]), "the array weights has the shape (1, 2) and the type int64"),
        ("a.npz", npz(p=PAIRS, weights=["a", "b"]), "the array weights has the shape (2,) and the type <U1"),
        ("a.npz", npz(p=PAIRS, K1=np.ones((2, 2))), "the array K1 has the shape (2, 2) and the type float64; save"),
        ("a.npz", npz(p=PAIRS, K2=["PINHOLE"]), "the array K2 has the shape (1,)"),
        ("a.npz", npz(p=PAIRS, K1=np.array({})), "holds pickled objects, which are never loaded"),
        ("a.npz", npz(x1=np.zeros((0, 2)), x2=np.zeros((0, 2))), "holds no matches"),
        ("a.npz", npz(p=PAIRS)[:60], "truncated or damaged"),
        (
            "a.ply",
            "ply\n",
            "is no table of rows, it looks like a PLY file; give one of Parquet file, Arrow file, NumPy",
        ),
        ("a.h5", b"\x89HDF\r\n\x1a\n", "give both files, to nonsac.io.read_hloc say (or, for rows of another HDF5"),
        ("a.db", b"SQLite format 3\x00", "holds the matches of many images; name two, as image1 and image2"),
        ("a.sqlite", b"SQLite format 3\x00", "holds the matches of many images; name two, as image1 and image2"),
    ],
)
def test_bad_matches(make_file, refused, name, content, expected):
    assert expected in refused(read_matches, make_file(name, content))


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        (
            "a.csv",
            "1,2,3,4\n",
            "rows of 4 columns, not of 5 (u v X Y Z), or 6 with a weight; choose columns of a table",
        ),
        ("a.csv", "u,v,x,y\n1,2,3,4\n", "rows of 4 columns (u v x y), of which none is called Z; rename the columns"),
        ("a.npz", npz(X=np.ones((2, 3)), x=np.ones((2, 3))), "shape (2, 3) instead of (n, 2)"),
        ("a.npz", npz(p=PAIRS), "save it under points2d/points3d or x/X"),
        ("a.npz", npz(p=POINTS, K=np.ones(4)), "the array K has the shape (4,)"),
        ("a.npy", npy((2, 4), bytes(64)), "rows of 4 columns, not of 5 (u v X Y Z), or 6 with a weight; choose colu"),
    ],
)
def test_bad_points(make_file, refused, name, content, expected):
    assert expected in refused(read_points, make_file(name, content))


def test_images_of_tables(make_file, refused, tmp_path):
    path = make_file("a.csv", "1,2,3,4\n")
    assert "is not an SQLite database, it looks like a text table" in refused(read_matches, path, "a", "b")
    assert "matches are those of two images; name two, as image1 and image2" in refused(read_matches, path, "a")
    assert "name two, as image1 and image2" in refused(read_matches, path, None, "b")
    assert "is no model of COLMAP" in refused(read_points, path, "a")
    assert "a model holds many images; name one of them, as image" in refused(read_points, tmp_path)
    with pytest.raises(InputError, match=r"a\.csv: is neither a Parquet nor an Arrow file; give Parquet, Arrow or"):
        read_matches(tmp_path)
    (tmp_path / "empty").mkdir()
    assert "the folder holds no files; put files into it that end in .parquet" in refused(
        read_matches, tmp_path / "empty"
    )
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
