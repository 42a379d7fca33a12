"""The curves of Section 5, on a small grid."""

import json
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest

from nonsac import cli
from nonsac.reproduce import experiments, section5
from nonsac.reproduce.cells import RULES
from nonsac.reproduce.experiments import EXPERIMENTS


@pytest.fixture
def small(monkeypatch):
    """Fewer rows and samples."""
    registration = replace(EXPERIMENTS["registration"], sample_size=400, outlier_ratios=(0.9, 0.93, 0.96))
    monkeypatch.setitem(experiments.EXPERIMENTS, "registration", registration)
    monkeypatch.setattr(section5, "COUNTS", (1, 2, 4))
    monkeypatch.setattr(section5, "SIZES", (1 / 2, 1, 2))
    monkeypatch.setattr(section5, "COUNT_OF_SIZES", 3)


@pytest.mark.usefixtures("small")
def test_curves(tmp_path):
    arguments = ["--problem", "registration", "--trials", "2", "--workers", "1", "--quiet"]
    outputs = ["--json", str(tmp_path / "report.json"), "--picture", str(tmp_path / "curves.png")]
    assert cli.main(["reproduce", "section5", *arguments, *outputs]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["curves.png", "report.json"]
    report = json.loads((tmp_path / "report.json").read_text())
    curves = report["registration"]
    assert list(curves["samples"]) == ["1", "2", "4"]
    assert list(curves["sample_size"]) == ["200", "400", "800"]
    for curve in curves.values():
        for accuracy in curve.values():
            assert tuple(accuracy) == RULES
            assert all(0 <= value <= 1 for value in accuracy.values())
    ideal = [accuracy["ideal"] for accuracy in curves["samples"].values()]
    assert ideal == sorted(ideal)
    assert curves["samples"]["1"]["ideal"] == curves["samples"]["1"]["most_inliers"] == curves["samples"]["1"]["fixed"]
    for curve in ("samples", "sample_size"):
        assert set(report["seconds"]["registration"][curve]) == set(curves[curve])
    settings = report["settings"]["problems"]["registration"]
    assert settings["outlier_ratios"] == [0.9, 0.93, 0.96]
    assert settings["sample_size"] == [200, 400, 800]
    shown(report)


def shown(report):
    from rich.console import Console

    console = Console(width=80, record=True, file=StringIO())
    console.print(section5.table(report, "registration", "sample_size"))
    text = console.export_text()
    assert "registration: mAA by sample size" in text
    assert "refined" in text
    assert "800" in text


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_grid_is_the_middle_of_table_2(name):
    cells = section5._cells(EXPERIMENTS[name])
    experiment = EXPERIMENTS[name]
    assert {cell.noise for cell in cells} == {np.median(experiment.noises)}
    assert {cell.outlier_ratio for cell in cells} < set(experiment.outlier_ratios)
    assert sum(cell.counts == section5.COUNTS for cell in cells) == 3
    assert {cell.sample_size for cell in cells if cell.counts == section5.COUNTS} == {experiment.sample_size}
    assert {cell.sample_size for cell in cells} == set(section5._sizes(experiment))
