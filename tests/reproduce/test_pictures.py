"""Pictures of reports, with made-up numbers."""

import os

import numpy as np
import pytest

from nonsac.plot.figures import new_figure
from nonsac.reproduce import pictures
from nonsac.reproduce.cells import RULES
from nonsac.reproduce.experiments import EXPERIMENTS
from nonsac.reproduce.table2 import PAPER


def report_of(problems, counts):
    rng = np.random.default_rng(1)

    def by_rule(draw):
        return {name: {m: {rule: draw() for rule in RULES} for m in counts} for name in problems}

    return {
        **by_rule(lambda: float(rng.random())),
        "percentiles": by_rule(lambda: sorted(rng.random(5) * 100)),
        "seconds": {
            name: {m: {stage: float(rng.random()) for stage in ("hypotheses", "fixed", "refined")} for m in counts}
            for name in problems
        },
    }


@pytest.mark.parametrize(("problems", "counts"), [(list(EXPERIMENTS), ["10", "20", "30"]), (["absolute-pose"], ["7"])])
@pytest.mark.slow
def test_every_picture_is_written_whole_and_is_the_same_again(tmp_path, problems, counts):
    report = report_of(problems, counts)
    drawers = (pictures.table2, pictures.heat_maps, pictures.accuracy_curves, pictures.error_boxes)
    for draw in (*drawers, pictures.error_against_time):
        draw(tmp_path / "a.png", report)
        draw(tmp_path / "b.png", report)
        assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
        assert (tmp_path / "a.png").stat().st_size > 10_000
        with pytest.raises(ValueError, match=r"expected a picture that ends in \.png"):
            draw(tmp_path / "c.bmp", report)
    assert sorted(os.listdir(tmp_path)) == ["a.png", "b.png"]


def test_section_5(tmp_path):
    report = report_of(["registration"], ["1"])
    curves = {"samples": ("1", "2", "100"), "sample_size": ("250", "8000")}
    report["registration"] = {
        curve: {place: dict.fromkeys(RULES, 0.5) for place in places} for curve, places in curves.items()
    }
    pictures.section5(tmp_path / "a.svg", report)
    text = (tmp_path / "a.svg").read_text()
    assert "<svg" in text
    with pytest.raises(ValueError, match="picture"):
        pictures.section5(tmp_path / "a", report)


def test_the_heat_maps_have_ours_left_and_the_papers_right():
    report = report_of(list(EXPERIMENTS), ["10", "15", "30"])
    figure = new_figure(15.0, 7.0)
    pictures._heat_maps(figure, report)
    for name, axes in zip(EXPERIMENTS, figure.axes, strict=True):
        values = np.asarray(axes.images[0].get_array())
        assert values.shape == (22, 5)
        for row, rule in enumerate(RULES):
            np.testing.assert_array_equal(values[row, :3], [report[name][m][rule] for m in ("10", "15", "30")])
            expected = [PAPER[name][m].get(rule, np.nan) for m in (10, 30)]
            np.testing.assert_array_equal(values[row, 3:], expected)
        columns = [label.get_text() for label in axes.get_xticklabels()]
        assert columns == ["m = 10", "m = 15", "m = 30", "paper 10", "paper 30"]


def test_time_and_error_belong_together():
    report = report_of(["registration"], ["10", "20"])
    points = pictures._points(report, "registration")
    seconds, percentiles = report["seconds"]["registration"], report["percentiles"]["registration"]
    assert points["refined"][1] == (seconds["20"]["refined"], percentiles["20"]["refined"][3], "20")
    assert points["ideal"][0] == (seconds["10"]["hypotheses"], percentiles["10"]["ideal"][3], "10")
    assert points["fixed"][0][0] == seconds["10"]["fixed"]
