import os
import re
import sqlite3
from contextlib import closing
from pathlib import Path
from threading import Timer

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from limits import little_memory
from match_samples import LENSES, SCHEMA, fill_database
from nonsac.calls.jobs import Job
from nonsac.cameras import models
from nonsac.cameras.camera import Camera
from nonsac.cameras.unreadable import chosen_cameras
from nonsac.io import (
    InputError,
    colmap_database,
    colmap_sqlite,
    open_matches,
    read_colmap_pair,
    read_matches,
    write_two_view_geometry,
)
from nonsac.layouts import MATCHES

__all__ = ["little_memory"]


@pytest.fixture
def path(tmp_path):
    fill_database(tmp_path / "database.db")
    return tmp_path / "database.db"


def run(path, statement, *values):
    with closing(sqlite3.connect(path)) as database, database:
        return database.execute(statement, values).fetchall()


def check_pair(matches):
    np.testing.assert_array_equal(matches.points1, [[1.5, 2.5], [50, 60]])
    np.testing.assert_array_equal(matches.points2, [[9, 10.5], [7, 8]])
    np.testing.assert_array_equal(matches.indices, [[0, 2], [3, 1]])
    assert matches.weights is None
    assert matches.camera1 == {"model": "PINHOLE", "width": 640, "height": 480, "params": [500, 510, 320, 240]}
    assert matches.camera2 == {"model": "RADIAL", "width": 800, "height": 600, "params": [700, 400, 300, 0.1, -0.02]}
    assert matches.points1.dtype == matches.points2.dtype == np.float64
    assert matches.points2.flags.c_contiguous
    assert matches.indices.dtype == np.int64


@pytest.mark.parametrize(("image1", "image2"), [("sub/a b.jpg", "b.jpg"), (3, 7), (np.int64(3), "b.jpg")])
def test_pair(path, image1, image2):
    matches = read_colmap_pair(path, image1, image2)
    check_pair(matches)
    check_pair(read_matches(path, image1, image2))
    swapped = read_colmap_pair(path, image2, image1)
    np.testing.assert_array_equal(swapped.points1, matches.points2)
    np.testing.assert_array_equal(swapped.points2, matches.points1)
    np.testing.assert_array_equal(swapped.indices, matches.indices[:, ::-1])
    assert (swapped.camera1, swapped.camera2) == (matches.camera2, matches.camera1)
    assert swapped.indices.flags.c_contiguous


def test_pair_without_matches(path):
    matches = read_colmap_pair(path, 11, 3)
    assert matches.points1.shape == matches.points2.shape == matches.indices.shape == (0, 2)
    assert matches.camera1["model"] == "OPENCV_FISHEYE"


def test_a_path_with_signs_that_mean_something_in_an_address(tmp_path, monkeypatch):
    folder = tmp_path / "a?mode=rwc#b%20 c"
    folder.mkdir()
    fill_database(folder / "database.db")
    monkeypatch.chdir(folder)
    check_pair(read_colmap_pair("database.db", 3, 7))
    assert os.listdir(folder) == ["database.db"]


def test_reading_leaves_nothing_behind(path):
    run(path, "PRAGMA journal_mode=WAL")
    before = path.read_bytes()
    assert before[18:20] == b"\x02\x02"
    check_pair(read_colmap_pair(path, 3, 7))
    assert os.listdir(path.parent) == ["database.db"]
    assert path.read_bytes() == before


def test_reading_while_another_program_writes(path):
    run(path, "PRAGMA journal_mode=WAL")
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute("UPDATE images SET name = 'new.jpg' WHERE image_id = 7")
        database.execute("BEGIN IMMEDIATE")
        database.execute("DELETE FROM images")
        # What was committed is seen, although it is not yet in the file itself; the rest is not.
        check_pair(read_colmap_pair(path, 3, "new.jpg"))


def test_unknown_images(path, refused):
    message = refused(read_colmap_pair, path, "a.jpg", "b.jpg")
    expected = "holds no image 'a.jpg' (it holds sub/a b.jpg, b.jpg, fish.jpg, around.jpg and 1 more); check the name"
    assert expected in message
    assert "holds no image 4 (it holds 3, 7, 11, 12 and 1 more)" in refused(read_colmap_pair, path, 3, 4)
    refused(read_colmap_pair, path, 3, 2**70)
    assert "holds no image '3'" in refused(read_colmap_pair, path, "3", "7")
    assert "3 and 'sub/a b.jpg' are the same image" in refused(read_colmap_pair, path, 3, "sub/a b.jpg")
    assert "holds no matches of 7 and 'fish.jpg'; match these images first" in refused(
        read_colmap_pair, path, 7, "fish.jpg"
    )
    assert "holds no keypoints of image 13; extract its features first" in refused(read_colmap_pair, path, 3, 13)


def test_unknown_camera_model(path, refused):
    message = refused(read_colmap_pair, path, 3, 12)
    assert "the camera has the model EQUIRECTANGULAR, but nonsac knows only SIMPLE_PINHOLE, PINHOLE, " in message
    assert "FISHEYE, EUCM; give a camera of your own, or undistort the images" in message
    run(path, "UPDATE cameras SET model = 99 WHERE camera_id = 9")
    assert "the camera model 99 is not known" in refused(read_colmap_pair, path, 3, 12)


@pytest.mark.parametrize("line", LENSES.values(), ids=LENSES)
def test_cameras_of_all_models(path, line):
    camera = Camera.parse(line)
    (number,) = (number for number, (name, _) in models._MODELS.items() if name == camera.model)
    values = (number, np.array(camera.params, "<f8").tobytes())
    run(path, "UPDATE cameras SET model = ?, params = ?, width = 640, height = 480 WHERE camera_id = 4", *values)
    assert Camera.parse(read_colmap_pair(path, 3, 7).camera1) == camera


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("SELECT 1", "the camera has the model EQUIRECTANGULAR, but nonsac knows only"),
        ("UPDATE cameras SET model = 99 WHERE camera_id = 9", "the camera model 99 is not known"),
        ("UPDATE cameras SET params = x'00' WHERE camera_id = 9", "is not valid"),
        ("DELETE FROM cameras WHERE camera_id = 9", "it lacks the camera of image 12"),
    ],
)
def test_a_camera_that_cannot_be_read_can_be_replaced(path, statement, message):
    run(path, statement)
    opened = open_matches(MATCHES, [path], [3, 12])
    np.testing.assert_array_equal(opened.source.take(np.arange(1)), [[1.5, 2.5, 1, 2]])
    with pytest.raises(InputError, match=message):
        Camera.parse(opened.cameras[1])
    with pytest.raises(InputError, match=message):
        read_matches(path, 3, 12)
    mine = "PINHOLE 1 1 0 0"
    assert chosen_cameras([None, mine], opened.cameras) == [opened.cameras[0], mine]
    # Another camera than that of the first image, so that its replacement tells nothing.
    assert chosen_cameras([mine, None], opened.cameras) == [mine, opened.cameras[1]]
    run(path, "UPDATE images SET camera_id = 9 WHERE image_id = 3")
    opened = open_matches(MATCHES, [path], [3, 12])
    assert chosen_cameras([mine, None], opened.cameras) == [mine, mine]
    assert chosen_cameras([None, mine], opened.cameras) == [opened.cameras[0], mine]
    with pytest.raises(InputError, match=message.removesuffix("of image 12")):
        Job("relative_pose", path, image1=3, image2=12).run()
    assert Job("relative_pose", path, image1=3, image2=12, camera1=mine).run().status == "too_few"


@pytest.mark.parametrize("focal", [0.0, -500.0, np.inf, np.nan, 5e-324])
@pytest.mark.parametrize("place", [0, 1])
def test_no_geometry_with_a_camera_without_focal_length(path, refused, focal, place):
    params = np.array([500.0, 510, 320, 240])
    params[place] = focal
    run(path, "UPDATE cameras SET params = ? WHERE camera_id = 4", params.tobytes())
    before = path.read_bytes()
    message = refused(write_two_view_geometry, path, 3, 7, (np.eye(3), [1, 0, 0]), [[0, 0]])
    assert "the camera of image 3 has the focal lengths " in message
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        ("UPDATE keypoints SET rows = 4 WHERE image_id = 7", "the size of the keypoints of image 7 is wrong"),
        ("UPDATE keypoints SET cols = 1 WHERE image_id = 7", "the size of the keypoints of image 7 is wrong"),
        ("UPDATE keypoints SET data = 'text' WHERE image_id = 7", "the size of the keypoints of image 7 is wrong"),
        ("UPDATE keypoints SET rows = 'many'", "the size of the keypoints of image 3 is wrong"),
        ("UPDATE keypoints SET rows = -1, cols = -1", "the size of the keypoints of image 3 is wrong"),
        ("UPDATE matches SET rows = 3", "the size of the matches of 3 and 7 is wrong"),
        ("UPDATE matches SET data = NULL", "the size of the matches of 3 and 7 is wrong"),
        ("UPDATE matches SET data = x'00000000030000000300000001000000'", "names a keypoint that is not there"),
        ("UPDATE cameras SET params = x'00'", "the camera of image 3 is not valid"),
        ("UPDATE cameras SET params = NULL", "the camera of image 3 is not valid"),
        ("UPDATE cameras SET width = 'wide'", "the camera of image 3 is not valid"),
        ("UPDATE cameras SET params = x'0000000000000000'", "a camera of model PINHOLE has 4 parameters, not 1"),
        ("DELETE FROM cameras", "it lacks the camera of image 3"),
        ("DROP TABLE matches", "is no database of COLMAP (no such table: matches); give the database.db"),
        ("ALTER TABLE images RENAME COLUMN image_id TO number", "is no database of COLMAP (no such column"),
    ],
)
def test_damaged_rows(path, refused, statement, expected):
    run(path, statement)
    assert expected in refused(read_colmap_pair, path, 3, 7)


def test_an_index_that_names_a_row_which_is_not_there(path, refused, monkeypatch):
    monkeypatch.setattr(colmap_database, "_find_image", lambda path, database, image: {"b.jpg": 7}.get(image, 10**12))
    assert "its index does not find image 1000000000000" in refused(read_colmap_pair, path, "sub/a b.jpg", "b.jpg")


def test_damaged_files(path, make_file, refused, tmp_path):
    whole = path.read_bytes()
    for size in (20, 99, 4096, len(whole) // 2):
        assert "is truncated or damaged" in refused(read_colmap_pair, make_file("cut.db", whole[:size]), 3, 7)
    noise = whole[:4096] + bytes(range(256)) * ((len(whole) - 4096) // 256)
    assert "is truncated or damaged" in refused(read_colmap_pair, make_file("noise.db", noise), 3, 7)
    no_text = whole.replace(b"CREATE TABLE matches (", b"CREATE TABLE matches \xff")
    assert "is truncated or damaged" in refused(read_colmap_pair, make_file("name.db", no_text), 3, 7)
    assert "the file is empty" in refused(read_colmap_pair, make_file("empty.db", b""), 3, 7)
    assert "it looks like a PNG image" in refused(read_colmap_pair, make_file("a.db", b"\x89PNG"), 3, 7)
    assert "no such file" in refused(read_colmap_pair, tmp_path / "other.db", 3, 7)
    assert not (tmp_path / "other.db").exists()
    assert "is a folder" in refused(read_colmap_pair, tmp_path, 3, 7)


ROTATION = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
TRANSLATION = np.array([1.0, 2, -2]) / 3
POSE = np.vstack([np.column_stack([ROTATION, TRANSLATION]), [0, 0, 0, 1]])
COLUMNS = "pair_id, rows, cols, data, config, F, E, H, qvec, tvec"


def read_row(path):
    ((pair, rows, columns, data, config, *matrices),) = run(path, f"SELECT {COLUMNS} FROM two_view_geometries")
    return pair, np.frombuffer(data, "<u4").reshape(rows, columns), config, *matrices


def matrix(blob):
    return np.frombuffer(blob, "<f8").reshape(3, 3)


@pytest.mark.parametrize("pose", [POSE, POSE[:3].tolist(), (ROTATION, TRANSLATION), (ROTATION, TRANSLATION[:, None])])
def test_geometry(path, pose):
    write_two_view_geometry(path, 3, "b.jpg", pose, [[0, 2], [3, 1]])
    pair, inliers, config, fundamental, essential, homography, quaternion, translation = read_row(path)
    assert pair == 3 * 2147483647 + 7
    assert config == 2
    assert homography is None
    np.testing.assert_array_equal(inliers, [[0, 2], [3, 1]])
    np.testing.assert_array_equal(np.frombuffer(translation, "<f8"), TRANSLATION)
    w, x, y, z = np.frombuffer(quaternion, "<f8")
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), ROTATION, atol=1e-15)

    # Points in space, seen by both cameras without distortion, fulfil both constraints.
    points1 = np.array([[0.1, 0.2, 1], [0.5, -0.5, 1], [-0.3, 0.1, 1]]) * [[3], [4], [5]]
    points2 = points1 @ ROTATION.T + TRANSLATION
    rays1, rays2 = points1 / points1[:, 2:], points2 / points2[:, 2:]
    np.testing.assert_allclose(np.sum(rays2 * (rays1 @ matrix(essential).T), axis=1), 0, atol=1e-15)
    pixels1 = rays1 * [500, 510, 1] + [320, 240, 0]
    pixels2 = rays2 * [700, 700, 1] + [400, 300, 0]
    np.testing.assert_allclose(np.sum(pixels2 * (pixels1 @ matrix(fundamental).T), axis=1), 0, atol=1e-12)
    assert np.linalg.norm(matrix(essential)) == pytest.approx(np.sqrt(2))
    assert os.listdir(path.parent) == ["database.db"]


def test_the_order_of_the_images_does_not_matter(path):
    write_two_view_geometry(path, 3, 7, POSE, [[0, 2], [3, 1], [1, 0]])
    first = read_row(path)
    write_two_view_geometry(path, 7, 3, np.linalg.inv(POSE), [[2, 0], [1, 3], [0, 1]])
    second = read_row(path)
    assert first[0] == second[0]
    np.testing.assert_array_equal(first[1], second[1])
    for one, other in zip(first[3:], second[3:], strict=True):
        if one is not None:
            np.testing.assert_allclose(np.frombuffer(one, "<f8"), np.frombuffer(other, "<f8"), atol=1e-14)


def test_what_is_there_is_replaced(path):
    write_two_view_geometry(path, 3, 7, POSE, [[0, 2]])
    write_two_view_geometry(path, 3, 11, POSE, [[0, 0]])
    write_two_view_geometry(path, 3, 7, (np.eye(3), [0, 0, 2]), np.zeros((0, 2), int))
    rows = run(path, "SELECT pair_id, rows, tvec FROM two_view_geometries ORDER BY pair_id")
    assert [row[:2] for row in rows] == [(3 * 2147483647 + 7, 0), (3 * 2147483647 + 11, 1)]
    np.testing.assert_array_equal(np.frombuffer(rows[0][2], "<f8"), [0, 0, 2])


@pytest.mark.parametrize("image", ["fish.jpg", "around.jpg"])
def test_a_fisheye_has_no_fundamental_matrix(path, image):
    write_two_view_geometry(path, 3, image, POSE, [[0, 0]])
    row = read_row(path)
    assert row[3] is None
    assert row[4] is not None


def test_older_schema(tmp_path):
    path = tmp_path / "old.db"
    fill_database(path, SCHEMA.replace(", qvec BLOB, tvec BLOB", ""))
    write_two_view_geometry(path, 3, 7, POSE, [[0, 2]])
    ((config, essential),) = run(path, "SELECT config, E FROM two_view_geometries")
    assert config == 2
    assert len(essential) == 72


@pytest.mark.parametrize(
    ("pose", "matches", "expected"),
    [
        (np.full((4, 4), np.nan), [[0, 2]], "the pose holds no rotation; write the poses only of results that succee"),
        (np.diag([1, 1, -1, 1]), [[0, 2]], "the pose holds no rotation"),
        (np.diag([2, 2, 2, 1]), [[0, 2]], "the pose holds no rotation"),
        (np.eye(4), [[0, 2]], "the translation is zero or not finite"),
        ((np.eye(3), [0, 0, np.inf]), [[0, 2]], "the translation is zero or not finite"),
        (np.eye(3), [[0, 2]], "a pose has the shape (4, 4) or (3, 4), this array has the shape (3, 3)"),
        ((np.eye(4), [0, 0, 1]), [[0, 2]], "rotation and translation have the shapes (4, 4) and (3,)"),
        (POSE, [0, 2], "the matches are no indices of keypoints of shape (k, 2)"),
        (POSE, [[0.5, 2]], "the matches are no indices of keypoints of shape (k, 2), but float64 of (1, 2)"),
        (POSE, [[-1, 2]], "the matches are no indices"),
        (POSE, [[0, 2], [2, 3]], "a match names keypoint 3 of image 7, which has 3; number the keypoints"),
        (POSE, [[4, 2]], "a match names keypoint 4 of image 3, which has 4"),
    ],
)
def test_what_cannot_be_written(path, refused, pose, matches, expected):
    write_two_view_geometry(path, 3, 7, POSE, [[0, 2]])
    before = path.read_bytes()
    assert expected in refused(write_two_view_geometry, path, 3, 7, pose, matches)
    assert path.read_bytes() == before


def test_places_that_cannot_be_written(path, refused, tmp_path, make_file):
    arguments = (POSE, [[0, 2]])
    assert "no such file" in refused(write_two_view_geometry, tmp_path / "none.db", 3, 7, *arguments)
    assert "it looks like a text table" in refused(write_two_view_geometry, make_file("a.db", "1 2"), 3, 7, *arguments)
    assert "holds no image 'x'" in refused(write_two_view_geometry, path, "x", 7, *arguments)
    run(path, "DROP TABLE two_view_geometries")
    assert "no such table: two_view_geometries" in refused(write_two_view_geometry, path, 3, 7, *arguments)


def test_a_failure_leaves_the_old_row_alone(path, refused):
    write_two_view_geometry(path, 3, 7, POSE, [[0, 2]])
    before = run(path, "SELECT * FROM two_view_geometries")
    run(path, "CREATE TRIGGER t AFTER INSERT ON two_view_geometries BEGIN SELECT RAISE(FAIL, 'disk on fire'); END")
    assert "disk on fire" in refused(write_two_view_geometry, path, 3, 7, POSE, [[3, 1]])
    assert run(path, "SELECT * FROM two_view_geometries") == before


def test_locked(path, refused, monkeypatch):
    monkeypatch.setattr(colmap_sqlite, "_SECONDS_TO_WAIT", 0.01)
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute("BEGIN EXCLUSIVE")
        message = refused(read_colmap_pair, path, 3, 7)
        assert "the database is locked by another program; wait until it is done, or close it" in message
        assert "is locked by another program" in refused(write_two_view_geometry, path, 3, 7, POSE, [[0, 2]])
    check_pair(read_colmap_pair(path, 3, 7))


def test_a_lock_is_waited_for(path):
    with closing(sqlite3.connect(path, isolation_level=None, check_same_thread=False)) as database:
        database.execute("BEGIN EXCLUSIVE")
        timer = Timer(0.2, database.execute, ["COMMIT"])
        timer.start()
        check_pair(read_colmap_pair(path, 3, 7))
        timer.join()


def test_another_writer_is_waited_for(path):
    run(path, "PRAGMA journal_mode=WAL")
    with closing(sqlite3.connect(path, isolation_level=None, check_same_thread=False)) as database:
        database.execute("BEGIN IMMEDIATE")
        database.execute("DELETE FROM two_view_geometries")
        timer = Timer(0.2, database.execute, ["COMMIT"])
        timer.start()
        write_two_view_geometry(path, 3, 7, POSE, [[0, 2]])
        timer.join()
    assert read_row(path)[0] == 3 * 2147483647 + 7


def test_read_only(path, refused, monkeypatch):
    def open_read_only(address, *rest, **options):
        return connect(address.replace("mode=rw", "mode=ro"), *rest, **options)

    connect = sqlite3.connect
    monkeypatch.setattr(colmap_sqlite.sqlite3, "connect", open_read_only)
    message = refused(write_two_view_geometry, path, 3, 7, POSE, [[0, 2]])
    assert "cannot be opened or written (attempt to write a readonly database)" in message


@pytest.fixture
def pycolmap():
    return pytest.importorskip("pycolmap")


@pytest.fixture
def foreign(pycolmap, tmp_path, rng):
    """A database that COLMAP itself has written, with two images that see the same points."""
    path = tmp_path / "colmap.db"
    keypoints = {"a.jpg": rng.uniform(0, 500, (50, 2)), "b.jpg": rng.uniform(0, 500, (60, 2))}
    matches = np.column_stack([rng.permutation(50)[:20], rng.permutation(60)[:20]])
    with pycolmap.Database.open(path) as database:
        camera = pycolmap.Camera(model="OPENCV", width=640, height=480, params=[500, 510, 320, 240, 0.1, 0, 0, 0.01])
        number = database.write_camera(camera)
        images = {
            name: database.write_image(pycolmap.Image(name=name, camera_id=number)) for name in reversed(keypoints)
        }
        for name, points in keypoints.items():
            database.write_keypoints(images[name], points.astype(np.float32))
        database.write_matches(images["a.jpg"], images["b.jpg"], matches.astype(np.uint32))
    assert images["b.jpg"] < images["a.jpg"]
    return path, images, keypoints, matches


def test_what_colmap_wrote(foreign):
    path, images, keypoints, expected = foreign
    matches = read_colmap_pair(path, "a.jpg", "b.jpg")
    np.testing.assert_array_equal(matches.indices, expected)
    np.testing.assert_array_equal(matches.points1, keypoints["a.jpg"].astype(np.float32)[expected[:, 0]])
    np.testing.assert_array_equal(matches.points2, keypoints["b.jpg"].astype(np.float32)[expected[:, 1]])
    assert matches.camera1 == matches.camera2
    assert matches.camera1["model"] == "OPENCV"
    assert matches.camera1["params"] == [500, 510, 320, 240, 0.1, 0, 0, 0.01]
    np.testing.assert_array_equal(read_colmap_pair(path, images["b.jpg"], "a.jpg").indices, expected[:, ::-1])


def test_colmap_reads_what_we_write(pycolmap, foreign):
    path, images, _, matches = foreign
    write_two_view_geometry(path, "a.jpg", "b.jpg", POSE, matches[:7])
    with pycolmap.Database.open(path) as database:
        geometry = database.read_two_view_geometry(images["a.jpg"], images["b.jpg"])
        swapped = database.read_two_view_geometry(images["b.jpg"], images["a.jpg"])
        cameras = database.read_all_cameras()
    pose = geometry.cam2_from_cam1
    np.testing.assert_allclose(pose.rotation.matrix(), ROTATION, atol=1e-14)
    np.testing.assert_allclose(pose.translation, TRANSLATION, atol=1e-14)
    assert geometry.config == pycolmap.TwoViewGeometryConfiguration.CALIBRATED.value
    np.testing.assert_array_equal(geometry.inlier_matches, matches[:7])
    np.testing.assert_allclose(geometry.E, pycolmap.essential_matrix_from_pose(pose), atol=1e-14)
    inverse = np.linalg.inv(cameras[0].calibration_matrix())
    np.testing.assert_allclose(geometry.F, inverse.T @ geometry.E @ inverse, atol=1e-15)
    assert geometry.H is None
    np.testing.assert_array_equal(swapped.inlier_matches, matches[:7, ::-1])
    np.testing.assert_allclose(swapped.cam2_from_cam1.matrix(), np.linalg.inv(POSE)[:3], atol=1e-14)


def test_colmap_reads_the_older_schema(pycolmap, tmp_path):
    path = tmp_path / "old.db"
    fill_database(path, SCHEMA.replace(", qvec BLOB, tvec BLOB", ""))
    write_two_view_geometry(path, 3, 7, POSE, [[0, 2]])
    with pycolmap.Database.open(path) as database:
        geometry = database.read_two_view_geometry(3, 7)
    np.testing.assert_allclose(geometry.E, pycolmap.essential_matrix_from_pose(pycolmap.Rigid3d(POSE[:3])), atol=1e-14)
    np.testing.assert_array_equal(geometry.inlier_matches, [[0, 2]])


def test_colmap_and_we_have_it_open_at_once(pycolmap, foreign):
    path, images, _, matches = foreign
    with pycolmap.Database.open(path) as database:
        assert Path(f"{path}-wal").exists()
        np.testing.assert_array_equal(read_colmap_pair(path, "a.jpg", "b.jpg").indices, matches)
        write_two_view_geometry(path, "a.jpg", "b.jpg", POSE, matches)
        geometry = database.read_two_view_geometry(images["a.jpg"], images["b.jpg"])
    assert len(geometry.inlier_matches) == 20


FOREVER = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT count(*) FROM n"
PROGRAMS = {
    "for ever": f"CREATE VIEW {{}} AS {FOREVER}",
    "zeros": "CREATE VIEW {} AS SELECT *, zeroblob(2000000000) AS data FROM old",
    "plain": "CREATE VIEW {} AS SELECT * FROM old",
    "virtual": "CREATE VIRTUAL TABLE {} USING rtree(image_id, low, high)",
    "generated": "CREATE TABLE {} (image_id, pair_id, rows AS (1), cols AS (2), data AS (zeroblob(1000000000)))",
}


@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize("table", ["cameras", "images", "keypoints", "matches"])
@pytest.mark.parametrize("program", PROGRAMS)
def test_tables_that_are_programs(path, refused, table, program):
    run(path, f"ALTER TABLE {table} RENAME TO old")
    run(path, PROGRAMS[program].format(table))
    for call in (read_colmap_pair, write):
        assert f"'{table}' is no plain table, as COLMAP makes them" in refused(call, path, 3, 7)


def write(path, image1, image2):
    write_two_view_geometry(path, image1, image2, (np.eye(3), [1, 0, 0]), [[0, 0]])


def test_what_would_never_end_is_interrupted(path, refused, monkeypatch):
    """A program that nobody has thought of, in the place of one that is known."""
    monkeypatch.setattr(colmap_sqlite, "_MAKES_TABLE", re.compile(""))
    monkeypatch.setattr(colmap_sqlite, "_MOST_STEPS", 20)
    run(path, "ALTER TABLE images RENAME TO old")
    run(path, f"CREATE VIEW images AS SELECT image_id, name, ({FOREVER}) AS camera_id FROM old")
    assert "asks for more than a database of COLMAP would (interrupted)" in refused(read_colmap_pair, path, 3, 7)


@pytest.mark.usefixtures("little_memory")
def test_blobs_are_no_longer_than_the_file(path, refused, monkeypatch):
    monkeypatch.setattr(colmap_sqlite, "_MAKES_TABLE", re.compile(""))
    run(path, "ALTER TABLE keypoints RENAME TO old")
    run(path, "CREATE VIEW keypoints AS SELECT image_id, 1 AS rows, 2 AS cols, zeroblob(500000000) AS data FROM old")
    assert "asks for more than a database of COLMAP would" in refused(read_colmap_pair, path, 3, 7)


@pytest.mark.parametrize(("rows", "columns"), [(-3, -2), (-3, 2), (2**62, 2), (2**62, 2**62), (10**18, 4)])
def test_sizes_of_blobs_are_compared_with_their_bytes(path, refused, rows, columns):
    run(path, "UPDATE keypoints SET rows = ?, cols = ?", rows, columns)
    assert "the size of the keypoints of image 3 is wrong" in refused(read_colmap_pair, path, 3, 7)
