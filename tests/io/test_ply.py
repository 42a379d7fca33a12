import struct

import numpy as np
import pytest

from io_samples import FACES, XYZ, mixed_faces, ply_header
from nonsac.io import read_cloud

POINTS = [[0.1, 2.0, -3.5], [4.0, 5.0, 1e-9], [4.0, 5.0, 1e-9], [7.0, float("nan"), 9.0]]
FLAT = [value for point in POINTS for value in point]
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


def check(path, expected=POINTS):
    points = read_cloud(path)
    assert points.dtype == np.float64
    assert points.flags.c_contiguous
    np.testing.assert_array_equal(points, np.array(expected))


def test_ascii(make_file):
    check(make_file("a.ply", ply_header("ascii") + b"0.1 2 -3.5\n4 5 1e-9\n4 5 1e-9\n7 nan 9\n"))


def test_ascii_with_windows_line_ends(make_file):
    content = ply_header("ascii") + b"0.1 2 -3.5\n4 5 1e-9\n4 5 1e-9\n7 nan 9\n"
    check(make_file("a.PLY", content.replace(b"\n", b"\r\n")))


def test_ascii_with_faces_around_and_lists(make_file):
    vertex = "element vertex 2\nproperty list uchar float w\nproperty float z\nproperty int x\nproperty int y\n"
    head = ply_header("ascii", FACES, vertex, "element edge 1\nproperty int a\n")
    rows = b"3 0 1 2\n4 0 1 2 3\n2 0.5 0.5 3 1 2\n0 6 4 5\n7\n"
    check(make_file("a.ply", head + rows), [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(("form", "order"), ORDERS.items())
class TestBinary:
    def test_plain(self, make_file, form, order):
        check(make_file("a.ply", ply_header(form) + struct.pack(order + "12d", *FLAT)))

    def test_faces_behind_mixed(self, make_file, form, order):
        head = ply_header(form, f"element vertex 4\n{XYZ}", FACES)
        check(make_file("a.ply", head + struct.pack(order + "12d", *FLAT) + mixed_faces(order)))

    def test_faces_before(self, make_file, form, order):
        head = ply_header(form, FACES, f"element vertex 4\n{XYZ}")
        check(make_file("a.ply", head + mixed_faces(order) + struct.pack(order + "12d", *FLAT)))

    def test_plain_element_before(self, make_file, form, order):
        camera = "element camera 3\nproperty short a\nproperty uchar b\n"
        head = ply_header(form, camera, f"element vertex 4\n{XYZ}")
        check(make_file("a.ply", head + bytes(9) + struct.pack(order + "12d", *FLAT)))

    def test_list_in_vertex(self, make_file, form, order):
        vertex = f"element vertex 2\nproperty float x\nproperty list uchar short w\n{XYZ[18:]}"
        body = struct.pack(order + "fB2hdd", 1, 2, 9, 9, 2, 3) + struct.pack(order + "fBdd", 4, 0, 5, 6)
        check(make_file("a.ply", ply_header(form, vertex) + body), [[1, 2, 3], [4, 5, 6]])

    def test_extra_properties_and_order(self, make_file, form, order):
        names = ["uchar red", "float z", "double x", "short quality", "float32 y"]
        vertex = "element vertex 1\n" + "".join(f"property {name}\n" for name in names)
        body = struct.pack(order + "Bfdhf", 255, 3, 0.1, -2, 2)
        check(make_file("a.ply", ply_header(form, vertex) + body), [[0.1, 2, 3]])

    @pytest.mark.parametrize(
        "names",
        [
            "char b,int8 b",
            "uchar B,uint8 B",
            "short h,int16 h",
            "ushort H,uint16 H",
            "int i,int32 i",
            "uint I,uint32 I",
            "float f,float32 f",
            "double d,float64 d",
        ],
    )
    def test_every_type(self, make_file, form, order, names):
        for name in names.split(","):
            kind, letter = name.split()
            vertex = "element vertex 1\n" + "".join(f"property {kind} {axis}\n" for axis in "xyz")
            body = struct.pack(order + "3" + letter, 1, 2, 100)
            check(make_file("a.ply", ply_header(form, vertex) + body), [[1, 2, 100]])

    def test_truncated(self, make_file, refused, form, order):
        body = struct.pack(order + "12d", *FLAT)
        for missing in (1, 24, 25, 96):
            path = make_file("a.ply", ply_header(form) + body[:-missing])
            whole = (96 - missing) // 24
            assert f"promises 4 point rows, it holds {whole}" in refused(read_cloud, path)

    def test_truncated_within_faces_before(self, make_file, refused, form, order):
        head = ply_header(form, FACES, f"element vertex 4\n{XYZ}")
        path = make_file("a.ply", head + mixed_faces(order)[:-1])
        assert "promises 2 face rows, it holds 1" in refused(read_cloud, path)

    def test_truncated_within_vertex_lists(self, make_file, refused, form, order):
        vertex = f"element vertex 2\nproperty list uchar short w\n{XYZ}"
        path = make_file("a.ply", ply_header(form, vertex) + struct.pack(order + "B", 3))
        assert "promises 2 vertex rows, it holds 0" in refused(read_cloud, path)

    def test_absurd_count(self, make_file, refused, form, order):
        for before in ("", "element camera 1" + "0" * 40 + "\nproperty int a\n"):
            head = ply_header(form, before, f"element vertex 9{'0' * 30}\n{XYZ}")
            assert "truncated" in refused(read_cloud, make_file("a.ply", head + bytes(24)))


def test_truncated_ascii(make_file, refused):
    path = make_file("a.ply", ply_header("ascii") + b"1 2 3\n4 5 6\n")
    assert "truncated: its header promises 4 data rows, it holds 2" in refused(read_cloud, path)


def test_face_does_not_pass_for_a_vertex(make_file, refused):
    head = ply_header("ascii", f"element vertex 2\n{XYZ}", FACES)
    assert "truncated" in refused(read_cloud, make_file("a.ply", head + b"1 2 3\n3 0 1 2\n3 0 1 2\n"))


def test_bad_ascii_rows_are_named_by_line(make_file, refused):
    short = make_file("a.ply", ply_header("ascii", vertices=2) + b"1 2 3\n4 5\n")
    assert "line 10 has 2 columns where 3 are needed" in refused(read_cloud, short)
    word = make_file("a.ply", ply_header("ascii", vertices=2) + b"1 2 3\n4 five 6\n")
    assert "line 10: 'five' is not a number" in refused(read_cloud, word)


def test_ascii_list_row_that_does_not_fit(make_file, refused):
    vertex = f"element vertex 1\nproperty list uchar float w\n{XYZ}"
    path = make_file("a.ply", ply_header("ascii", vertex) + b"3 1 2 3 4 5\n")
    assert "line 10 does not fit" in refused(read_cloud, path)


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        (
            "element vertex 1\nproperty float a\nproperty float y\n",
            "the header names no x, z (it names a, y)",
        ),
        (FACES, "no vertex element"),
        ("element vertex one\n", "line 4 of the PLY header is not valid: 'element vertex one'"),
        ("element vertex -1\n" + XYZ, "line 4 of the PLY header"),
        ("property float x\n", "line 4 of the PLY header"),
        ("element vertex 1\nproperty quad x\n", "line 5 of the PLY header"),
        ("element vertex 1\nproperty list float int x\n", "line 5 of the PLY header"),
        ("element vertex 1\n" + XYZ.replace("double", "list uchar int"), "x, y and z are lists"),
        ("element vertex 0\n" + XYZ, "holds no points"),
    ],
)
@pytest.mark.parametrize("form", ["ascii", *ORDERS])
def test_bad_headers(make_file, refused, form, parts, expected):
    assert expected in refused(read_cloud, make_file("a.ply", ply_header(form, parts)))


def test_header_faults(make_file, refused):
    cut = make_file("a.ply", ply_header("ascii")[:40])
    assert "no end_header line" in refused(read_cloud, cut)
    nothing = make_file("a.ply", "ply\nelement vertex 1\n" + XYZ + "end_header\n1 2 3\n")
    assert "no format line" in refused(read_cloud, nothing)
    unknown = make_file("a.ply", ply_header("binary_middle_endian"))
    assert "line 2 of the PLY header" in refused(read_cloud, unknown)
