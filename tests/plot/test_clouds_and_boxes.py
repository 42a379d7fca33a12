import io
import os
import struct
import subprocess
import sys

import numpy as np
import pytest

from nonsac import plot
from nonsac.plot import box_plots, figures, point_clouds

pytest.importorskip("matplotlib")


def pixels(path_or_bytes):
    from matplotlib.image import imread

    return imread(io.BytesIO(path_or_bytes) if isinstance(path_or_bytes, bytes) else path_or_bytes)[:, :, :3]


def png_size(content):
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", content[16:24])


def inked(picture):
    """Share of the pixels that are not white."""
    return float(np.mean(picture.min(axis=2) < 0.97))


def two_clouds(n=400, offset=0.0):
    source = np.random.default_rng(0).random((n, 3)) + offset
    T = np.eye(4)
    T[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    T[:3, 3] = [0.5, 0.25, 1.0]
    return source, source @ T[:3, :3].T + T[:3, 3], T


@pytest.fixture
def small(monkeypatch):
    """Pictures of a third of the size, for speed."""
    monkeypatch.setattr(figures, "_DPI", 50)


def rows(path):
    """The two rows of panels, without titles and labels."""
    picture = pixels(path)
    height, width = picture.shape[:2]
    left = int(0.035 * width)
    return picture[int(0.10 * height) : int(0.49 * height), left:], picture[
        int(0.53 * height) : int(0.95 * height), left:
    ]


def row_inks(path):
    before, after = rows(path)
    return inked(before), inked(after)


def test_clouds_writes_a_picture_of_both_rows(tmp_path):
    path = tmp_path / "clouds.png"
    plot.clouds(path, *two_clouds(), title="overlap 100 %, turned by 90 degrees")
    assert png_size(path.read_bytes()) == (1800, 1200)
    assert min(row_inks(path)) > 0.02
    assert [file.name for file in tmp_path.iterdir()] == ["clouds.png"]


def test_clouds_shows_the_alignment(tmp_path, small):
    """Each row equals a picture of what should be in it: the clouds as they are, then those that T moved."""
    both, done = tmp_path / "both.png", tmp_path / "done.png"
    source, target, T = two_clouds()
    target = target + 0.02 * np.random.default_rng(1).standard_normal(target.shape)  # no ties in depth
    plot.clouds(both, source, target, T)
    plot.clouds(done, source @ T[:3, :3].T + T[:3, 3], target, np.eye(4))
    before, after = rows(both)
    same = rows(done)[1]
    assert np.mean(np.abs(after - same) > 0.05) < 1e-3
    assert not np.array_equal(before[: len(after)], after[: len(before)])


def test_clouds_says_when_there_is_no_alignment(tmp_path, small):
    path = tmp_path / "failed.png"
    source, target, _ = two_clouds()
    plot.clouds(path, source, target, np.full((4, 4), np.nan))
    before, after = row_inks(path)
    assert before > 0.02
    assert 0.0005 < after < 0.02
    svg = tmp_path / "failed.svg"
    plot.clouds(svg, source, target, np.full((4, 4), np.nan))
    assert "no trusted alignment" in svg.read_text()


def test_clouds_far_from_the_origin_look_the_same(tmp_path, small):
    near, far = tmp_path / "near.png", tmp_path / "far.png"
    source, target, T = two_clouds()
    target = target + 0.02 * np.random.default_rng(1).standard_normal(target.shape)  # no ties in depth
    shift = np.array([1e7, -2e7, 3e5])
    plot.clouds(near, source, target, T)
    moved = T.copy()
    moved[:3, 3] += shift - T[:3, :3] @ shift
    plot.clouds(far, source + shift, target + shift, moved)
    assert np.mean(np.abs(pixels(near) - pixels(far)) > 0.05) < 1e-3


@pytest.mark.parametrize("n", [1, 5])
def test_clouds_of_few_points(tmp_path, small, n):
    plot.clouds(tmp_path / "few.png", *two_clouds(n))
    assert inked(pixels(tmp_path / "few.png")) > 0


def test_clouds_in_one_plane_or_one_point(tmp_path, small):
    flat = np.random.default_rng(0).random((50, 3)) * [1, 1, 0]
    plot.clouds(tmp_path / "flat.png", flat, flat, np.eye(4))
    plot.clouds(tmp_path / "point.png", np.zeros((9, 3)), np.zeros((9, 3)), np.eye(4))
    assert inked(pixels(tmp_path / "point.png")) > 0


def test_clouds_thins_and_leaves_out_what_is_not_finite():
    cloud = np.random.default_rng(0).random((70_000, 3)).astype(np.float32)
    cloud[::2] = np.nan
    drawn = point_clouds._thin("source", cloud)
    assert drawn.shape == (8000, 3)
    assert drawn.dtype == np.float64
    assert np.isfinite(drawn).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": "a.jpg"}, r"^path is 'a.jpg'; expected .*\.png, \.pdf or \.svg"),
        ({"path": "a"}, r"^path is 'a'; expected"),
        ({"source": np.zeros((3, 2))}, r"^source has shape \(3, 2\); expected \(n, 3\)"),
        ({"target": np.full((3, 3), np.nan)}, "^target has no finite point"),
        ({"target": np.zeros((0, 3))}, "^target has no finite point"),
        ({"T": np.eye(3)}, r"^T has shape \(3, 3\); expected \(4, 4\)"),
    ],
)
def test_clouds_refuses(tmp_path, monkeypatch, change, message):
    monkeypatch.chdir(tmp_path)
    source, target, T = two_clouds(5)
    arguments = {"path": "a.png", "source": source, "target": target, "T": T, **change}
    with pytest.raises(ValueError, match=message):
        plot.clouds(**arguments)
    assert not list(tmp_path.iterdir())


def trials():
    rng = np.random.default_rng(0)
    errors = {name: np.exp(rng.normal(1, 1, 30)) for name in ("ideal", "most_inliers", "tlp_0.1", "refined")}
    errors["tlp_0.1"][:2] = np.nan
    errors["refined"][:2] = 0.0
    return errors, {"hypotheses": rng.gamma(50, 0.01, 30), "refined": rng.gamma(50, 0.02, 30)}


def test_boxplot_writes_a_picture(tmp_path):
    path = tmp_path / "box.png"
    plot.boxplot(path, *trials(), paper={"tlp_0.1": 3.0, "hypotheses": 30.0})
    assert png_size(path.read_bytes()) == (2100, 1200)
    assert inked(pixels(path)[130:970, 130:1470]) > 0.02
    assert inked(pixels(path)[130:970, 1630:2050]) > 0.02


def test_boxplot_names_and_numbers_the_rules(tmp_path):
    plot.boxplot(tmp_path / "box.svg", *trials())
    text = (tmp_path / "box.svg").read_text()
    for label in ("1  ideal", "2  most inliers", "3  tlp 0.1", "refined", "degrees", "seconds"):
        assert f"<!-- {label} -->" in text
    assert "4  refined" not in text
    assert "published" not in text


def test_a_failed_trial_is_drawn_as_the_worst_and_a_perfect_one_as_the_best():
    np.testing.assert_array_equal(box_plots._drawable_angles(np.array([np.nan, 0.0, 5.0, 180.0])), [180, 0.01, 5, 180])


@pytest.mark.parametrize(
    ("errors", "times", "paper", "message"),
    [
        ({}, {"a": [1.0]}, None, "^errors is empty"),
        ({"a": []}, {"a": [1.0]}, None, "^errors has no numbers for 'a'"),
        ({"a": [1.0]}, {}, None, "^times is empty"),
        ({"a": [1.0]}, {"b": [1.0]}, {"c": 1.0}, "^paper has the key 'c'"),
    ],
)
def test_boxplot_refuses(tmp_path, errors, times, paper, message):
    with pytest.raises(ValueError, match=message):
        plot.boxplot(tmp_path / "a.png", errors, times, paper)


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")])
def test_render_gives_the_same_bytes_each_time(suffix, magic):
    def content():
        figure = figures.new_figure(2.0, 1.0)
        figure.add_axes((0.2, 0.2, 0.7, 0.7)).plot([0, 1], [1, 0])
        return plot.render(figure, suffix)

    assert content().startswith(magic)
    assert content() == content()
    assert b"date" not in content().lower()


def test_render_refuses_other_suffixes():
    with pytest.raises(ValueError, match=r"^suffix is '.gif'; expected"):
        plot.render(figures.new_figure(1.0, 1.0), ".gif")


def test_import_is_cheap_and_pictures_need_no_display(tmp_path):
    script = (
        "import sys; from nonsac import plot; assert 'matplotlib' not in sys.modules; "
        "plot.boxplot(sys.argv[1], {'a': [1.0]}, {'b': [1.0]}); "
        "plot.two_views(sys.argv[1], [[1, 2]], [[3, 4]], [True], [[0, 0, 1]] * 3, image1=[[0, 1], [2, 3]]); "
        "plot.reprojections(sys.argv[1], [[1, 2]], [[3, 4]], [True]); "
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    path = tmp_path / "a.png"
    subprocess.run([sys.executable, "-W", "error", "-c", script, str(path)], check=True, env=headless())
    assert path.stat().st_size > 1000


def headless():
    return {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}


def test_diamonds_say_what_they_are(tmp_path):
    plot.boxplot(tmp_path / "a.svg", {"ideal": [1.0]}, {"hypotheses": [2.0]}, {"hypotheses": 30.0}, label="MATLAB")
    assert "MATLAB" in (tmp_path / "a.svg").read_text()
