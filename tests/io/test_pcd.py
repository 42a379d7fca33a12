import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from io_samples import compressed, literals, pcd_header
from nonsac.io import read_cloud
from nonsac.io.pcd import decompress_lzf

POINTS = [[0.1, 2.0, -3.5], [4.0, float("nan"), 1e-9]]


def check(path, expected=POINTS):
    points = read_cloud(path)
    assert points.dtype == np.float64
    assert points.flags.c_contiguous
    np.testing.assert_array_equal(points, np.array(expected))


@pytest.mark.parametrize("changes", [{}, {"VERSION": ".5"}, {"COUNT": None}, {"POINTS": None}, {"VIEWPOINT": None}])
@pytest.mark.parametrize("rows", [b"0.1 2 -3.5\n4 nan 1e-9\n", b"0.1  2\t-3.5 \r\n\r\n4 nan 1e-9"])
def test_ascii(make_file, changes, rows):
    check(make_file("a.pcd", pcd_header("ascii", changes) + rows))


def test_header_without_comment(make_file):
    check(make_file("a.pcd", pcd_header("ascii").partition(b"\n")[2] + b"0.1 2 -3.5\n4 nan 1e-9\n"))


MIXED = {
    "FIELDS": "_ rgb z x _ y",
    "SIZE": "1 4 4 8 2 4",
    "TYPE": "U F F F I I",
    "COUNT": "3 1 1 1 2 1",
}


def test_binary(make_file):
    check(make_file("a.pcd", pcd_header("binary") + struct.pack("<6d", *POINTS[0], *POINTS[1])))
    rows = struct.pack("<3Bffd2hi", 1, 2, 3, 0.5, 0.25, 0.1, 7, 8, -2) * 2
    check(make_file("a.pcd", pcd_header("binary", MIXED) + rows), [[0.1, -2, 0.25]] * 2)


def test_ascii_with_repeated_fields(make_file):
    rows = b"1 2 3 0.5 0.25 0.1 7 8 -2\n" * 2
    check(make_file("a.pcd", pcd_header("ascii", MIXED) + rows), [[0.1, -2, 0.25]] * 2)


def test_binary_compressed(make_file):
    columns = struct.pack("<6B2f2f2d4h2i", *range(6), 0.5, 0.5, 0.25, 1.25, 0.1, 1.1, *range(4), -2, -3)
    path = make_file("a.pcd", pcd_header("binary_compressed", MIXED) + compressed(columns))
    check(path, [[0.1, -2, 0.25], [1.1, -3, 1.25]])


def test_lzf_matches():
    assert decompress_lzf(b"\x02abc\x20\x02") == b"abcabc"
    assert decompress_lzf(b"\x00a\xe0\x01\x00") == b"a" * 11
    assert decompress_lzf(b"\x01ab\x60\x01") == b"ab" + b"ababa"
    far = bytes(range(256)) * 2
    assert decompress_lzf(literals(far) + b"\x21\xff") == far + far[:3]


@given(st.binary(max_size=300))
def test_lzf_literals(data):
    assert decompress_lzf(literals(data)) == data


@given(st.lists(st.sampled_from([b"ab", b"abc", b"x" * 40, bytes(9)]), max_size=60).map(b"".join))
def test_lzf_against_liblzf(data):
    lzf = pytest.importorskip("lzf")
    packed = lzf.compress(data, 2 * len(data) + 16) if data else b""
    assert decompress_lzf(packed) == data


@pytest.mark.parametrize("damaged", [b"\x20", b"\xe0", b"\xe0\x01", b"\x20\x00"])
def test_damaged_lzf(damaged):
    with pytest.raises((ValueError, IndexError)):
        decompress_lzf(damaged)


def test_truncated(make_file, refused):
    ascii_file = make_file("a.pcd", pcd_header("ascii") + b"1 2 3\n")
    assert "promises 2 point rows, it holds 1" in refused(read_cloud, ascii_file)
    for size, whole in ((47, 1), (24, 1), (23, 0), (0, 0)):
        path = make_file("a.pcd", pcd_header("binary") + bytes(size))
        assert f"promises 2 point rows, it holds {whole}" in refused(read_cloud, path)
    body = compressed(bytes(48))
    for size in (len(body) - 1, 9, 8, 3, 0):
        path = make_file("a.pcd", pcd_header("binary_compressed") + body[:size])
        assert "truncated or damaged" in refused(read_cloud, path)
    short = make_file("a.pcd", pcd_header("binary_compressed") + compressed(bytes(24)))
    assert "promises 2 point rows, it holds 1" in refused(read_cloud, short)
    assert "no DATA line" in refused(read_cloud, make_file("a.pcd", pcd_header("ascii")[:60]))


def test_bad_row(make_file, refused):
    path = make_file("a.pcd", pcd_header("ascii") + b"1 2 3\n4 x 6\n")
    assert "line 13: 'x' is not a number" in refused(read_cloud, path)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"FIELDS": "a y z"}, "the header names no x (it names a, y, z)"),
        ({"FIELDS": None}, "it names nothing"),
        ({"SIZE": "8 8"}, "header is not valid"),
        ({"SIZE": "8 8 3"}, "header is not valid"),
        ({"TYPE": "F F Q"}, "header is not valid"),
        ({"TYPE": None}, "header is not valid"),
        ({"COUNT": "1 1 2"}, "header is not valid"),
        ({"COUNT": "1 1"}, "header is not valid"),
        ({"POINTS": "many"}, "header is not valid"),
        ({"POINTS": "-2"}, "header is not valid"),
        ({"POINTS": "0"}, "holds no points"),
        ({"POINTS": "9" * 30}, "truncated"),
        ({"DATA": ""}, "header is not valid"),
        ({"DATA": "zipped"}, "unknown encoding 'zipped'"),
    ],
)
def test_bad_headers(make_file, refused, changes, expected):
    assert expected in refused(read_cloud, make_file("a.pcd", pcd_header("binary", changes) + bytes(48)))
