"""NPZ files as SuperGlue, LightGlue, LoFTR, RoMa, MASt3R and others write them."""

import numpy as np
import pytest

import nonsac
from nonsac.calls.jobs import Job
from nonsac.io import InputError, from_warp, open_matches, read_matches
from nonsac.layouts import MATCHES

FIRST = np.array([[1.0, 2], [3, 4], [5, 6], [7, 8]])
SECOND = np.array([[10.0, 20], [30, 40], [50, 60]])
PAIRED = np.array([[0, 2], [2, 0], [3, 1]])
TRUST = np.array([0.9, 0.5, 0.25])
K = np.diag([500.0, 510, 1])


def check(matches, weights=TRUST, indices=PAIRED):
    np.testing.assert_array_equal(matches.points1, FIRST[PAIRED[:, 0]])
    np.testing.assert_array_equal(matches.points2, SECOND[PAIRED[:, 1]])
    for found, expected in ((matches.weights, weights), (matches.indices, indices)):
        if expected is None:
            assert found is None
        else:
            np.testing.assert_array_equal(found, expected)


@pytest.fixture
def save(tmp_path):
    def save(**arrays):
        np.savez(tmp_path / "a.npz", **arrays)
        return tmp_path / "a.npz"

    return save


def single(array):
    return array.astype(np.float32)


SPARSE = {"keypoints0": single(FIRST), "keypoints1": single(SECOND)}


@pytest.mark.parametrize(
    "arrays",
    [
        # SuperGlue: a number, or -1, for each keypoint of the first image
        SPARSE | {"matches": np.array([2, -1, 0, 1]), "match_confidence": np.array([0.9, 0.1, 0.5, 0.25])},
        SPARSE | {"matches0": np.array([2, -1, 0, 1]), "matching_scores0": np.array([0.9, 0.1, 0.5, 0.25])},
        # LightGlue: pairs, and scores of the pairs; also as the batch of one that its network gives
        SPARSE | {"matches": PAIRED, "scores": TRUST},
        {name: points[None] for name, points in SPARSE.items()} | {"matches": PAIRED[None], "scores": TRUST[None]},
        SPARSE | {"matches0": np.array([[2, -1, 0, 1]]), "matching_scores0": np.array([[0.9, 0, 0.5, 0.25]])},
    ],
)
def test_keypoints_and_which_of_them_match(save, arrays):
    path = save(**arrays)
    check(read_matches(path))
    opened = open_matches(MATCHES, [path])
    np.testing.assert_array_equal(opened.indices, PAIRED)
    assert opened.cameras == (None, None)


def test_pairs_of_which_some_are_none(save):
    pairs = np.array([[0, 2], [1, -1], [2, 0], [-1, -1], [3, 1]])
    check(read_matches(save(**SPARSE, matches=pairs, scores=np.array([0.9, 0, 0.5, 0, 0.25]))))
    check(read_matches(save(**SPARSE, matches=pairs)), weights=None)


@pytest.mark.parametrize(
    ("names", "confidence"),
    [
        (("mkpts0", "mkpts1"), "mconf"),  # LoFTR
        (("mkpts0_f", "mkpts1_f"), "mconf"),
        (("keypoints0", "keypoints1"), "confidence"),  # that of Kornia
        (("kpts0", "kpts1"), "certainty"),  # RoMa
        (("kptsA", "kptsB"), "certainty"),
        (("kptsA", "kptsB"), "overlaps"),  # RoMa v2
        (("matches_im0", "matches_im1"), "conf"),  # MASt3R
        (("matches_im0", "matches_im1"), None),
        (("points0", "points1"), "scores"),  # LightGlue
        (("mkpts_0", "mkpts_1"), None),  # XFeat
    ],
)
@pytest.mark.parametrize("kind", [np.float32, np.int64])
def test_points_that_match_row_by_row(save, names, confidence, kind):
    arrays = dict(zip(names, (FIRST[PAIRED[:, 0]].astype(kind), SECOND[PAIRED[:, 1]].astype(kind)), strict=True))
    trust = {} if confidence is None else {confidence: TRUST}
    path = save(**arrays, **trust, batch_indexes=np.zeros(3, int), image_shape=np.array([480, 640]))
    check(read_matches(path), weights=TRUST if trust else None, indices=None)


def test_cameras_are_counted_as_the_points_are(save):
    matches = read_matches(save(**SPARSE, matches=PAIRED, K0=K, K1=2 * K + np.diag([0, 0, -1])))
    np.testing.assert_array_equal(matches.camera1, K)
    assert matches.camera2[0, 0] == 1000
    matches = read_matches(save(**SPARSE, matches=PAIRED, K1=K))
    np.testing.assert_array_equal(matches.camera1, K)


@pytest.mark.parametrize("keys", [("W_A", "H_A", "W_B", "H_B"), ("width0", "height0", "width1", "height1")])
def test_a_warp_with_the_sizes_of_its_images(save, rng, keys):
    warp, certainty = rng.uniform(-1, 1, (4, 8, 4)), rng.uniform(0.1, 1, (4, 8))
    matches = read_matches(save(warp=warp, certainty=certainty, **dict(zip(keys, (640, 480, 800, 600), strict=True))))
    expected = from_warp(warp, certainty, (640, 480), (800, 600))
    np.testing.assert_array_equal(matches.points1, expected.points1)
    np.testing.assert_array_equal(matches.points2, expected.points2)
    np.testing.assert_array_equal(matches.weights, expected.weights)


@pytest.mark.parametrize("name", ["batch_indexes", "m_bids"])
def test_a_batch_of_several_pairs_is_refused(save, name):
    arrays = {"keypoints0": FIRST, "keypoints1": FIRST, "confidence": np.ones(4)}
    assert len(read_matches(save(**arrays, **{name: np.full(4, 7)}))) == 4
    with pytest.raises(InputError, match=rf"a\.npz: holds the matches of 2 pairs of images \(the array {name} tells"):
        read_matches(save(**arrays, **{name: np.array([0, 0, 1, 1])}))


def test_keys_of_our_own_come_first(save):
    path = save(points1=SECOND, points2=SECOND[:, ::-1], mkpts0=FIRST, mkpts1=FIRST)
    np.testing.assert_array_equal(read_matches(path).points1, SECOND)


def test_a_camera_that_cannot_be_read_can_be_replaced(save):
    path = save(points1=SECOND, points2=SECOND, K1=np.eye(4))
    with pytest.raises(InputError, match=r"the array K1 has the shape \(4, 4\)"):
        read_matches(path)
    with pytest.raises(InputError, match=r"the array K1 has the shape \(4, 4\)"):
        Job("relative_pose", path).run()
    assert Job("relative_pose", path, camera1=K).run().status == "too_few"


def test_a_pose_from_such_a_file(save):
    views = nonsac.simulate.relative_pose(300, 0.3, 0.0005, 0)
    order = np.random.default_rng(0).permutation(300)
    path = save(
        keypoints0=views.points1,
        keypoints1=views.points2[np.argsort(order)],
        matches=order,
        match_confidence=np.ones(300),
    )
    expected = nonsac.relative_pose(views.points1, views.points2)
    found = Job("relative_pose", path).run()
    np.testing.assert_array_equal(found.T, expected.T)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (SPARSE, r"holds keypoints, and nothing says which of them match \(its keys are: keypoints0, keypoints1\)"),
        (SPARSE | {"matches": np.array([0, 1])}, r"the array matches has the shape \(2,\), with 4 and 3 keypoints"),
        (
            SPARSE | {"matches": np.array([0, 1, 2, 3])},
            r"matches names a keypoint that is not there \(there are 4 ",
        ),
        (SPARSE | {"matches": PAIRED + 0.5}, "the array matches has the type float64, not whole numbers"),
        (SPARSE | {"matches": PAIRED, "scores": TRUST[:2]}, r"the array scores has the shape \(2,\)"),
        ({"mkpts0": FIRST, "mkpts1": SECOND}, "mkpts0 and mkpts1 have 4 and 3 rows, which should match one by one"),
        ({"mkpts0": FIRST.T, "mkpts1": SECOND}, r"holds an array of shape \(2, 4\) instead of \(n, 2\); transpose it"),
        (SPARSE | {"mkpts0": FIRST, "mkpts1": FIRST, "mconf": np.full(4, "a")}, "the array mconf has the shape"),
        (
            {"warp": np.zeros((4, 8, 4)), "certainty": np.zeros((4, 8))},
            "holds a dense warp, which needs the sizes of the images to become matches; save W_A, H_A, W_B, H_B",
        ),
        (
            {"warp": np.zeros((4, 8, 3)), "certainty": np.zeros((4, 8)), "W_A": 4, "H_A": 4, "W_B": 4, "H_B": 4},
            r"warp has shape \(4, 8, 3\); expected",
        ),
        (
            {"warp": np.zeros((4, 8, 4)), "certainty": np.zeros((4, 8)), "W_A": -4, "H_A": 4, "W_B": 4, "H_B": 4},
            r"size1 is \(-4, 4\); expected the width and height",
        ),
        (
            {"warp": np.zeros((4, 8, 4)), "certainty": np.zeros((4, 8)), "W_A": "4", "H_A": 4, "W_B": 4, "H_B": 4},
            "W_A, H_A, W_B, H_B must be a number each",
        ),
        ({"flow": np.zeros((4, 8, 3))}, r"flow has shape \(4, 8, 3\); expected"),
        ({"flow": np.zeros((4, 8, 2)), "valid": np.ones(4)}, r"certainty has shape \(4,\); expected \(4, 8\)"),
    ],
)
def test_what_does_not_fit_is_refused(save, arrays, message):
    with pytest.raises(InputError, match=rf"a\.npz: .*{message}"):
        read_matches(save(**arrays))


def test_damaged_files_are_left_to_the_reader_of_tables(save):
    path = save(**SPARSE, matches=PAIRED)
    content = path.read_bytes()
    for end in (0, 3, 100, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:end])
        with pytest.raises(InputError, match=r"a\.npz: "):
            read_matches(path)
