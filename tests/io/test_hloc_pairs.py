"""Databases of COLMAP that are made of hloc's files."""

import numpy as np
import pytest

import nonsac
from database_samples import hloc_files, many_pairs, name_of, rows_of
from nonsac.io import read_colmap_pair
from nonsac.io.camera_lists import cameras_of, read_camera_list
from nonsac.io.hloc_pairs import HlocPairs

LINE = "PINHOLE 1600 1200 1200.0 1200.0 800.0 600.0"


@pytest.fixture
def files(tmp_path):
    return hloc_files(tmp_path, *many_pairs(tmp_path / "other.db", 5))


def test_the_database_holds_what_the_files_hold(files, tmp_path):
    photos, matches, features, pairs_file, listed = files
    with HlocPairs.open(features, pairs_file, listed, cameras_of(LINE)) as pairs:
        pairs.write_database(tmp_path / "a.db")
        own = pairs.read(pairs.pairs[0])
    for (first, second), indices in matches.items():
        found = read_colmap_pair(tmp_path / "a.db", name_of(first), name_of(second))
        order = np.lexsort(indices.T[::-1])
        np.testing.assert_array_equal(found.indices[np.lexsort(found.indices.T[::-1])], indices[order])
        # The centre of the first pixel is (0.5, 0.5) in both.
        np.testing.assert_allclose(found.points1, photos.keypoints[first][found.indices[:, 0]], atol=1e-4)
        assert nonsac.Camera.parse(found.camera1) == photos.camera
    assert own.camera1 == LINE


def test_verified_as_the_database_is(files, tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    photos, _, features, matches, listed = files
    found = nonsac.verify((features, matches), tmp_path / "out.db", pairs=listed, cameras=LINE, workers=1)
    assert len(found.pairs) == 10
    assert len(found.kept) >= 8
    assert len(rows_of(tmp_path / "out.db")) == 10
    assert not list(tmp_path.glob(".nonsac*"))
    [model] = pycolmap.incremental_mapping(tmp_path / "out.db", tmp_path, tmp_path).values()
    assert model.num_reg_images() == len(photos.poses)


def test_a_camera_for_each_image(files, tmp_path):
    _, _, features, matches, listed = files
    cameras = tmp_path / "cameras.txt"
    cameras.write_text("".join(f"{name_of(k)} PINHOLE 1600 1200 {1200 + k} 1200 800 600\n" for k in range(5)))
    with HlocPairs.open(features, matches, listed, read_camera_list(cameras)) as pairs:
        pairs.write_database(tmp_path / "a.db")
    assert read_colmap_pair(tmp_path / "a.db", name_of(1), name_of(3)).camera2["params"][0] == 1203


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# none\n", "holds no images"),
        ("00.jpg\n", "line 1 holds no camera"),
        ("00.jpg PINHOLE 1 2 3\n", "line 1 holds no camera"),
        (f"00.jpg {LINE}\n00.jpg {LINE}\n", "line 2 names '00.jpg' again"),
    ],
)
def test_lists_of_cameras_that_are_none(tmp_path, text, message):
    (tmp_path / "cameras.txt").write_text(text)
    with pytest.raises(nonsac.InputError, match=message):
        read_camera_list(tmp_path / "cameras.txt")


@pytest.mark.parametrize(
    ("cameras", "message"),
    [("a.jpg PINHOLE 9 9 5 5 4 4\n", "no camera is given for image"), ("PINHOLE 5 5 4 4", "has no size")],
)
def test_cameras_that_are_not_enough(files, tmp_path, cameras, message):
    _, _, features, matches, listed = files
    if cameras.endswith("\n"):
        (tmp_path / "cameras.txt").write_text(cameras)
        cameras = tmp_path / "cameras.txt"
    with pytest.raises(nonsac.InputError, match=message):
        nonsac.verify((features, matches), tmp_path / "out.db", pairs=listed, cameras=cameras, workers=1)
    assert not (tmp_path / "out.db").exists()


def test_what_hloc_needs_and_a_database_does_not(files, tmp_path):
    _, _, features, matches, listed = files
    with pytest.raises(ValueError, match="files of hloc need pairs, a list of them, and cameras"):
        nonsac.verify((features, matches), tmp_path / "out.db", cameras=LINE)
    with pytest.raises(ValueError, match="cameras are those of the database"):
        nonsac.verify(tmp_path / "other.db", tmp_path / "out.db", pairs=listed, cameras=LINE)
