import os
import pickle
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from io_samples import npy, npz
from nonsac.io import read_cloud, write_cloud
from nonsac.io.clouds import READERS, WRITERS

EXPECTED = np.array([[1.0, 2.5, -3.0], [4.0, np.nan, 6.0]])
PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".csv", ".asc", ".pts"])
@pytest.mark.parametrize(
    "text",
    [
        "1 2.5 -3\n4 nan 6\n",
        "1,2.5,-3\n4,nan,6",
        "1;2.5;-3\r\n4;nan;6\r\n",
        "\ufeff1\t2.5\t-3\n\n  4\tnan\t6  \n",
        "# made by hand\n//X Y Z\n1, 2.5, -3 # first\n4, nan, 6\n",
        "x y z\n1 2.5 -3\n4 nan 6\n",
        "x,y,z,label\n1,2.5,-3,tree\n4,nan,6,\n",
        '"Z";"id";"X";"Y"\n-3;0;1;2.5\n6;1;4;NaN\n',
        "2\n1 2.5 -3 255 0 0\n4 nan 6 255 0 0\n",
    ],
)
def test_text(make_file, suffix, text):
    points = read_cloud(make_file("a" + suffix, text))
    assert points.dtype == np.float64
    assert points.flags.c_contiguous
    np.testing.assert_array_equal(points, EXPECTED)


def test_one_point_and_latin_comment(make_file):
    path = make_file("a.xyz", b"# 5 \xb0C\n1 2 inf\n")
    np.testing.assert_array_equal(read_cloud(path), [[1, 2, np.inf]])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 2 3\n# note\n4 five 6\n", "line 3: 'five' is not a number"),
        ("x,y,z\n1,2,3\n\n4,,6\n", "line 4: '' is not a number"),
        ("1 2 3\n4 5\n", "line 2 has 2 columns where 3 are needed"),
        ("1 2\n3 4\n", "line 1 has 2 columns where 3 are needed"),
        ("1,5;2,5;3,5\n", "line 1: '1,5' is not a number; correct this line (decimals take a point"),
        ("1 2 3a\n", "line 1: '3a' is not a number"),
        ("x y intensity\n1 2 3\n", "the header names no z (it names x, y, intensity)"),
        ("3\n1 2 3\n4 5 6\n", "truncated: its header promises 3 point rows, it holds 2"),
        ("a,b,c,label\n1,2,3,tree\n", "names no x, y, z (it names a, b, c, label); name the coordinates x, y and z"),
        ("x y z\n", "holds no points"),
        ("# only a comment\n", "holds no points"),
        ("\n", "holds no points"),
    ],
)
def test_bad_text(make_file, refused, text, expected):
    assert expected in refused(read_cloud, make_file("a.txt", text))


@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", "<i4", "|u1", "<u8"])
def test_npy(make_file, kind):
    body = np.array([[1, 2, 3], [4, 5, 6]]).astype(kind).tobytes()
    points = read_cloud(make_file("a.npy", npy((2, 3), body, kind)))
    assert points.dtype == np.float64
    assert points.flags.c_contiguous
    np.testing.assert_array_equal(points, [[1, 2, 3], [4, 5, 6]])


def test_npy_in_fortran_order(make_file):
    content = npy((2, 3), struct.pack("<6d", 1, 4, 2, 5, 3, 6)).replace(b"False", b"True ")
    points = read_cloud(make_file("a.npy", content))
    assert points.flags.c_contiguous
    np.testing.assert_array_equal(points, [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (npy((3, 2), bytes(48)), "shape (3, 2) instead of (n, 3); transpose it before saving"),
        (npy((2, 4), bytes(64)), "shape (2, 4) instead of (n, 3); save one point per row"),
        (npy((6,), bytes(48)), "shape (6,) instead of (n, 3)"),
        (npy((), bytes(8)), "shape () instead of (n, 3)"),
        (npy((0, 3), b""), "holds no points"),
        (npy((2, 3), bytes(47)), "truncated or damaged"),
        (npy((2, 3), bytes(24)), "truncated or damaged"),
        (npy((2, 3), b""), "truncated or damaged"),
        (npy((2, 3), bytes(48))[:20], "truncated or damaged"),
        (npy((2, 3), bytes(48), "<c16"), "truncated or damaged"),
        (npy((2, 3), bytes(96), "<c16"), "holds an array of type complex128"),
        (npy((2, 3), bytes(6), "|b1"), "holds an array of type bool"),
        (npy((2, 3), bytes(24), "<U1"), "holds an array of type <U1"),
    ],
)
def test_bad_npy(make_file, refused, content, expected):
    assert expected in refused(read_cloud, make_file("a.npy", content))


class Trap:
    def __reduce__(self):
        return eval, ("1 / 0",)


def test_pickles_are_never_loaded(make_file, refused):
    body = pickle.dumps(np.array([Trap()], dtype=object))
    path = make_file("a.npy", npy((1,), body, "|O"))
    assert "holds pickled objects, which are never loaded" in refused(read_cloud, path)
    archive = make_file("a.npz", npz(points=np.array([Trap()], dtype=object)))
    assert "holds pickled objects" in refused(read_cloud, archive)


def test_npz(make_file):
    points, other = np.arange(6.0).reshape(2, 3), np.ones((4, 3))
    for members in (
        {"points": points, "xyz": other},
        {"xyz": points, "more": other},
        {"p": points, "n": [1, 2]},
    ):
        np.testing.assert_array_equal(read_cloud(make_file("a.npz", npz(**members))), points)


def test_bad_npz(make_file, refused):
    two = make_file("a.npz", npz(first=np.ones((2, 3)), second=np.ones((2, 3))))
    message = refused(read_cloud, two)
    assert "its keys are: first, second" in message
    assert "save it under points or xyz" in message
    assert "its keys are: a" in refused(read_cloud, make_file("a.npz", npz(a=np.ones(5))))
    assert "its keys are: none" in refused(read_cloud, make_file("a.npz", npz()))
    text = make_file("a.npz", npz(a=np.ones(5)).replace(b"a.npy", b"a.txt"))
    assert "its keys are: a.txt" in refused(read_cloud, text)
    turned = make_file("a.npz", npz(points=np.ones((3, 5))))
    assert "transpose" in refused(read_cloud, turned)
    whole = npz(points=np.ones((50, 3)))
    for content in (
        whole[:-30],
        whole[:100],
        whole.replace(bytes(7) + b"\x3f", bytes(6) + b"\x09\x3f"),
        whole[:4],
    ):
        path = make_file("a.npz", content.replace(b"\xf0\x3f", b"\xf1\x3f", 1))
        assert "truncated or damaged" in refused(read_cloud, path)


@pytest.mark.parametrize("suffix", READERS)
def test_files_that_are_not_what_they_say(make_file, refused, suffix):
    assert "it looks like a PNG image; give a point cloud file" in refused(read_cloud, make_file("a" + suffix, PNG))
    assert "the file is empty" in refused(read_cloud, make_file("a" + suffix, b""))
    noise = refused(read_cloud, make_file("a" + suffix, bytes(range(256))))
    assert "it looks like an unknown binary file" in noise


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        (
            "a.npy",
            "1 2 3\n",
            "is not a NumPy array, it looks like a text table; if it is one, rename it to end in .xyz",
        ),
        ("a.ply", npy((1, 3), bytes(24)), "is not a PLY file, it looks like a NumPy array"),
        (
            "a.npy",
            npz(points=np.ones((1, 3))),
            "it looks like a NumPy archive; if it is one, rename it to end in .npz",
        ),
        ("a.txt", "ply\nformat ascii 1.0\n", "it looks like a PLY file"),
        ("a.xyz", "# .PCD v.7\nVERSION .7\n", "it looks like a PCD file"),
        ("a.pcd", "ply\n", "is not a PCD file, it looks like a PLY file"),
        ("a.ply", b"LASF", "it looks like a LAS file"),
        ("a.csv", "1 2 3\n".encode("utf-16"), "it looks like a UTF-16 text; save it as UTF-8 text"),
    ],
)
def test_wrong_suffixes(make_file, refused, name, content, expected):
    assert expected in refused(read_cloud, make_file(name, content))


def test_paths_that_cannot_be_read(tmp_path, refused, make_file, monkeypatch):
    assert "no such file; check the path" in refused(read_cloud, tmp_path / "none.ply")
    assert "is a folder" in refused(read_cloud, tmp_path)
    (tmp_path / "folder.ply").mkdir()
    assert "is a folder" in refused(read_cloud, tmp_path / "folder.ply")
    message = refused(read_cloud, make_file("a.stl", b"solid"))
    assert (
        "unknown suffix '.stl'; use one of .ply, .pcd, .xyz, .txt, .csv, .asc, .pts, .npy, .npz, .las, .laz" in message
    )
    assert "the file name has no suffix" in refused(read_cloud, make_file("cloud", b"1 2 3"))

    def deny(_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", deny)
    assert "permission denied; make the file readable" in refused(read_cloud, make_file("a.ply", b"ply\n"))


@pytest.mark.parametrize("suffix", [suffix for suffix in READERS if suffix not in (".las", ".laz")])
def test_files_that_no_memory_holds(make_file, refused, suffix):
    """The first bytes are looked at before all are read."""
    path = make_file("a" + suffix, b"")
    with path.open("r+b") as file:
        file.truncate(1 << 42)
    assert "it looks like an unknown binary file" in refused(read_cloud, path)


def test_text_that_no_memory_holds(make_file, refused, monkeypatch):
    def fill(_):
        raise MemoryError

    monkeypatch.setattr(Path, "read_bytes", fill)
    path = make_file("a.csv", "1 2 3\n")
    assert "is larger than the memory there is; save it as Parquet or .npy" in refused(read_cloud, path)


def test_a_structured_array_names_its_columns(tmp_path, refused):
    rows = np.zeros(2, [(name, "f4") for name in ("i", "Z", "y", "x")])
    rows["x"], rows["y"], rows["Z"] = (1, 4), (2, 5), (3, 6)
    np.save(tmp_path / "a.npy", rows)
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.npy"), [[1, 2, 3], [4, 5, 6]])
    np.save(tmp_path / "b.npy", rows[["i", "y", "x"]].copy())
    assert "the header names no z (it names i, y, x)" in refused(read_cloud, tmp_path / "b.npy")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may read everything")
def test_unreadable_permissions(make_file, refused):
    path = make_file("a.xyz", "1 2 3\n")
    path.chmod(0)
    assert "permission denied" in refused(read_cloud, path)


doubles = st.floats(allow_nan=True, allow_infinity=True, width=64)
clouds = arrays(np.float64, st.tuples(st.integers(1, 8), st.just(3)), elements=doubles)


@pytest.mark.parametrize("suffix", [*WRITERS, ".PLY", ".NPY", ".NPZ"])
@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(points=clouds)
def test_round_trip_is_exact(tmp_path, suffix, points):
    path = tmp_path / f"a{suffix}"
    write_cloud(path, points)
    again = read_cloud(path)
    np.testing.assert_array_equal(again, points)
    finite = np.isfinite(points)
    np.testing.assert_array_equal(np.signbit(again[finite]), np.signbit(points[finite]))
    assert os.listdir(tmp_path) == [path.name]


def test_written_bytes(tmp_path):
    points = [[1, 2, 0.1]]
    expected = {
        ".xyz": b"1 2 0.10000000000000001\n",
        ".txt": b"1 2 0.10000000000000001\n",
        ".csv": b"x,y,z\n1,2,0.10000000000000001\n",
    }
    for suffix, content in expected.items():
        write_cloud(tmp_path / f"a{suffix}", points)
        assert (tmp_path / f"a{suffix}").read_bytes().replace(b"\r\n", b"\n") == content
    for suffix in (".ply", ".pcd"):
        write_cloud(tmp_path / f"a{suffix}", np.array(points, order="F"))
        assert (tmp_path / f"a{suffix}").read_bytes().endswith(b"\n" + struct.pack("<3d", 1, 2, 0.1))


def test_other_readers_agree_on_what_is_written(tmp_path, rng):
    points = rng.normal(size=(20, 3))
    write_cloud(tmp_path / "a.ply", points)
    trimesh = pytest.importorskip("trimesh")
    np.testing.assert_array_equal(trimesh.load(tmp_path / "a.ply", process=False).vertices, points)
    write_cloud(tmp_path / "a.pcd", points)
    pypcd4 = pytest.importorskip("pypcd4")
    cloud = pypcd4.PointCloud.from_path(tmp_path / "a.pcd")
    np.testing.assert_array_equal(cloud.numpy(("x", "y", "z")), points)


def test_compressed_pcd_of_another_writer(tmp_path, rng):
    pypcd4 = pytest.importorskip("pypcd4")
    points = rng.normal(size=(500, 3)).round(1)
    cloud = pypcd4.PointCloud.from_points(points, ("x", "y", "z"), (np.float64,) * 3)
    for encoding in pypcd4.Encoding.ASCII, pypcd4.Encoding.BINARY, pypcd4.Encoding.BINARY_COMPRESSED:
        cloud.save(tmp_path / "a.pcd", encoding)
        np.testing.assert_allclose(read_cloud(tmp_path / "a.pcd"), points, rtol=0, atol=1e-9)


def test_what_cannot_be_written(tmp_path, refused):
    assert "unknown suffix '.las'; use one of .ply, .pcd, .xyz, .txt, .csv, .npy, .npz" in refused(
        write_cloud, tmp_path / "a.las", np.ones((2, 3))
    )
    assert "shape (3, 4) instead of (n, 3); transpose" in refused(write_cloud, tmp_path / "a.ply", np.ones((3, 4)))
    assert "array of type <U1" in refused(write_cloud, tmp_path / "a.ply", np.full((2, 3), "a"))
    assert "does not exist; create it first" in refused(write_cloud, tmp_path / "none" / "a.ply", np.ones((2, 3)))


def test_heavy_libraries_are_imported_late():
    code = "import sys, nonsac.io; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"trimesh", "laspy", "lazrs", "pypcd4", "lzf"} & set(done.stdout.split())
