"""Pictures of matched points. What is drawn is read from the figure, in inches on the page."""

import struct

import numpy as np
import pytest

from nonsac import plot, simulate
from nonsac.plot import epipolar, figures, images, views

pytest.importorskip("matplotlib")

K = np.array([[400.0, 0, 320], [0, 400, 240], [0, 0, 1]])
SIZE = (640, 480)
# Two images of 640 x 480 share the 14 inches less margins and gap: 6.575 inches each, from 0.3 and 7.125 on.
SCALE = 6.575 / 640
LEFT1, LEFT2 = 0.3, 7.125


def skew(t):
    return np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])


def two_images(rng, n=60, outlier_ratio=0.4, noise=0.0):
    """Matches in pixels, which are inliers, and the fundamental matrix."""
    data = simulate.relative_pose(n, outlier_ratio, noise, rng)
    focal, middle = np.array([300.0, 200.0]), np.array([320.0, 240.0])
    inverse = np.diag([1 / 300, 1 / 200, 1.0]) @ [[1, 0, -320], [0, 1, -240], [0, 0, 1]]
    F = inverse.T @ skew(data.T[:3, 3]) @ data.T[:3, :3] @ inverse
    return data.points1 * focal + middle, data.points2 * focal + middle, data.inliers, F


def page(points, left):
    return (points + 0.5) * SCALE + [left, 0.0]


@pytest.fixture
def drawn(monkeypatch):
    """The figures, instead of files."""
    kept = []
    monkeypatch.setattr(images, "write", lambda path, figure, suffix: kept.append(figure))
    return kept


def segments(axes):
    """Line segments, shape (k, 2, 2), their colours and their level, for each collection."""
    return [(np.array(c.get_segments()), c.get_colors(), c.get_zorder()) for c in axes.collections]


def dots(axes, marker="o"):
    return [(line.get_xydata(), line.get_color()) for line in axes.lines if line.get_marker() == marker]


def texts(figure):
    """All that is written, with its box in pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    written = list(figure.texts)
    for axes in figure.axes:
        legend = axes.get_legend()
        written += [*axes.texts, *(legend.get_texts() if legend else ())]
    return [(text.get_text(), text.get_window_extent(canvas.get_renderer())) for text in written if text.get_text()]


def words(figure):
    return " | ".join(text for text, _ in texts(figure))


def assert_tidy(figure):
    """No text leaves the page or lies on another one, the numbers at points aside."""
    boxes = [(text, box) for text, box in texts(figure) if not text.isdigit()]
    width, height = figure.get_size_inches() * figure.dpi
    for k, (text, box) in enumerate(boxes):
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height, text  # noqa: PT018
        assert not any(box.overlaps(other) for _, other in boxes[:k]), text


def png_size(path):
    content = path.read_bytes()
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", content[16:24])


# --- matches -------------------------------------------------------------


def test_matches_joins_each_point_with_its_partner(drawn, rng):
    points1, points2, inliers, _ = two_images(rng)
    plot.matches("a.png", points1, points2, inliers, SIZE, SIZE)
    (axes,) = drawn[0].axes
    pale, strong = segments(axes)
    for (lines, colours, _), chosen, colour in ((pale, ~inliers, figures.ORANGE), (strong, inliers, figures.BLUE)):
        np.testing.assert_allclose(lines[:, 0], page(points1[chosen], LEFT1))
        np.testing.assert_allclose(lines[:, 1], page(points2[chosen], LEFT2))
        np.testing.assert_allclose(colours[0, :3], colour)
    assert pale[2] < strong[2]
    assert sum(len(places) for places, _ in dots(axes)) == 2 * len(inliers)
    assert "36 inliers | 24 outliers" in words(drawn[0])
    assert "at random" not in words(drawn[0])


def test_of_many_matches_a_representative_few_get_lines(drawn, rng):
    points1, points2, inliers, _ = two_images(rng, n=5000)
    plot.matches("a.png", points1, points2, inliers, SIZE, SIZE)
    (axes,) = drawn[0].axes
    pale, strong = (len(lines) for lines, _, _ in segments(axes))
    assert pale + strong == 500
    assert 250 < strong < 350
    assert sum(len(places) for places, _ in dots(axes)) == 10_000
    assert "3,000 inliers | 2,000 outliers" in words(drawn[0])
    assert "lines for 500 matches, chosen at random" in words(drawn[0])


def test_rows_that_are_not_finite_are_left_out(drawn, rng):
    points1, points2, inliers, F = two_images(rng)
    points1[np.flatnonzero(inliers)[0]] = np.nan
    points2[np.flatnonzero(~inliers)[0], 1] = np.inf
    plot.two_views("a.png", points1, points2, inliers, F, SIZE, SIZE)
    assert "35 inliers | 23 outliers" in words(drawn[0])
    assert "12 of 35 inliers" in words(drawn[0])


def test_what_is_outside_is_counted_but_not_drawn(drawn, rng):
    points1, points2, inliers, F = two_images(rng)
    first = np.flatnonzero(inliers)[0]
    points1[first] = [640.0, 100.0]
    plot.two_views("a.png", points1, points2, inliers, F, SIZE, SIZE)
    assert "36 inliers" in words(drawn[0])
    assert "1 match outside, not drawn" in words(drawn[0])
    assert sum(len(places) for places, _ in dots(drawn[0].axes[0])) == 2 * 59
    points1[first] = [639.4, 479.4]  # the edge of the last pixel is half a pixel from its centre
    plot.two_views("a.png", points1, points2, inliers, F, SIZE, SIZE)
    assert "outside" not in words(drawn[1])


def test_without_sizes_the_bounding_box_stands_in(drawn, rng):
    points = rng.uniform(-1, 1, (30, 2))
    plot.matches("a.png", points, 3 * points + 5, np.ones(30, bool))
    (axes,) = drawn[0].axes
    lines = segments(axes)[1][0]
    frames = [patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches]
    for end, frame in enumerate(frames):
        assert frame.x0 < lines[:, end, 0].min() < lines[:, end, 0].max() < frame.x1
        margin = (frame.width - np.ptp(lines[:, end, 0])) / frame.width
        assert margin == pytest.approx(1 - 1 / 1.05)
    # Both boxes show the same, so that all lines are parallel and of one length.
    assert np.ptp(lines[:, 1] - lines[:, 0], axis=0).max() < 1e-9
    assert "px" not in words(drawn[0])


@pytest.mark.parametrize(
    "sizes", [(SIZE, (480, 640)), ((1000, 100), (1000, 100)), ((300, 3000), (20, 10)), (None, SIZE)]
)
def test_the_page_has_room_for_images_of_all_shapes(drawn, rng, sizes):
    points = rng.uniform(0, 9, (20, 2))
    plot.two_views("a.png", points, points, np.arange(20) < 8, skew([1.0, 0.2, 0.1]), *sizes, title="A title")
    figure = drawn[0]
    assert 10 <= figure.get_size_inches()[0] <= 14.001
    for axes in figure.axes:
        frames = [patch.get_extents() for patch in axes.patches]
        assert len({round(frame.height) for frame in frames}) == 1
        assert 0 < frames[0].x0 < frames[0].x1 < frames[1].x0 < frames[1].x1 < figure.get_size_inches()[0] * figure.dpi
        for frame, size in zip(frames, sizes, strict=True):
            if size is not None:
                assert abs(frame.width / frame.height) == pytest.approx(size[0] / size[1])
    assert_tidy(figure)


# --- epipolar lines ------------------------------------------------------


def test_points_lie_on_the_lines_of_their_colour(drawn, rng):
    points1, points2, inliers, F = two_images(rng)
    plot.epipolar_lines("a.png", points1, points2, inliers, F, SIZE, SIZE)
    (axes,) = drawn[0].axes
    places, lines = dots(axes), segments(axes)
    assert len(places) == len(lines) == 24
    assert [colour for _, colour in places[:12]] == [colour for _, colour in places[12:]] == list(images._COLOURS)
    for (place, _), ((start, end),) in zip(places, (line for line, _, _ in lines), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        across = place[0] - start
        assert abs(across[0] * along[1] - across[1] * along[0]) < 1e-6
        assert 0 <= across @ along <= np.linalg.norm(end - start)
    # They are matches, too.
    shown = [place[0] for place, _ in places]
    for first, second in zip(shown[:12], shown[12:], strict=True):
        row = np.argmin(np.linalg.norm(page(points1, LEFT1) - first, axis=1))
        np.testing.assert_allclose(page(points1, LEFT1)[row], first)
        np.testing.assert_allclose(page(points2, LEFT2)[row], second)
        assert inliers[row]
    assert [text for text, _ in texts(drawn[0]) if text.isdigit()] == 2 * [str(k) for k in range(1, 13)]


def test_lines_end_at_the_edge_of_their_image(drawn, rng):
    points1, points2, inliers, F = two_images(rng)
    plot.epipolar_lines("a.png", points1, points2, inliers, F, SIZE, SIZE)
    lines = np.concatenate([line for line, _, _ in segments(drawn[0].axes[0])])
    for ends, left in ((lines[:12], LEFT1), (lines[12:], LEFT2)):
        x, y = np.abs((ends - [left, 0]) / SCALE - [320, 240]).reshape(-1, 2).T
        np.testing.assert_allclose(np.maximum(x / 320, y / 240), 1.0)


def test_the_legend_tells_the_median_distance_from_the_lines(drawn):
    """A pair moved sideways: lines are rows of the image. Two of three partners lie 3 pixels beside them."""
    points1 = np.array([[100.0, 100], [200, 200], [300, 300], [400, 400]])
    points2 = points1 + np.array([[50.0, 0], [60, 3], [70, -3], [80, 90]])
    plot.epipolar_lines("a.png", points1, points2, np.arange(4) < 3, 7.0 * skew([1.0, 0, 0]), SIZE, SIZE)
    assert "3 of 3 inliers" in words(drawn[0])
    assert words(drawn[0]).endswith("lines: 3 px | 3 of 3 inliers, each with the epipolar line of its partner")


def test_shown_points_and_lines_are_far_apart(rng):
    """Of four clusters of points, each at both ends of a line, all eight places are found."""
    rows = np.repeat([50.0, 150, 250, 350], 60)
    points = np.stack([np.tile([80.0, 560], 120), rows], axis=1) + rng.normal(0, 2.0, (240, 2))
    lines = np.stack([np.zeros(240), np.ones(240), -points[:, 1]], axis=1)
    view = views.View(np.zeros(2), np.array([640.0, 480]), None, "")
    chosen = epipolar.far_apart(epipolar.places_and_lines(points, lines, view), 8)
    assert len({(round(x / 480), round(y / 100 - 0.5)) for x, y in points[chosen]}) == 8


def test_lines_of_a_pencil_are_chosen_by_their_angle():
    """Points at one place, but for a hair, on lines of all directions: the chosen ones part by at least 30 degrees."""
    angles = np.linspace(0, np.pi, 90, endpoint=False)
    lines = np.stack([np.cos(angles), np.sin(angles), np.zeros(90)], axis=1)
    view = views.View(np.full(2, -1.0), np.full(2, 2.0), None, "")
    chosen = np.sort(epipolar.far_apart(epipolar.places_and_lines(np.zeros((90, 2)), lines, view), 4))
    gaps = np.diff(np.append(angles[chosen], angles[chosen[0]] + np.pi))
    assert np.degrees(gaps.min()) > 30


def test_lines_that_nearly_coincide_are_avoided(rng):
    """Parallel lines: the 12 chosen of 100 points lie in rows 2 % of the height apart, or more, on both sides."""
    points = rng.uniform(0, [640, 480], (100, 2))
    lines = np.stack([np.zeros(100), np.ones(100), -points[:, 1]], axis=1)
    view = views.View(np.zeros(2), np.array([640.0, 480]), None, "")
    x, y = points[epipolar.far_apart(epipolar.places_and_lines(points, lines, view), 12)].T
    assert np.diff(np.sort(y)).min() > 0.02 * 480
    assert min(np.count_nonzero(x < 320), np.count_nonzero(x > 320)) >= 2


def test_the_same_point_is_shown_once():
    places = np.repeat([[0.0, 1.0], [2.0, 3.0]], 5, axis=0)
    assert len(epipolar.far_apart(places, 12)) == 2


@pytest.mark.parametrize(
    ("line", "ends"),
    [
        ([1, 0, -3], [[3, 1], [3, 6]]),
        ([0, 2, -4], [[2, 2], [12, 2]]),
        ([1, -1, 0], [[2, 2], [6, 6]]),
        ([-1, -1, 5], [[2, 3], [4, 1]]),
        ([1, 0, -1], None),
        ([0, 1, -6.5], None),
        ([1, 1, -2.5], None),
        ([0, 0, 1], None),
    ],
)
def test_clip_by_hand(line, ends):
    view = views.View(np.array([2.0, 1.0]), np.array([10.0, 5.0]), None, "")
    (clipped,) = epipolar.clip(np.array([line], dtype=float), view)
    if ends is None:
        assert np.isnan(clipped).all()
    else:
        np.testing.assert_allclose(clipped[np.argsort(clipped[:, 0] + 0.01 * clipped[:, 1])], ends, atol=1e-12)


def test_distances_from_lines_by_hand():
    lines = np.array([[3.0, 4, -5], [0, 2, 2], [0, 0, 1]])
    np.testing.assert_allclose(epipolar.distances_from_lines(np.zeros((3, 2)), lines), [1, 1, np.inf])


# --- both ----------------------------------------------------------------


def test_two_views_draws_both(drawn, rng):
    points1, points2, inliers, F = two_images(rng)
    both = (points1, points2, inliers)
    plot.two_views("a.png", *both, F, SIZE, SIZE, title="A title")
    plot.matches("a.png", *both, SIZE, SIZE)
    plot.epipolar_lines("a.png", *both, F, SIZE, SIZE)
    upper, lower = drawn[0].axes
    for axes, alone in ((upper, drawn[1].axes[0]), (lower, drawn[2].axes[0])):
        for (ours, _, _), (theirs, _, _) in zip(segments(axes), segments(alone), strict=True):
            np.testing.assert_allclose(ours, theirs)
    assert upper.get_position().y0 > lower.get_position().y0
    assert_tidy(drawn[0])
    assert "A title" in words(drawn[0])


@pytest.mark.parametrize("F", [np.full((3, 3), np.nan), np.zeros((3, 3))])
def test_a_failed_pose_is_said_so(drawn, rng, F):
    points1, points2, inliers, _ = two_images(rng)
    plot.two_views("a.png", points1, points2, inliers, F, SIZE, SIZE)
    assert "no trusted pose" in words(drawn[0])
    assert not drawn[0].axes[1].collections


def test_no_inliers(drawn, rng):
    points1, points2, inliers, F = two_images(rng)
    plot.two_views("a.png", points1, points2, np.zeros_like(inliers), F, SIZE, SIZE)
    assert "0 inliers | 60 outliers" in words(drawn[0])
    assert words(drawn[0]).endswith("no inliers")
    plot.two_views("a.png", points1 - 9999, points2, inliers, F, SIZE, SIZE)
    assert "60 matches outside, not drawn" in words(drawn[1])
    assert words(drawn[1]).endswith("no inliers in the images")


def test_one_match(tmp_path):
    path = tmp_path / "one.png"
    plot.two_views(path, [[1, 2]], [[3, 4]], [True], skew([1.0, 0, 0]))
    assert path.stat().st_size > 1000


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
@pytest.mark.parametrize("draw", [plot.epipolar_lines, plot.two_views])
def test_files_are_written_and_the_same_each_time(tmp_path, monkeypatch, rng, suffix, draw):
    monkeypatch.setattr(figures, "_DPI", 50)
    data = two_images(rng, n=600)
    for name in ("a", "b"):
        draw(tmp_path / (name + suffix), *data, SIZE, SIZE, image1=np.eye(9), title="A title")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()
    assert len(list(tmp_path.iterdir())) == 2


def test_a_picture_is_2100_pixels_wide(tmp_path, rng):
    points1, points2, inliers, _ = two_images(rng)
    plot.matches(tmp_path / "a.png", points1, points2, inliers, SIZE, SIZE)
    assert png_size(tmp_path / "a.png") == (2100, round(150 * (0.1 + 0.32 + 480 * SCALE + 0.75)))


# --- images --------------------------------------------------------------


def test_images_are_drawn_in_pale_grey(drawn, tmp_path):
    from matplotlib.image import imsave

    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:20] = 255
    pixels[:, 30:, :2] = 0
    imsave(tmp_path / "a.png", pixels)
    imsave(tmp_path / "b.jpg", pixels[:, :30], pil_kwargs={"quality": 95})
    grey = pixels @ [0.299, 0.587, 0.114] / 255
    points = np.array([[5.0, 6.0]])
    for image in (pixels, grey, tmp_path / "a.png", str(tmp_path / "a.png")):
        plot.matches("a.png", points, points, [True], image1=image, image2=tmp_path / "b.jpg")
        first, second = (picture.get_array() for picture in drawn.pop().axes[0].images)
        np.testing.assert_allclose(first, 0.45 + 0.55 * grey, atol=1e-6)
        assert second.shape == (40, 30)


def test_an_image_fills_its_outline_and_tells_its_size(drawn, rng):
    points1, points2, inliers, _ = two_images(rng)
    plot.matches("a.png", points1, points2, inliers, None, SIZE, np.ones((480, 640)), np.ones((48, 64)))
    (axes,) = drawn[0].axes
    first, second = (picture.get_extent() for picture in axes.images)
    np.testing.assert_allclose(first, [LEFT1, LEFT1 + 6.575, 480 * SCALE, 0])
    np.testing.assert_allclose(second, [LEFT2, LEFT2 + 6.575, 480 * SCALE, 0])
    np.testing.assert_allclose(segments(axes)[1][0][:, 0], page(points1[inliers], LEFT1))


# --- reprojections -------------------------------------------------------

SINGLE = 8.0 / 480  # a single image is 8 inches high


def a_projection(rng, n=50):
    observed = rng.uniform(0, [639, 479], (n, 2))
    return observed, observed + np.array([0.3, -0.4]), np.arange(n) < 0.6 * n


def test_reprojections_joins_observed_and_projected(drawn, rng):
    observed, projected, inliers = a_projection(rng)
    projected[~inliers] = np.nan
    plot.reprojections("a.png", observed, projected, inliers, SIZE, title="A title")
    (axes,) = drawn[0].axes
    ((lines, _, _),) = segments(axes)
    left = axes.patches[0].get_x()
    np.testing.assert_allclose(lines[:, 0], (observed[inliers] + 0.5) * SINGLE + [left, 0])
    np.testing.assert_allclose(lines[:, 1], (projected[inliers] + 0.5) * SINGLE + [left, 0])
    pale, strong, _, rings = (places for places, _ in dots(axes))
    np.testing.assert_allclose(pale, (observed[~inliers] + 0.5) * SINGLE + [left, 0])
    np.testing.assert_allclose(strong, lines[:, 0])
    np.testing.assert_allclose(rings, lines[:, 1])
    assert "30 inliers | projected | 20 outliers" in words(drawn[0])
    assert "median distance of all inliers: 0.5 px" in words(drawn[0])
    assert_tidy(drawn[0])


def test_reprojections_leaves_out_what_cannot_be_drawn(drawn, rng):
    observed, projected, inliers = a_projection(rng)
    observed[0], projected[1], observed[49], projected[48] = np.nan, np.nan, np.nan, np.nan
    observed[2] = projected[2] = -5.0
    plot.reprojections("a.png", observed, projected, inliers, SIZE)
    assert "28 inliers | projected | 19 outliers" in words(drawn[0])
    assert "1 point outside, not drawn" in words(drawn[0])
    assert len(segments(drawn[0].axes[0])[0][0]) == 27


def test_reprojections_of_many(drawn, rng):
    observed, projected, inliers = a_projection(rng, 40_000)
    observed[:1234] = -9.0
    plot.reprojections("a.png", observed, projected, inliers, (480, 480), title="A title")
    (axes,) = drawn[0].axes
    assert len(segments(axes)[0][0]) == 200
    assert "rings for 200 inliers, chosen at random" in words(drawn[0])
    assert "24,000 inliers | projected | 16,000 outliers" in words(drawn[0])
    assert_tidy(drawn[0])


def test_reprojections_of_normalised_points_without_inliers(tmp_path):
    points = [[0.1, 0.2], [0.3, -0.2]]
    plot.reprojections(tmp_path / "a.svg", points, np.full((2, 2), np.nan), [False, False])
    text = (tmp_path / "a.svg").read_text()
    assert "<!-- 0 inliers -->" in text
    assert "<!-- 2 outliers -->" in text
    assert "median" not in text


def test_reprojections_onto_an_image(drawn, rng):
    observed, projected, inliers = a_projection(rng)
    plot.reprojections("a.png", observed, projected, inliers, image=np.zeros((480, 640), np.uint16))
    (picture,) = drawn[0].axes[0].images
    np.testing.assert_allclose(picture.get_array(), 0.45)


# --- refusals ------------------------------------------------------------


@pytest.mark.parametrize("draw", [plot.matches, plot.epipolar_lines, plot.two_views])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": "a.jpg"}, r"^path is 'a.jpg'; expected .*\.png, \.pdf or \.svg"),
        ({"points1": np.zeros((5, 3))}, r"^points1 has shape \(5, 3\); expected \(n, 2\)"),
        ({"points1": np.zeros(5)}, r"^points1 has shape \(5,\); expected \(n, 2\)"),
        ({"points2": np.zeros((4, 2))}, r"^points2 has shape \(4, 2\); expected \(5, 2\)"),
        ({"points2": np.full((5, 2), np.nan)}, "^points1 and points2 have no finite row in common; expected"),
        ({"inliers": np.ones(4, bool)}, r"^inliers has shape \(4,\) of bool; expected \(5,\) of bool"),
        ({"inliers": [0, 1, 1, 1, 0]}, r"^inliers has shape \(5,\) of int64; expected \(5,\) of bool"),
        ({"size1": (640,)}, r"^size1 is \(640,\); expected a width and a height above 0"),
        ({"size2": (640, 0)}, r"^size2 is \(640, 0\); expected"),
        ({"size2": (np.nan, 1)}, r"^size2 is \(nan, 1\); expected"),
        ({"image1": np.zeros((4, 4, 2))}, r"^image1 has shape \(4, 4, 2\); expected \(h, w\), \(h, w, 3\)"),
        ({"image2": np.zeros((0, 4))}, r"^image2 has shape \(0, 4\); expected"),
    ],
)
def test_two_images_are_refused(tmp_path, monkeypatch, rng, draw, change, message):
    monkeypatch.chdir(tmp_path)
    arguments = {"path": "a.png", "points1": rng.random((5, 2)), "points2": rng.random((5, 2))}
    arguments |= {"inliers": np.ones(5, bool)} | ({} if draw is plot.matches else {"F": np.eye(3)})
    with pytest.raises(ValueError, match=message):
        draw(**arguments | change)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("draw", [plot.epipolar_lines, plot.two_views])
def test_a_wrong_shape_of_F_is_refused(draw):
    with pytest.raises(ValueError, match=r"^F has shape \(4, 4\); expected \(3, 3\)"):
        draw("a.png", [[0, 0]], [[1, 1]], [True], np.eye(4))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": "a"}, r"^path is 'a'; expected"),
        ({"points2d": np.zeros((5, 3))}, r"^points2d has shape \(5, 3\); expected \(n, 2\)"),
        ({"projected": np.zeros((5, 3))}, r"^projected has shape \(5, 3\); expected \(5, 2\)"),
        ({"projected": np.full((5, 2), np.nan)}, "^points2d and projected have no finite row in common; expected"),
        ({"inliers": np.ones(3, bool)}, r"^inliers has shape \(3,\)"),
        ({"size": (1, -1)}, r"^size is \(1, -1\); expected"),
        ({"image": np.zeros(3)}, r"^image has shape \(3,\); expected"),
    ],
)
def test_reprojections_refuses(tmp_path, monkeypatch, rng, change, message):
    monkeypatch.chdir(tmp_path)
    arguments = {"path": "a.png", "points2d": rng.random((5, 2)), "projected": rng.random((5, 2))}
    with pytest.raises(ValueError, match=message):
        plot.reprojections(**arguments | {"inliers": np.ones(5, bool)} | change)
    assert not list(tmp_path.iterdir())


def test_a_missing_image_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        plot.matches(tmp_path / "a.png", [[0, 0]], [[1, 1]], [True], image1=tmp_path / "nowhere.png")
