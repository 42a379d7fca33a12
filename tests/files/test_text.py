"""Tables of text: comments, headers, separators, and ways to write what is no number."""

import numpy as np
import pytest

from nonsac.files.text import read_table
from nonsac.io import read_cloud

NAN, INF = np.nan, np.inf


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("1 2 3 4\n", None),
        ("% x y z intensity\n1 2 3 4\n", "x y z intensity"),
        ("%x y z intensity\n1 2 3 4\n", "x y z intensity"),
        ("# z y x i\n1 2 3 4\n", "z y x i"),
        ("//X,Y,Z,R\n1,2,3,4\n", "x y z r"),
        ("//X Y Z R\n1, 2, 3, 4\n", "x y z r"),
        ("; x y z i\n1 2 3 4\n", "x y z i"),
        ("# columns: id x y z\n1 2 3 4\n", "id x y z"),
        ("# x y z i\n# measured in spring, 2 % humidity\n\n1 2 3 4\n", "x y z i"),
        ("# a b c d\n# x y z i\n1 2 3 4\n", "x y z i"),
        ("# x y z i\na,b,c,d\n1,2,3,4\n", "a b c d"),
        ("# made by my hand\n1 2 3 4\n", None),
        ("# x y z\n1 2 3 4\n", None),
        ("1 2 3 4\n# x y z i\n5 6 7 8\n", None),
        (";x;y;z\n1;2;3;4\n", " x y z"),
        ("; a remark\n1;2;3;4\n", None),
        ("//X Y Z R\n1\n1 2 3 4\n", "x y z r"),
        ("x [m] y [m] z [m] i\n1 2 3 4\n", "x[m] y[m] z[m] i"),
        ("x y X Y\n1 2 3 4\n", "x y X Y"),
        ("name\tX (m)\tY (m)\tZ (m)\nan oak\t1\t2\t3\n", "name x_(m) y_(m) z_(m)"),
        ('"x";"y";"z";"i"\n1;2;3;4\n', "x y z i"),
        ("x,y,x',y'\n1,2,3,4\n", "x y x' y'"),
    ],
)
def test_headers(make_file, text, names):
    found = read_table(make_file("a.txt", text)).names
    assert found == (None if names is None else tuple(name.replace("_", " ") for name in names.split(" ")))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("% x y z intensity\n1 2 3 4\n", [[1, 2, 3]]),
        ("id,x [m],y [m],z [m]\n7,1,2,3\n", [[1, 2, 3]]),
        ("GPSTime,Northing,Easting,Height\n7,2,1,3\n", [[1, 2, 3]]),
        ("//Z Y X R\n2\n3 2 1 9\n6 5 4 9\n", [[1, 2, 3], [4, 5, 6]]),
        ("; note\n1 2 3\n", [[1, 2, 3]]),
        ("  % a remark\n1 2 3\n% another\n4 5 6\n", [[1, 2, 3], [4, 5, 6]]),
        ("1 2 -1.#IND\n1.#INF -1.#INF00 1.#QNAN0\n", [[1, 2, NAN], [INF, -INF, NAN]]),
        ("1,nan(ind),-nan(ind)\nNaN(snan),NAN(0x8),3 # x\n", [[1, NAN, NAN], [NAN, NAN, 3]]),
        ("id\tx\ty\tz\n\t1\t2\t3\n", None),
        ("x\ty\tz\tl\n1\t2\t3\ta word\n", [[1, 2, 3]]),
        ("1\t2 3\n4\t5 6\n", [[1, 2, 3], [4, 5, 6]]),
    ],
)
def test_clouds(make_file, refused, text, expected):
    path = make_file("a.txt", text)
    if expected is None:
        assert "its header names 4 columns, its rows have 3" in refused(read_cloud, path)
    else:
        np.testing.assert_array_equal(read_cloud(path), expected)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("GPSTime,Easting,Northing\n1,2,3\n", "names no x, y, z (it names gpstime, easting, northing); name the"),
        ("# lat lon alt\n1 2 3\n", "the header names no x, y, z (it names lat, lon, alt)"),
        ("x y z\n1 2 3 4\n", "its header names 3 columns, its rows have 4; name every column, or remove the header"),
        ("x,y,z,x\n1,2,3,4\n", "the header is not clear: several columns could be x (x, x); name the coordinates"),
        ("x [m],y [m],z [mm]\n1,2,3\n", "the header is not clear: the units of the coordinates differ (m, mm)"),
        ('name,id,x,y,z\noak,5,6,7,8\n"a, b",1,2,3,4\n', "line 3 has 6 columns, its header names 5; correct this line"),
        ("id name x y z\n1 oak 6 7 8\n2 oak 9 1 2 3\n", "line 3 has 6 columns, its header names 5"),
        ("x\ty\tz\ti\n1\t2\t3\t4\n1\t\t3\t4\n", "line 3: '' is not a number; correct this line (write nan for"),
        ("1 2 3\n4 5 6.#NOTE\n", "line 2: '6.#NOTE' is not a number"),
        ("1 2 3\n" * 2000 + "1 2 3\x004\n", "line 2001: '3\\x004' is not a number"),
        ("1 2 3\x00\n", "it looks like an unknown binary file"),
        ("1 2 3 " * 200_000, "line 1 is 1,199,999 characters long; write one row in each line"),
        ("1 2 3\n".encode("utf-16-le"), "it looks like a UTF-16 text; save it as UTF-8 text"),
        ("1 2 3\n".encode("utf-16-be"), "it looks like a UTF-16 text; save it as UTF-8 text"),
        (
            ",".join(f"c{number}" for number in range(3000)) + "\n" + "1," * 2999 + "1\n",
            "c19 and 2980 more); name",
        ),
    ],
)
def test_what_is_not_clear_is_refused(make_file, refused, text, message):
    answer = refused(read_cloud, make_file("a.csv", text))
    assert message in answer
    assert len(answer) < 500


def test_numbers_that_are_none_in_other_clouds(make_file):
    header = (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    )
    np.testing.assert_array_equal(read_cloud(make_file("a.ply", header + "1 -1.#IND 1.#INF\n")), [[1, NAN, INF]])
