"""Which column of a file is meant, by its name."""

import pytest

from nonsac.files.column_names import find_places, is_usual, listing, place_of
from nonsac.layouts import MATCHES, PAIRS, POINTS

XYZ = ("x", "y", "z")


@pytest.mark.parametrize(
    ("names", "places"),
    [
        ("x y z", [0, 1, 2]),
        ("Z id Y X", [3, 2, 0]),
        ("id|x [m]|y [m]|z [m]", [1, 2, 3]),
        ("X(m)|Y(m)|Z(m)", [0, 1, 2]),
        ("z_m x_m y_m", [1, 2, 0]),
        ("//X Y Z", [0, 1, 2]),
        ("#z|%y|;x", [2, 1, 0]),
        ("GPSTime Northing Easting Height", [2, 1, 3]),
        ("Easting [m]|Northing [m]|Elevation [m]", [0, 1, 2]),
        ("Pos_X Pos_Y Pos_Z", [0, 1, 2]),
        ("position.x position.y position.z", [0, 1, 2]),
        ("Points:2 Points:0 Points:1", [1, 2, 0]),
        ("Points_m_XYZ:0 Points_m_XYZ:1 Points_m_XYZ:2", [0, 1, 2]),
        ("nx ny nz x y z", [3, 4, 5]),
        ("x [m]|x|y|z", [1, 2, 3]),
        ("Easting Northing Height x y z", [3, 4, 5]),
        ("x y intensity", [0, 1, None]),
        ("lat lon alt", [None] * 3),
        ("GPSTime Easting Northing", [None] * 3),
        ("x [deg]|y [deg]|z [deg]", [None] * 3),
        ("x.1 y.1 z.1", [None] * 3),
        ("", [None] * 3),
    ],
)
def test_coordinates(names, places):
    assert find_places(names.split("|" if "|" in names else None), XYZ) == places


@pytest.mark.parametrize(
    ("layout", "names", "places"),
    [
        (MATCHES, "x2 y2 x1 y1", [2, 3, 0, 1]),
        (MATCHES, "id u1 v1 u2 v2", [None] * 4),
        (MATCHES, "x_2 y_2 x_1 y_1", [2, 3, 0, 1]),
        (MATCHES, "x0 y0 x1 y1", [0, 1, 2, 3]),
        (MATCHES, "x0 y0 x1 y1 x2 y2", [2, 3, 4, 5]),
        (MATCHES, "x y x' y'", [0, 1, 2, 3]),
        (MATCHES, "x y x.1 y.1", [None] * 4),
        (MATCHES, "a b x1 y1", [2, 3, None, None]),
        (POINTS, "u v X Y Z", [0, 1, 2, 3, 4]),
        (POINTS, "X Y Z x y", [3, 4, 0, 1, 2]),
        (POINTS, "u [px]|v [px]|X [m]|Y [m]|Z [m]", [0, 1, 2, 3, 4]),
        (POINTS, "Easting Northing Height u v", [3, 4, 0, 1, 2]),
        (POINTS, "x y z", [None, None, 0, 1, 2]),
        (PAIRS, "target_x target_y target_z source_x source_y source_z", [3, 4, 5, 0, 1, 2]),
        (PAIRS, "z2 y2 x2 z1 y1 x1", [5, 4, 3, 2, 1, 0]),
    ],
)
def test_rows(layout, names, places):
    assert find_places(names.split("|" if "|" in names else None), layout.names, layout.split) == places


@pytest.mark.parametrize(
    ("layout", "names", "message"),
    [
        (XYZ, "x y z x", r"several columns could be x \(x, x\)"),
        (XYZ, "x [m]|x [ft]|y|z", r"several columns could be x \(x \[m\], x \[ft\]\)"),
        (XYZ, "Easting Northing Height Elevation", r"could be x y z \(Easting Northing Height or Easting Northing E"),
        (XYZ, "x [m]|y [m]|z [mm]", r"the units of the coordinates differ \(m, mm\)"),
        (MATCHES.names, "x y x y x1 y1 x1 x2 y2", r"several columns could be x1 \(x1, x1\)"),
    ],
)
def test_what_is_not_clear_is_refused(layout, names, message):
    with pytest.raises(ValueError, match=message):
        find_places(names.split("|" if "|" in names else None), layout)


def test_two_things_may_have_two_units():
    names = ("u [px]", "v [px]", "X [m]", "Y [m]", "Z [m]")
    with pytest.raises(ValueError, match="the units of the coordinates differ"):
        find_places(names, POINTS.names)


def test_one_name():
    assert place_of("Weight", ["x", "weight"]) == 1
    assert place_of("w", ["W", "w"]) == 1
    assert place_of("w", ["W", "W"]) is None
    assert place_of("w", ["x"]) is None
    assert place_of("x'", ["x", '"X\'"']) == 1


@pytest.mark.parametrize(
    ("line", "usual"),
    [
        ("x y z intensity", True),
        ("anything x y", True),
        ("lat lon alt", True),
        ("id time label", True),
        ("made by hand", False),
        ("x marks it", False),
        ("", False),
    ],
)
def test_names_are_told_from_remarks(line, usual):
    assert is_usual(line.split()) == usual


def test_many_and_long_names_are_cut():
    assert listing(["a" * 1000, "b"]) == "a" * 40 + " b"
    assert listing([str(number) for number in range(25)], ", ").endswith("18, 19 and 5 more")
