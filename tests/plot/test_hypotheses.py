"""The picture of the hypotheses of a run; what is drawn is read from the figure."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex

import naive
import nonsac
from nonsac import plot, simulate
from nonsac.plot import figures
from nonsac.result import Evidence, Hypothesis, Result, Status

BLUE = to_hex(figures.BLUE)


@pytest.fixture
def drawn(monkeypatch):
    """The axes of the last figure, instead of files."""
    kept, module = [], sys.modules["nonsac.plot.hypotheses"]  # the function has its name
    monkeypatch.setattr(module, "write", lambda path, figure, suffix: kept.append(figure))

    def draw(result, title=None):
        plot.hypotheses("a.png", result, title)
        return kept[-1]

    return draw


def hypothesis(degrees, inliers, score, rows=10):
    """Turned by so many degrees about z; NaN for none."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    model = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0.0]])
    model = model if np.isfinite(degrees) else np.full((3, 4), np.nan)
    residuals = np.where(np.arange(rows) < inliers, 0.5, 2.0)
    return Hypothesis(model, residuals, 1.0, score=score)


def made(hypotheses, answer=3.0, inliers=40, rows=100, **more):
    return Result(
        hypothesis(answer, 1, 0.0).model,
        Status.OK if np.isfinite(answer) else Status.LOW_SUPPORT,
        0.9,
        inliers,
        rows,
        0.2,
        1.0,
        tuple(hypotheses),
        info={"rule": "tlp_0.1", "sample_size": 10},
        evidence=Evidence(nonsac.Registration()),
        **more,
    )


FOUR = [hypothesis(5, 3, -2.0), hypothesis(2, 5, -1.0), hypothesis(np.nan, 0, -np.inf), hypothesis(150, 2, -np.inf)]


def named(axes):
    return {line.get_label(): line for line in axes.lines}


def test_scores_stand_over_the_distance_from_the_selected_one(drawn):
    left, _ = drawn(made(FOUR)).axes
    lines = named(left)
    np.testing.assert_allclose(lines["others"].get_xydata(), [[3.0, -2.0]])
    np.testing.assert_allclose(lines["selected"].get_xydata(), [[0.01, -1.0]])
    np.testing.assert_allclose(lines["the answer"].get_xdata(), 1.0)
    np.testing.assert_allclose(lines["out of the question"].get_xdata(), [148.0])
    assert left.get_ylabel() == "score (tlp_0.1)"
    assert to_hex(lines["selected"].get_color()) == BLUE


def test_bars_are_the_inliers_of_each_sample_and_the_selected_one_is_dark(drawn):
    _, right = drawn(made(FOUR)).axes
    np.testing.assert_allclose([bar.get_height() for bar in right.patches[:4]], [30, 50, 0, 20])
    dark = [to_hex(bar.get_facecolor()) == BLUE for bar in right.patches[:4]]
    assert dark == [False, True, False, False]
    lines = named(right)
    np.testing.assert_allclose(lines["no model"].get_xydata(), [[2, 0]])
    np.testing.assert_allclose(lines["the answer, in all rows"].get_ydata(), 40.0)
    band = right.patches[4]  # 40 % +- 1.96 sqrt(.4 .6 / 10)
    np.testing.assert_allclose([band.get_y(), band.get_height()], [40 - 30.36, 60.73], atol=0.01)


def test_the_title_says_what_was_selected_and_whether_to_trust_it(drawn):
    assert [text.get_text() for text in drawn(made(FOUR)).texts] == ["4 samples of 10 rows, sample 1 selected, trusted"]
    assert [text.get_text() for text in drawn(made(FOUR), "my $scan").texts] == ["my $scan"]


@pytest.mark.parametrize(
    ("found", "words", "title"),
    [
        ([FOUR[2]] * 3, "no sample gave a model", "3 samples of 10 rows, no model, NOT TRUSTED: low support"),
        ([], "no sample was drawn", "0 samples of 10 rows, no model, NOT TRUSTED: low support"),
    ],
)
def test_without_any_model(drawn, found, words, title):
    figure = drawn(made(found, answer=np.nan, inliers=0, rows=0))
    left, right = figure.axes
    assert [text.get_text() for text in left.texts] == [words]
    assert [text.get_text() for text in figure.texts] == [title]
    assert all(bar.get_height() == 0 for bar in right.patches)


def test_the_selected_one_is_the_first_of_the_best(drawn):
    same = [hypothesis(0, 3, -5.0), hypothesis(9, 3, -1.0), hypothesis(4, 3, -1.0)]
    left, _ = drawn(made(same)).axes
    np.testing.assert_allclose(named(left)["the answer"].get_xdata(), 6.0)


@pytest.mark.parametrize("count", [1, 2, 10, 100])
def test_ticks_are_whole_numbers_of_samples(drawn, count):
    _, right = drawn(made([hypothesis(k, k % 9, -float(k)) for k in range(count)])).axes
    ticks = [int(label.get_text()) for label in right.get_xticklabels()]
    assert ticks[0] == 0
    assert ticks == list(range(0, count, max(1, ticks[-1] - ticks[-2] if len(ticks) > 1 else 1)))
    assert len(ticks) <= 10


def results(rng):
    pairs = simulate.registration(n=3000, outlier_ratio=0.9, noise=0.01, rng=rng)
    views = simulate.relative_pose(n=3000, outlier_ratio=0.5, noise=0.001, rng=rng)
    yield nonsac.register_pairs(pairs.source, pairs.target, noise=0.01, rule="closest_pair", refine="none", samples=5)
    yield nonsac.relative_pose(views.points1, views.points2)  # at unknown noise: every hypothesis has its threshold
    yield nonsac.relative_pose(views.points1[:3], views.points2[:3])
    line = naive.line_model(30.0, 0.5)
    rows = rng.standard_normal((900, 1)) * [-line[1], line[0]] + line[2] * line[:2]
    yield nonsac.estimate(nonsac.ArraySource(rows + 0.01 * rng.standard_normal(rows.shape)), naive.Line(), noise=0.01)


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_results_of_calls_are_drawn_the_same_each_time(rng, tmp_path, suffix):
    for result in results(rng):
        for name in ("a", "b"):
            plot.hypotheses(tmp_path / (name + suffix), result)
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.slow
def test_raw_clouds_have_hypotheses_too(tmp_path):
    scans = simulate.demo_scans(0)
    plot.hypotheses(tmp_path / "a.svg", nonsac.register_clouds(scans.source, scans.target))
    assert "trusted" in (tmp_path / "a.svg").read_text()


def test_refused(tmp_path):
    with pytest.raises(TypeError, match=r"result must be the Result of a call, such as nonsac\.relative_pose, got 3"):
        plot.hypotheses(tmp_path / "a.png", 3)
    with pytest.raises(TypeError, match="result must be the Result of a call"):
        plot.hypotheses(tmp_path / "a.png", replace(made(FOUR), evidence=None))
    with pytest.raises(TypeError, match="title must be a string, got 5"):
        plot.hypotheses(tmp_path / "a.png", made(FOUR), 5)
    with pytest.raises(ValueError, match=r"expected a picture that ends in .png, .pdf or .svg"):
        plot.hypotheses(tmp_path / "a.gif", made(FOUR))
