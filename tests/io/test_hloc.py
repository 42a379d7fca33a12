import os
import sys

import numpy as np
import pytest

from nonsac.io import read_hloc

h5py = pytest.importorskip("h5py")

A, B, C = "db/1.jpg", "query/night/2.jpg", "plain.png"
KEYPOINTS = {
    A: np.array([[0, 0], [10, 20], [30, 40]], dtype=np.float16),
    B: np.array([[5.5, 6.5], [7.5, 8.5]], dtype=np.float32),
    C: np.zeros((0, 2), dtype=np.float16),
}


@pytest.fixture
def features(tmp_path):
    """The features.h5 of hloc.extract_features: a group for each image, its name the path of the image."""
    path = tmp_path / "features.h5"
    with h5py.File(path, "w", libver="latest") as file:
        for name, keypoints in KEYPOINTS.items():
            group = file.create_group(name)
            group["keypoints"] = keypoints
            group["keypoints"].attrs["uncertainty"] = 1.5
            group["descriptors"] = np.zeros((4, len(keypoints)), dtype=np.float16)
            group["image_size"] = np.array([640, 480])
            group["scores"] = np.ones(len(keypoints), dtype=np.float16)
    return path


@pytest.fixture
def make_matches(tmp_path):
    """Write the matches.h5 of hloc.match_features."""

    def make(pair, **members):
        path = tmp_path / "matches.h5"
        with h5py.File(path, "w", libver="latest") as file:
            group = file.create_group(pair)
            for name, array in members.items():
                group[name] = array
        return path

    return make


NEW, REVERSED = "db-1.jpg/query-night-2.jpg", "query-night-2.jpg/db-1.jpg"
FROM_A = {
    "matches0": np.array([1, -1, 0], dtype=np.int16),
    "matching_scores0": np.array([0.5, 0, 0.75], dtype=np.float16),
}
FROM_B = {"matches0": np.array([2, 0]), "matching_scores0": np.array([0.75, 0.5], dtype=np.float32)}


@pytest.mark.parametrize(
    ("pair", "members"),
    [
        (NEW, FROM_A),
        (NEW.replace("/", "_"), FROM_A),
        (REVERSED, FROM_B),
        (REVERSED.replace("/", "_"), FROM_B),
    ],
)
def test_pairs(features, make_matches, pair, members):
    path = make_matches(pair, **members)
    matches = read_hloc(features, path, A, B)
    order = np.argsort(matches.indices[:, 0])
    np.testing.assert_array_equal(matches.points1[order], [[0, 0], [30, 40]])
    np.testing.assert_array_equal(matches.points2[order], [[7.5, 8.5], [5.5, 6.5]])
    np.testing.assert_array_equal(matches.weights[order], [0.5, 0.75])
    np.testing.assert_array_equal(matches.indices[order], [[0, 1], [2, 0]])
    assert matches.camera1 is None
    for array in (matches.points1, matches.points2, matches.weights):
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
    assert matches.indices.dtype == np.int64

    swapped = read_hloc(features, path, B, A)
    np.testing.assert_array_equal(swapped.points1, matches.points2)
    np.testing.assert_array_equal(swapped.points2, matches.points1)
    np.testing.assert_array_equal(swapped.weights, matches.weights)
    np.testing.assert_array_equal(swapped.indices, matches.indices[:, ::-1])


def test_new_names_come_first(features, make_matches):
    path = make_matches(NEW.replace("/", "_"), matches0=np.array([-1, -1, -1]))
    with h5py.File(path, "a") as file:
        file.create_group(NEW)["matches0"] = FROM_A["matches0"]
    assert len(read_hloc(features, path, A, B)) == 2


def test_no_scores_and_no_matches(features, make_matches):
    matches = read_hloc(features, make_matches(NEW, matches0=FROM_A["matches0"]), A, B)
    assert matches.weights is None
    np.testing.assert_array_equal(matches.indices, [[0, 1], [2, 0]])
    none = read_hloc(features, make_matches(NEW, matches0=np.full(3, -1)), A, B)
    assert none.points1.shape == none.points2.shape == none.indices.shape == (0, 2)
    empty = read_hloc(features, make_matches("plain.png/db-1.jpg", matches0=np.zeros(0, int)), A, C)
    assert len(empty) == 0


def test_unknown_names(features, make_matches, refused):
    path = make_matches(NEW, **FROM_A)
    message = refused(read_hloc, features, path, A, "1.jpg")
    assert f"holds no keypoints of image '1.jpg' (it holds {A}, {C}, {B}); check the name" in message
    for name in ("db", "", "/", "db/1.jpg/keypoints"):
        assert f"holds no keypoints of image {name!r}" in refused(read_hloc, features, path, name, A)
    with pytest.raises(ValueError, match=r"matches.h5: holds no matches of 'db/1.jpg' and 'plain.png' \(it holds db-1"):
        read_hloc(features, path, A, C)


def refused_matches(refused, features, path):
    return refused(lambda matches: read_hloc(features, matches, A, B), path)


@pytest.mark.parametrize(
    ("members", "expected"),
    [
        ({"matches0": np.array([1, -1])}, "does not fit the keypoints in "),
        ({"matches0": np.array([2, -1, 0])}, "does not fit the keypoints in "),
        ({"matches0": np.array([1, -1, 0]), "matching_scores0": np.ones(2)}, "does not fit the keypoints in "),
        ({"matches0": np.array([1.0, -1, 0])}, "the data set matches0 has the shape (3,) and the type float64"),
        ({"matches0": np.array([[1, -1, 0]])}, "the data set matches0 has the shape (1, 3)"),
        ({"matches0": 3}, "the data set matches0 has the shape ()"),
        ({"matches": np.array([1, -1, 0])}, "holds no matches of 'db/1.jpg' and 'query/night/2.jpg' (it holds none)"),
    ],
)
def test_bad_matches(features, make_matches, refused, members, expected):
    assert expected in refused_matches(refused, features, make_matches(NEW, **members))


def test_bad_keypoints(features, make_matches, refused):
    path = make_matches(NEW, **FROM_A)
    with h5py.File(features, "a") as file:
        del file[A]["keypoints"]
        file[A]["keypoints"] = np.zeros((3, 3))
    assert "shape (3, 3) instead of (n, 2)" in refused(read_hloc, features, path, A, B)


def test_damaged_files(features, make_matches, make_file, refused, tmp_path):
    path = make_matches(NEW, **FROM_A)
    whole = path.read_bytes()
    for size in (20, 100, len(whole) // 2, len(whole) - 1):
        cut = make_file("cut.h5", whole[:size])
        assert "is truncated, damaged or being written" in refused_matches(refused, features, cut)
    assert "the file is empty" in refused_matches(refused, features, make_file("cut.h5", b""))
    assert "is not an HDF5 file, it looks like a text table" in refused(read_hloc, make_file("a.h5", "1"), path, A, B)
    assert "no such file" in refused(read_hloc, tmp_path / "none.h5", path, A, B)
    assert "is a folder" in refused_matches(refused, features, tmp_path)


def test_links_and_parts_that_are_missing(tmp_path, features, make_matches, refused):
    matches = make_matches(NEW, **FROM_A)
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "more.h5").write_bytes(features.read_bytes())
    for target, problem in [("pipe", "names pipe, which is no regular file"), ("gone.h5", "lacks the file gone.h5")]:
        for file, name in [(features, f"{A}/keypoints"), (matches, f"{NEW}/matches0")]:
            whole = file.read_bytes()
            with h5py.File(file, "a") as opened:
                del opened[name]
                opened[name] = h5py.ExternalLink(target, "/x")
            message = refused(lambda path: read_hloc(features, matches, A, B), file)
            assert problem in message
            file.write_bytes(whole)
    with h5py.File(features, "a") as opened:
        del opened[A]
        opened[A] = h5py.ExternalLink("more.h5", f"/{A}")
    assert len(read_hloc(features, matches, A, B)) == 2
    with h5py.File(features, "a") as opened:
        del opened[f"{B}/keypoints"]
        opened.create_dataset(f"{B}/keypoints", (10**12, 2), "f4", chunks=(1000, 2))
    assert "lacks rows 0 to 999 of dataset 'keypoints'" in refused(read_hloc, features, matches, A, B)


def test_h5py_missing(make_file, refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    message = refused(read_hloc, make_file("a.h5", b"\x89HDF\r\n\x1a\n"), "b.h5", A, B)
    assert message.endswith('reading the files of hloc needs h5py; pip install "nonsac[hloc]"')


# --- an array for each image and for each pair, as DISK, kornia and deep-image-matching write ------------------------

PAIRS = np.array([[0, 1], [2, 0]])


@pytest.fixture
def plain_features(tmp_path):
    path = tmp_path / "keypoints.h5"
    with h5py.File(path, "w") as file:
        for name, keypoints in KEYPOINTS.items():
            file[name] = keypoints
    return path


def plain_matches(path, first, second, matches):
    with h5py.File(path, "w") as file:
        file.create_group(first)[second] = matches
    return path


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("kind", [np.int64, np.int32, np.uint16])
def test_an_array_for_each_image_and_pair(plain_features, features, tmp_path, swapped, kind):
    stored = (B, A, PAIRS[:, ::-1]) if swapped else (A, B, PAIRS)
    path = plain_matches(tmp_path / "matches.h5", *stored[:2], stored[2].astype(kind))
    for keypoints in (plain_features, features):  # deep-image-matching has groups of keypoints, too
        matches = read_hloc(keypoints, path, A, B)
        np.testing.assert_array_equal(matches.indices, PAIRS)
        np.testing.assert_array_equal(matches.points1, [[0, 0], [30, 40]])
        np.testing.assert_array_equal(matches.points2, [[7.5, 8.5], [5.5, 6.5]])
        assert matches.weights is None
        turned = read_hloc(keypoints, path, B, A)
        np.testing.assert_array_equal(turned.points1, matches.points2)
        np.testing.assert_array_equal(turned.points2, matches.points1)


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("key", ["{}/{}", "{}-{}"])
def test_matches_in_columns(plain_features, tmp_path, swapped, key):
    """As DISK's own program and the image matching challenge have them."""
    three = np.array([[0, 1], [2, 0], [1, 1]])
    with h5py.File(tmp_path / "m.h5", "w") as file:
        file[key.format(B, A) if swapped else key.format(A, B)] = (three[:, ::-1] if swapped else three).T
    np.testing.assert_array_equal(read_hloc(plain_features, tmp_path / "m.h5", A, B).indices, three)
    np.testing.assert_array_equal(read_hloc(plain_features, tmp_path / "m.h5", B, A).indices, three[:, ::-1])


@pytest.mark.parametrize("empty", [np.zeros((0, 2), np.int64), np.zeros((2, 0), np.uint16)])
def test_a_pair_without_matches(plain_features, tmp_path, empty):
    assert len(read_hloc(plain_features, plain_matches(tmp_path / "m.h5", A, B, empty), A, B)) == 0


@pytest.mark.parametrize(
    ("matches", "expected"),
    [
        (np.array([[0, 2]]), "does not fit the keypoints in "),
        (np.array([[3, 0]]), "does not fit the keypoints in "),
        (np.array([[0, -1]]), "holds a match with a keypoint that is not there; number the keypoints from 0"),
        (np.array([[0, 2**64 - 1]], np.uint64), "holds a match with a keypoint that is not there"),
        (np.array([[0.0, 1.0]]), "holds matches of shape (1, 2) and type float64, not integers (k, 2) or (2, k)"),
        (np.array([[0, 1, 2]]), "holds matches of shape (1, 3) and type int64, not integers (k, 2) or (2, k)"),
        (np.array([0, 1]), "holds matches of shape (2,) and type int64, not integers (k, 2) or (2, k)"),
    ],
)
def test_bad_arrays_of_matches(plain_features, tmp_path, refused, matches, expected):
    path = plain_matches(tmp_path / "m.h5", A, B, matches)
    assert expected in refused_matches(refused, plain_features, path)


def test_unknown_names_of_arrays(plain_features, tmp_path, refused):
    path = plain_matches(tmp_path / "m.h5", A, B, PAIRS)
    message = refused(read_hloc, plain_features, path, A, "1.jpg")
    assert f"holds no keypoints of image '1.jpg' (it holds {A}, {C}, {B}); check the name" in message
    with pytest.raises(ValueError, match=rf"m.h5: holds no matches of '{A}' and '{C}' \(it holds {A}/{B}\)"):
        read_hloc(plain_features, path, A, C)
