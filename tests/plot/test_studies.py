"""Pieces of pictures: what is drawn, read back from the axes."""

import numpy as np
import pytest
from matplotlib.colors import to_hex

from nonsac.plot import studies
from nonsac.plot.figures import new_figure, render


@pytest.fixture
def axes():
    return new_figure(6.0, 4.0).subplots()


def test_a_heat_map_has_each_number_in_its_cell(axes):
    values = np.array([[0.1, 0.9, np.nan], [0.25, 1.0, 0.0]])
    studies.heat_map(axes, values, ["first", "second"], ["a", "b", "c"])
    texts = {text.get_position(): text.get_text() for text in axes.texts}
    assert texts == {(0, 0): "0.10", (1, 0): "0.90", (0, 1): "0.25", (1, 1): "1.00", (2, 1): "0.00"}
    (image,) = axes.images
    np.testing.assert_array_equal(np.asarray(image.get_array()), values)
    assert image.get_clim() == (0.0, 1.0)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["first", "second"]
    for text in axes.texts:  # readable on its cell
        cell = image.cmap(float(text.get_text()))[:3]
        ink = 1.0 if text.get_color() == "white" else 0.0
        assert abs(np.dot(cell, (0.299, 0.587, 0.114)) - ink) > 0.35


def test_curves_name_the_emphasised_and_keep_the_others_pale(axes):
    series = {"plain": [0.1, 0.2, 0.3], "good": [0.5, 0.7, 0.9], "bad": [0.3, 0.2, 0.1]}
    studies.curves(axes, [1, 10, 100], series, {"bad": "#ff0000", "good": "#0000ff", "absent": "#00ff00"})
    lines = {line.get_label(): line for line in axes.lines}
    assert {"good", "bad"} < set(lines)
    for name in ("good", "bad"):
        np.testing.assert_array_equal(lines[name].get_xdata(), [1, 10, 100])
        np.testing.assert_array_equal(lines[name].get_ydata(), series[name])
    assert (to_hex(lines["bad"].get_color()), to_hex(lines["good"].get_color())) == ("#ff0000", "#0000ff")
    (pale,) = [line for line in axes.lines if to_hex(line.get_color()) == studies.PALE]
    np.testing.assert_array_equal(pale.get_ydata(), series["plain"])
    assert axes.get_xscale() == "log"
    assert [label.get_text() for label in axes.get_xticklabels()] == ["1", "10", "100"]


def test_boxes_lie_at_their_percentiles(axes):
    boxes = {"one": (0.001, 0.1, 0.5, 2.0, 180.0), "refined": (0.02, 0.03, 0.04, 0.05, 0.06)}
    studies.percentile_boxes(axes, boxes, ("refined",))
    first, second = axes.patches
    assert (first.get_x(), first.get_x() + first.get_width()) == pytest.approx((0.1, 2.0))
    assert (second.get_x(), second.get_x() + second.get_width()) == pytest.approx((0.03, 0.05))
    assert to_hex(first.get_facecolor()) != to_hex(second.get_facecolor())
    reach = [points for lines in axes.collections for points in lines.get_segments()]
    assert any(np.allclose(points, [[0.01, 0], [180, 0]]) for points in reach)  # 0.001 is drawn as 0.01
    assert any(np.allclose(points[:, 0], 0.5) for points in reach)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["one", "refined"]
    assert axes.yaxis_inverted()


def test_error_against_time_joins_the_points_of_a_method(axes):
    points = {"slow": [(0.1, 2.0, "10"), (0.4, 1.0, "30")], "fast": [(0.01, 3.0, "10")]}
    studies.against_time(axes, points, {"fast": "#ff0000", "slow": "#0000ff"})
    slow, fast = axes.lines
    np.testing.assert_array_equal(slow.get_xydata(), [(0.1, 2.0), (0.4, 1.0)])
    np.testing.assert_array_equal(fast.get_xydata(), [(0.01, 3.0)])
    assert sorted((text.xy, text.get_text()) for text in axes.texts) == [
        ((0.01, 3.0), "10"),
        ((0.1, 2.0), "10"),
        ((0.4, 1.0), "30"),
    ]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert [to_hex(line.get_color()) for line in (slow, fast)] == ["#0000ff", "#ff0000"]


@pytest.mark.parametrize("limits", [(0.01, 100.0), (0.9, 5.0), (90.0, 130.0), (0.104, 0.118)])
def test_there_are_always_ticks_to_read(limits):
    ticks = studies._ticks_between(limits)
    assert len(ticks) >= 2
    assert all(limits[0] <= tick <= limits[1] for tick in ticks)
    assert ticks == sorted(ticks)


def test_pieces_render(axes):
    studies.against_time(axes, {"a": [(0.1, 2.0, "10")]}, {"a": "black"})
    assert render(axes.figure, ".png").startswith(b"\x89PNG")


def test_reliability_has_each_bin_in_its_place_and_leaves_empty_ones_out(axes):
    bins = [(1200, 0.2, 0.1, 0.05, 0.15), (0, 0.0, 0.0, 0.0, 0.0), (7, 0.95, 0.8, 0.6, 0.9)]
    studies.reliability(axes, (0.0, 0.5, 0.9, 1.0), bins, "#ff0000")
    assert [tuple(np.ravel(line.get_xydata())) for line in axes.lines] == [(0, 0.1), (2, 0.8)]
    drawn = [tuple(np.ravel(points)) for lines in axes.collections for points in lines.get_segments()]
    means, intervals = [(-0.5, 0.2, 0.5, 0.2), (1.5, 0.95, 2.5, 0.95)], [(0, 0.05, 0, 0.15), (2, 0.6, 2, 0.9)]
    assert sorted(drawn) == sorted([*means, *intervals])
    assert {text.xy[0]: text.get_text() for text in axes.texts} == {0: "1,200", 2: "7"}
    assert list(axes.get_xticks()) == [-0.5, 0.5, 1.5, 2.5]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0", "0.5", "0.9", "1"]
