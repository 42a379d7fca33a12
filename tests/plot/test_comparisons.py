"""The picture of a comparison."""

import re

import numpy as np
import pytest

from nonsac.plot import comparison


def drawn(path, **changes):
    given = {
        "names": ["a", "a", "b$"],
        "kinds": ["alone", "core", "alone"],
        "seconds": [0.01, 0.1, 2.0],
        "values": [0.5, 0.9, 0.7],
    }
    comparison(path, **given | changes)
    return path.read_text()


def texts(content):
    return re.findall(r"<!-- (.*?) -->", content)


def test_names_kinds_and_times(tmp_path):
    found = texts(drawn(tmp_path / "a.svg", best=1, label="mAA", title="some data"))
    assert {"alone", "core", "recommended", "mAA", "some data", "b$", "10 ms", "1 s"} <= set(found)
    assert found.count("a") == 2


def test_the_recommended_one_is_emphasised(tmp_path):
    assert "#e69f00" in drawn(tmp_path / "a.svg", best=1)
    assert "#e69f00" not in drawn(tmp_path / "a.svg")
    assert "recommended" not in texts(drawn(tmp_path / "a.svg"))


def test_names_do_not_cover_each_other(tmp_path):
    names = [f"method {k}" for k in range(6)]
    content = drawn(tmp_path / "a.svg", names=names, kinds=["alone"] * 6, seconds=[0.1] * 6, values=[0.8] * 6)
    places = [
        re.search(rf"<!-- {name} -->\s*<g [^>]*transform=\"translate\(([\d.]+) ([\d.]+)\)", content) for name in names
    ]
    heights = sorted(float(place[2]) for place in places)
    assert np.diff(heights).min() > 8.0


@pytest.mark.parametrize("count", [0, 1, 40])
def test_any_number_of_methods(tmp_path, count):
    names = [f"a method with quite a long name {k}" for k in range(count)]
    comparison(tmp_path / "a.png", names, ["alone"] * count, [0.0] * count, [float("nan"), *[1.0] * count][:count])
    assert (tmp_path / "a.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seconds": [1.0]}, "names, kinds, seconds and values have 3, 3, 1 and 3 entries"),
        ({"best": 3}, "best must be a number from 0 to 2"),
        ({"names": ["a", "b", 3]}, "names must hold words"),
        ({"kinds": "abc"}, "kinds must be words"),
    ],
)
def test_wrong_arguments_are_refused(tmp_path, changes, message):
    with pytest.raises((ValueError, TypeError), match=message):
        drawn(tmp_path / "a.svg", **changes)
