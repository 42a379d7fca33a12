"""The picture of the graph of matches."""

import re

import pytest

from nonsac.plot import match_graph

FIRST, SECOND = ["a.jpg", "b.jpg", "c.jpg", "d.jpg"], ["b.jpg", "c.jpg", "d.jpg", "e$.jpg"]


def texts(path):
    return re.findall(r"<!-- (.*?) -->", path.read_text())


def test_images_pairs_and_parts(tmp_path):
    match_graph(tmp_path / "a.svg", FIRST, SECOND, [30, 0, 20, 0])
    found = texts(tmp_path / "a.svg")
    assert {"5 images in 3 parts", "2 pairs kept", "2 left out", *FIRST, "e$.jpg"} <= set(found)
    match_graph(tmp_path / "b.svg", FIRST, SECOND, [30, 9, 20, 1])
    assert "5 images in 1 part" in texts(tmp_path / "b.svg")


def test_lines_of_both_kinds_are_drawn(tmp_path):
    match_graph(tmp_path / "a.svg", FIRST, SECOND, [30, 0, 20, 0])
    drawn = (tmp_path / "a.svg").read_text()
    assert drawn.count("#0072b2; stroke-opacity") + drawn.count("stroke: #0072b2") >= 2
    assert drawn.count("stroke: #e69f00") >= 2


@pytest.mark.parametrize("images", [0, 3, 200])
def test_any_number_of_images(tmp_path, images):
    names = [f"{k}.jpg" for k in range(images)]
    match_graph(tmp_path / "a.png", names, names[1:] + names[:1], range(images))
    assert (tmp_path / "a.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((FIRST, SECOND, [1, 2]), "images1, images2 and inliers have 4, 4 and 2 entries"),
        ((FIRST, [1, 2, 3, 4], [1, 2, 3, 4]), "images2 must hold names of images"),
    ],
)
def test_refused(tmp_path, arguments, message):
    with pytest.raises((TypeError, ValueError), match=message):
        match_graph(tmp_path / "a.png", *arguments)
