"""Optical flow as matches: arrays of RAFT, files of Middlebury and KITTI, archives."""

import struct
import zlib

import numpy as np
import pytest

import nonsac
from match_samples import kitti, middlebury, png
from nonsac.calls.jobs import Job
from nonsac.io import InputError, flow, from_flow, open_matches, read_matches
from nonsac.layouts import MATCHES, PAIRS

# Two rows of three pixels.
MOVES = np.array([[[1.0, 0], [2, 0.5], [0, -1]], [[0.25, 4], [-3, -3], [0, 0]]])
PIXELS = np.array([[0.0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])


def damaged(content, place):
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


@pytest.mark.parametrize(
    "array",
    [MOVES, MOVES.astype(np.float32), MOVES.transpose(2, 0, 1), MOVES.transpose(2, 0, 1)[None], MOVES[None]],
    ids=["h w 2", "single", "2 h w", "batch of one", "batch of h w 2"],
)
def test_each_pixel_and_where_it_goes(array):
    matches = from_flow(array)
    np.testing.assert_array_equal(matches.points1, PIXELS)
    np.testing.assert_array_equal(matches.points2, PIXELS + MOVES.reshape(-1, 2))
    assert matches.weights is None
    assert matches.points1.dtype == matches.points2.dtype == np.float64


@pytest.mark.parametrize("unknown", [np.nan, np.inf, -np.inf, 1e10, -1.6e9])
def test_where_there_is_no_flow_there_is_no_match(unknown):
    moves = MOVES.copy()
    moves[0, 1, 1] = unknown
    matches = from_flow(moves)
    np.testing.assert_array_equal(matches.points1, np.delete(PIXELS, 1, axis=0))


@pytest.mark.parametrize("batch", [False, True])
def test_certainties_are_weights_and_those_of_zero_are_left_out(batch):
    trust = np.array([[0.5, 0, 1], [0.25, -1, np.nan]])
    matches = from_flow(MOVES, trust[None] if batch else trust)
    np.testing.assert_array_equal(matches.points1, PIXELS[[0, 2, 3]])
    np.testing.assert_array_equal(matches.weights, [0.5, 1, 0.25])
    np.testing.assert_array_equal(from_flow(MOVES, trust > 0).weights, [1, 1, 1])


def test_a_draw_is_without_replacement_in_order_and_by_certainty(rng):
    moves, trust = rng.standard_normal((40, 50, 2)), np.ones((40, 50))
    trust[:, 25:] = 1e-4
    first, again = (from_flow(moves, trust, 200, rng=3) for _ in range(2))
    np.testing.assert_array_equal(first.points1, again.points1)
    places = first.points1 @ [1, 50]
    assert (np.diff(places) > 0).all()
    assert (first.points1[:, 0] < 25).mean() > 0.95
    assert first.weights is None
    plain = from_flow(moves, count=200).points1
    assert len(plain) == 200
    assert 0.3 < (plain[:, 0] < 25).mean() < 0.7
    assert len(from_flow(moves, count=5000)) == 2000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            (np.zeros((4, 3, 1)),),
            r"flow has shape \(4, 3, 1\); expected \(H, W, 2\) or \(2, H, W\), of one pair of images",
        ),
        ((np.zeros((2, 2, 4, 5)),), r"flow has shape \(2, 2, 4, 5\)"),
        ((MOVES, np.ones((3, 2))), r"certainty has shape \(3, 2\); expected \(2, 3\), as flow has"),
        ((MOVES, None, 0), "count is 0; expected at least 1"),
        ((MOVES.astype(complex),), "flow has the type complex128"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        from_flow(*arguments)


def test_middlebury(tmp_path):
    moves = MOVES.copy()
    moves[1, 1] = 1e10  # unknown
    (tmp_path / "a.flo").write_bytes(middlebury(moves))
    matches = read_matches(tmp_path / "a.flo")
    expected = from_flow(MOVES, np.array([[1, 1, 1], [1, 0, 1]]))
    np.testing.assert_array_equal(matches.points1, expected.points1)
    np.testing.assert_array_equal(matches.points2, expected.points2)
    assert matches.weights is None
    (tmp_path / "other").write_bytes(middlebury(moves))
    assert len(open_matches(MATCHES, [tmp_path / "other"]).source) == 5


def test_kitti(tmp_path):
    known = np.array([[1, 1, 0], [1, 1, 1]])
    (tmp_path / "a.png").write_bytes(kitti(MOVES, known))
    matches = read_matches(tmp_path / "a.png")
    np.testing.assert_array_equal(matches.points1, PIXELS[[0, 1, 3, 4, 5]])
    np.testing.assert_array_equal(matches.points2, (PIXELS + MOVES.reshape(-1, 2))[[0, 1, 3, 4, 5]])
    assert matches.weights is None


def test_kitti_as_opencv_writes_it(tmp_path, rng):
    """With all filters of PNG."""
    cv2 = pytest.importorskip("cv2")
    moves = np.round(rng.uniform(-400, 400, (30, 40, 2)) * 64) / 64
    picture = np.dstack([np.ones((30, 40)), moves[:, :, ::-1] * 64 + 2**15]).astype(np.uint16)
    assert cv2.imwrite(str(tmp_path / "a.png"), picture)
    np.testing.assert_array_equal(read_matches(tmp_path / "a.png").points2, from_flow(moves).points2)


def test_parts_of_a_png_that_hold_no_pixels_are_passed_over(tmp_path):
    content = kitti(MOVES, np.ones((2, 3)))
    text = b"tEXtComment\0by nobody"
    extra = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
    (tmp_path / "a.png").write_bytes(content[:33] + extra + content[33:] + b"after the end")
    assert len(read_matches(tmp_path / "a.png")) == 6


def test_without_opencv_a_png_is_refused_in_one_sentence(tmp_path, monkeypatch):
    (tmp_path / "a.png").write_bytes(kitti(MOVES, np.ones((2, 3))))
    monkeypatch.setattr(flow, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r'which only OpenCV reads; pip install "nonsac\[opencv\]", or save'):
        read_matches(tmp_path / "a.png")


@pytest.mark.parametrize("holds", ["certainty", "valid", None])
def test_archives(tmp_path, holds):
    trust = np.array([[1.0, 0, 1], [1, 1, 1]])
    np.savez(tmp_path / "a.npz", flow=MOVES.transpose(2, 0, 1)[None], **({} if holds is None else {holds: trust}))
    matches, expected = read_matches(tmp_path / "a.npz"), from_flow(MOVES, None if holds is None else trust)
    np.testing.assert_array_equal(matches.points2, expected.points2)
    assert (matches.weights is None) == (holds is None)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.flo", middlebury(MOVES)[:-1], r"promises 3 x 2 pixels, it holds 5\.875"),
        ("a.flo", middlebury(MOVES) + b"1234", "promises 3 x 2 pixels"),
        ("a.flo", middlebury(MOVES)[:8], "it ends within its header"),
        ("a.flo", struct.pack("<fii", 202021.25, -3, -2), "promises -3 x -2 pixels"),
        ("a.flo", struct.pack("<fii", 202021.25, 2**30, 2**30), "promises 1073741824 x 1073741824 pixels"),
        ("a.flo", b"1 2 3 4\n5 6 7 8\n", "is not a Middlebury flow file, it looks like a text table"),
        ("a.flo", b"", "the file is empty"),
        ("a.png", png(np.zeros((2, 3, 3)), depth=8), "is a picture, not the flow between two images"),
        ("a.png", png(np.zeros((2, 3)), colour=0), "is a picture, not the flow between two images"),
        ("a.png", kitti(MOVES, MOVES[:, :, 0] > 9)[:60], "is truncated or damaged"),
        ("a.png", kitti(MOVES, MOVES[:, :, 0] > 9)[:20], "it ends within its header"),
        ("a.png", damaged(kitti(MOVES, MOVES[:, :, 0] < 9), 45), "is truncated or damaged"),
        ("a.png", kitti(MOVES, MOVES[:, :, 0] < 9)[:33] + b"\xff" * 40, "is truncated or damaged"),
        ("a.png", middlebury(MOVES)[:3], "is not a PNG image"),
    ],
)
def test_files_that_do_not_fit_are_refused(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"{name}: .*{message}"):
        read_matches(tmp_path / name)


def test_a_picture_that_promises_more_than_it_can_hold_is_refused_before_it_is_decoded(tmp_path, monkeypatch):
    huge = bytearray(kitti(MOVES, np.ones((2, 3))))
    huge[16:24] = struct.pack(">II", 60_000, 60_000)
    (tmp_path / "a.png").write_bytes(huge)
    monkeypatch.setattr(flow, "_decoded", None)
    with pytest.raises(InputError, match=r"the picture would take up 86\.4 GB of memory"):
        read_matches(tmp_path / "a.png")


def test_flow_is_for_pairs_of_images_only(tmp_path):
    (tmp_path / "a.flo").write_bytes(middlebury(MOVES))
    with pytest.raises(InputError, match=r"a\.flo"):
        open_matches(PAIRS, [tmp_path / "a.flo"])


def test_a_pose_from_flow(tmp_path, rng):
    """A slanted plane and a wall behind it, seen after a turn and a step aside; a fifth of the flow is anything."""
    K = np.array([[200.0, 0, 79.5], [0, 200, 59.5], [0, 0, 1]])
    x, y = np.meshgrid(np.arange(160.0), np.arange(120.0))
    rays = np.stack([(x - 79.5) / 200, (y - 59.5) / 200, np.ones_like(x)], axis=2)
    depth = np.where(x < 70, 4.0 + 0.01 * x, 9.0 + 0.03 * y)[:, :, None]
    truth = nonsac.simulate.relative_pose(10, 0.0, 0.0, rng).T
    truth[:3, :3] = np.eye(3)
    moved = (rays * depth) @ truth[:3, :3].T + 0.5 * truth[:3, 3]
    seen = moved[:, :, :2] / moved[:, :, 2:] * 200 + [79.5, 59.5]
    moves = seen - np.stack([x, y], axis=2) + 0.1 * rng.standard_normal((120, 160, 2))
    wrong = rng.random((120, 160)) < 0.2
    moves[wrong] = rng.uniform(-60, 60, (wrong.sum(), 2))
    (tmp_path / "a.flo").write_bytes(middlebury(moves))
    result = Job("relative_pose", tmp_path / "a.flo", camera1=K).run()
    assert result.success
    assert np.degrees(np.arccos(np.clip(result.t @ truth[:3, 3], -1, 1))) < 2.0
