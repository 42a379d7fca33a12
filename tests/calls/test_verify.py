"""Verification of databases: what is written, for COLMAP to read; which pairs are kept; runs that are stopped."""

import json
import os
import sqlite3
from contextlib import closing
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nonsac
from database_samples import many_pairs, name_of, pair_id, rows_of, write_photos
from nonsac.calls import pair_task, verify
from nonsac.calls.pair_records import VerifiedPair
from nonsac.calls.two_views import homography_of
from nonsac.evaluation import rotation_error
from nonsac.io.two_view_geometry import Configuration
from nonsac.running.journal import Journal
from nonsac.simulate.photos import Photos


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A database of 36 pairs, three of which are wrong; its photos, and the share of wrong matches of each pair."""
    path = tmp_path_factory.mktemp("scene") / "database.db"
    return path, *many_pairs(path)


@pytest.fixture(scope="module")
def verified(scene):
    """What came of it, and the copy."""
    path, _, _ = scene
    output = path.with_name("verified.db")
    return nonsac.verify(path, output, workers=1), output


def relative(photos, first, second):
    """The pose X2 = R X1 + t of two photos."""
    a, b = photos.poses[first], photos.poses[second]
    rotation = b[:, :3] @ a[:, :3].T
    return rotation, b[:, 3] - rotation @ a[:, 3]


def test_right_pairs_are_kept_and_wrong_ones_are_not(scene, verified):
    _, _, wrong = scene
    found, _ = verified
    assert {(p.image1, p.image2) for p in found.kept} == {
        (name_of(a), name_of(b)) for (a, b), share in wrong.items() if share < 1.0
    }
    assert found.configurations == {"calibrated": 33}
    assert found.left_out == {"low_support": 3}
    assert found.noise == pytest.approx(0.7, rel=0.1)
    assert "36 pairs, 33 kept; noise 0.6" in str(found)
    assert "3  left out: low support" in str(found)


def test_rows_hold_the_geometry_of_the_photos(scene, verified):
    _, photos, wrong = scene
    right = []
    for (first, second), row in rows_of(verified[1]).items():
        if wrong[first, second] == 1.0:
            assert row == dict.fromkeys(("data", "F", "E", "H", "qvec", "tvec")) | {"rows": 0, "cols": 2, "config": 1}
            continue
        rotation, translation = relative(photos, first, second)
        quaternion, shift = np.frombuffer(row["qvec"]), np.frombuffer(row["tvec"])
        assert rotation_error(Rotation.from_quat(np.roll(quaternion, -1)).as_matrix(), rotation) < 2.0
        assert shift @ translation > 0.99 * np.linalg.norm(translation)
        inliers = np.frombuffer(row["data"], "<u4").reshape(-1, 2)
        assert len(inliers) == row["rows"]
        right += (photos.shown[first][inliers[:, 0]] == photos.shown[second][inliers[:, 1]]).tolist()
        points = [
            np.column_stack([photos.keypoints[k][i], np.ones(len(i))])
            for k, i in zip((first, second), inliers.T, strict=True)
        ]
        F = np.frombuffer(row["F"]).reshape(3, 3)
        lines = points[0] @ F.T
        distances = np.abs((lines * points[1]).sum(axis=1)) / np.linalg.norm(lines[:, :2], axis=1)
        assert np.median(distances) < 1.0
    assert np.mean(right) > 0.95


def test_colmap_reads_what_is_written_and_maps_it(scene, verified, tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    _, photos, _ = scene
    found, output = verified
    with closing(pycolmap.Database.open(tmp_path_copy(output, tmp_path))) as database:
        numbers, geometries = database.read_two_view_geometries()
        by_pair = dict(zip(numbers, geometries, strict=True))
        geometry = by_pair[pair_id(0, 1)]
        rotation, translation = relative(photos, 0, 1)
        assert geometry.config == pycolmap.TwoViewGeometryConfiguration.CALIBRATED
        assert rotation_error(geometry.cam2_from_cam1.rotation.matrix(), rotation) < 2.0
        assert geometry.cam2_from_cam1.translation @ translation > 0.99 * np.linalg.norm(translation)
        assert len(geometry.inlier_matches) == found.pairs[0].num_inliers
    models = pycolmap.incremental_mapping(tmp_path / output.name, tmp_path, tmp_path)
    [model] = models.values()
    assert model.num_reg_images() == len(photos.poses)
    images = sorted(model.images.values(), key=lambda image: image.name)
    centres = np.array([image.projection_center() for image in images])
    true = np.array([-pose[:, :3].T @ pose[:, 3] for pose in photos.poses])
    if hasattr(pycolmap, "global_mapping"):  # GLOMAP, from version 4 on
        [of_glomap] = pycolmap.global_mapping(tmp_path / output.name, tmp_path, tmp_path).values()
        assert of_glomap.num_reg_images() == len(photos.poses)
    aligned = nonsac.register_pairs(centres, true, scale=None, noise=0.01)
    assert np.linalg.norm(aligned.apply(centres) - true, axis=1).max() < 0.02  # the cameras are 4 from the scene


def tmp_path_copy(path, folder):
    copy = folder / path.name
    copy.write_bytes(path.read_bytes())
    return copy


def test_the_database_is_not_changed_by_a_copy_and_holds_the_same_in_place(scene, verified, tmp_path):
    path, _, _ = scene
    copy = tmp_path_copy(path, tmp_path)
    before = copy.read_bytes()
    found = nonsac.verify(copy, tmp_path / "out.db", workers=1)
    assert copy.read_bytes() == before
    assert rows_of(copy) == {}
    assert nonsac.verify(copy, copy, workers=1) == found == verified[0]
    assert rows_of(copy) == rows_of(tmp_path / "out.db") == rows_of(verified[1])
    assert sorted(os.listdir(tmp_path)) == sorted([path.name, "out.db"])


def test_any_number_of_workers_writes_the_same_bytes(scene, verified, tmp_path):
    nonsac.verify(scene[0], tmp_path / "out.db", workers=2)
    assert (tmp_path / "out.db").read_bytes() == verified[1].read_bytes()


@pytest.mark.parametrize("after", [3, 16, 30])
def test_a_run_that_was_stopped_goes_on_to_the_same_bytes(scene, verified, tmp_path, after, monkeypatch):
    output = tmp_path / "out.db"

    def stop(done, total):
        assert total == 36
        if done == after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        nonsac.verify(scene[0], output, workers=1, progress=stop)
    assert os.listdir(tmp_path) == ["out.db.partial"]
    with pytest.raises(ValueError, match=f"left from a run that was stopped, with {after} pairs done"):
        nonsac.verify(scene[0], output, workers=1)
    with pytest.raises(ValueError, match=r"is of a run with settings .* resume with the settings of that run"):
        nonsac.verify(scene[0], output, workers=1, resume=True, noise=0.7)
    done = []
    run = pair_task.PairTask.__call__
    monkeypatch.setattr(pair_task.PairTask, "__call__", lambda task, item: done.append(item) or run(task, item))
    found = nonsac.verify(scene[0], output, workers=1, resume=True)
    assert len(done) == 36 - after
    assert found == verified[0]
    assert output.read_bytes() == verified[1].read_bytes()
    assert os.listdir(tmp_path) == ["out.db"]


def test_a_run_of_other_pairs_does_not_go_on(scene, tmp_path):
    def stop(done, total):
        raise KeyboardInterrupt

    for second in (1, 2):
        (tmp_path / f"{second}.txt").write_text(f"{name_of(0)} {name_of(second)}\n")
    output = tmp_path / "out.db"
    with pytest.raises(KeyboardInterrupt):
        nonsac.verify(scene[0], output, pairs=tmp_path / "1.txt", workers=1, progress=stop)
    with pytest.raises(ValueError, match="is of a run with pairs "):
        nonsac.verify(scene[0], output, pairs=tmp_path / "2.txt", workers=1, resume=True)
    assert nonsac.verify(scene[0], output, pairs=tmp_path / "1.txt", workers=1, resume=True).pairs[0].image2 == name_of(
        1
    )


def test_pairs_that_are_skipped_measure_no_noise(scene, tmp_path):
    copy = tmp_path_copy(scene[0], tmp_path)
    with closing(sqlite3.connect(copy)) as database, database:
        database.execute("INSERT INTO cameras SELECT 2, model, width, height, params, 0 FROM cameras")
        database.execute("UPDATE images SET camera_id = 2 WHERE image_id IN (3, 4)")
    found = nonsac.verify(copy, tmp_path / "out.db", workers=1)
    assert found.left_out["skipped"] == 15
    assert found.noise == pytest.approx(0.7, rel=0.15)


def test_a_list_of_pairs_in_either_order(scene, verified, tmp_path):
    listed = tmp_path / "pairs.txt"
    listed.write_text(f"# chosen\n{name_of(3)} {name_of(1)}\n\n{name_of(0)} {name_of(2)}\n")
    found = nonsac.verify(scene[0], tmp_path / "out.db", pairs=listed, noise=verified[0].noise, workers=1)
    assert [(p.image1, p.image2) for p in found.pairs] == [(name_of(0), name_of(2)), (name_of(1), name_of(3))]
    assert set(rows_of(tmp_path / "out.db")) == {(0, 2), (1, 3)}
    assert found.noise == verified[0].noise


# --- the noise -----------------------------------------------------------------------------


def test_the_pairs_with_the_most_matches_measure_the_noise_for_all(scene, tmp_path, monkeypatch):
    noises = {}
    run = pair_task.PairTask.__call__

    def noted(task, item):
        noises[item.names] = (task.noise, len(item.matches))
        return run(task, item)

    monkeypatch.setattr(pair_task.PairTask, "__call__", noted)
    found = nonsac.verify(scene[0], tmp_path / "out.db", workers=1)
    first = [count for noise, count in noises.values() if noise is None]
    assert len(first) == verify.FIRST_PAIRS
    assert min(first) >= max(count for noise, count in noises.values() if noise is not None)
    assert {noise for noise, _ in noises.values()} == {None, found.noise}
    measured = [p.noise for p in found.pairs if noises[p.image1, p.image2][0] is None and p.status == "ok"]
    assert found.noise == np.median(measured)


def test_a_pair_with_more_noise_than_the_others_is_kept(tmp_path, rng):
    """With the noise of the others its rows would ask for different models, or spread over the threshold."""
    photos = Photos.taken(7, 600, 0.3, 1)
    photos.keypoints[6] = photos.keypoints[6] + rng.normal(0.0, 1.5, photos.keypoints[6].shape)  # out of focus
    pairs = [(a, b) for b in range(7) for a in range(b)]
    path = write_photos(tmp_path / "a.db", photos, {pair: photos.matches(*pair, 0.3, rng) for pair in pairs})
    found = nonsac.verify(path, tmp_path / "out.db", workers=1)
    assert found.noise == pytest.approx(0.3, rel=0.2)
    assert len(found.kept) == len(pairs)


def test_too_few_pairs_share_no_noise(scene, tmp_path):
    listed = tmp_path / "pairs.txt"
    listed.write_text(f"{name_of(0)} {name_of(1)}\n{name_of(0)} {name_of(2)}\n")
    found = nonsac.verify(scene[0], tmp_path / "out.db", pairs=listed, workers=1)
    assert found.noise is None
    assert "noise" not in str(found)


# --- kinds of geometry ---------------------------------------------------------------------


CAMERA = nonsac.Camera("PINHOLE", (800, 800, 500, 400), 1000, 800)


def pair_of(tmp_path, points1, points2, prior=1, **settings):
    """Verify one pair of matched pixels; returns it, and its row."""
    photos = Photos(CAMERA, np.zeros((2, 3, 4)), np.zeros((0, 3)), [points1, points2], [])
    indices = np.column_stack([np.arange(len(points1))] * 2)
    path = write_photos(tmp_path / "one.db", photos, {(0, 1): indices}, prior)
    found = nonsac.verify(path, tmp_path / "out.db", workers=1, noise=0.5, **settings)
    [pair] = found.pairs
    return pair, rows_of(tmp_path / "out.db").get((0, 1)), found


def seen(points, rotation, translation, rng):
    moved = points @ rotation.T + translation
    return CAMERA.project(moved[:, :2] / moved[:, 2:]) + rng.normal(0.0, 0.5, (len(points), 2))


TURN = Rotation.from_rotvec([0.05, 0.2, 0.02]).as_matrix()


def with_outliers(points1, points2, rng, count=60):
    others = rng.uniform(0, (1000, 800), (2, count, 2))
    return np.vstack([points1, others[0]]), np.vstack([points2, others[1]])


def box(rng, count=200):
    return rng.uniform((-2, -1.5, 4), (2, 1.5, 8), (count, 3))


def check_homography(row, points1, points2):
    H = np.frombuffer(row["H"]).reshape(3, 3)
    moved = np.column_stack([points1, np.ones(len(points1))]) @ H.T
    assert np.median(np.linalg.norm(moved[:, :2] / moved[:, 2:] - points2, axis=1)) < 2.0


def test_panoramic(tmp_path, rng):
    points = box(rng)
    a, b = seen(points, np.eye(3), np.zeros(3), rng), seen(points, TURN, np.zeros(3), rng)
    pair, row, _ = pair_of(tmp_path, *with_outliers(a, b, rng))
    assert (pair.configuration, pair.status, pair.kept) == ("panoramic", "degenerate", True)
    assert row["config"] == Configuration.PANORAMIC == 5
    assert rotation_error(Rotation.from_quat(np.roll(np.frombuffer(row["qvec"]), -1)).as_matrix(), TURN) < 0.5
    np.testing.assert_array_equal(np.frombuffer(row["tvec"]), np.zeros(3))
    assert pair.num_inliers == row["rows"] >= 195
    check_homography(row, a, b)


def test_planar_with_two_poses(tmp_path, rng):
    points = np.column_stack([rng.uniform(-2, 2, (200, 2)), np.full(200, 5.0)])
    points[:, 2] += 0.5 * points[:, 0]
    a, b = seen(points, np.eye(3), np.zeros(3), rng), seen(points, TURN, np.array([1.0, 0.2, 0.1]), rng)
    pair, row, _ = pair_of(tmp_path, *with_outliers(a, b, rng))
    assert (pair.configuration, pair.kept) == ("planar", True)
    assert pair.status in ("ambiguous", "ok")
    assert row["config"] == Configuration.PLANAR == 4
    assert (row["qvec"] is None) == (pair.status == "ambiguous")
    check_homography(row, a, b)


def test_a_plane_that_faces_the_camera(tmp_path, rng):
    """As far as the images tell, it might be a rotation with another focal length."""
    points = np.column_stack([rng.uniform(-1.6, 1.6, (200, 2)), np.full(200, 5.0)])
    a, b = seen(points, np.eye(3), np.zeros(3), rng), seen(points, TURN, np.array([0.3, 0.0, 0.0]), rng)
    pair, row, _ = pair_of(tmp_path, *with_outliers(a, b, rng))
    assert (pair.configuration, pair.status, pair.kept) == ("planar_or_panoramic", "degenerate", True)
    assert any("with a focal length" in remark for remark in pair.remarks)
    assert (row["config"], row["qvec"], row["tvec"]) == (Configuration.PLANAR_OR_PANORAMIC, None, None)
    assert 195 <= pair.num_inliers == row["rows"] <= 205
    check_homography(row, a, b)


def test_watermark(tmp_path, rng):
    """The same signature at the edge of two photos that show different things."""
    mark = rng.uniform((20, 700), (400, 780), (80, 2))
    a, b = mark + rng.normal(0, 0.3, mark.shape), mark + np.array([3, 1]) + rng.normal(0, 0.3, mark.shape)
    pair, row, found = pair_of(tmp_path, *with_outliers(a, b, rng))
    assert (pair.configuration, pair.kept) == ("watermark", False)
    assert row["config"] == Configuration.WATERMARK == 7
    assert found.left_out == {"watermark": 1}


def test_a_shift_in_the_middle_is_no_watermark(tmp_path, rng):
    mark = rng.uniform((200, 200), (800, 600), (80, 2))
    a, b = mark + rng.normal(0, 0.3, mark.shape), mark + np.array([3, 1]) + rng.normal(0, 0.3, mark.shape)
    pair, _, _ = pair_of(tmp_path, *with_outliers(a, b, rng))
    assert pair.configuration != "watermark"


def test_degenerate_with_few_matches(tmp_path, rng):
    pair, row, _ = pair_of(tmp_path, *rng.uniform(0, 800, (2, 4, 2)))
    assert (pair.configuration, pair.status, pair.kept) == ("degenerate", "too_few", False)
    assert (row["config"], row["rows"], row["data"]) == (1, 0, None)


def test_guessed_focal_lengths_are_said_so(tmp_path, rng):
    points = box(rng)
    views = seen(points, np.eye(3), np.zeros(3), rng), seen(points, TURN, np.array([1.0, 0.2, 0.1]), rng)
    pair, row, _ = pair_of(tmp_path, *views, prior=0)
    assert (pair.status, pair.remarks, row) == (
        "skipped",
        ("focal lengths are guesses of COLMAP's (--trust-focal-lengths, or --fallback pycolmap)",),
        None,
    )


def test_guessed_focal_lengths_are_relied_on_if_told_so(tmp_path, rng):
    points = box(rng)
    views = seen(points, np.eye(3), np.zeros(3), rng), seen(points, TURN, np.array([1.0, 0.2, 0.1]), rng)
    assert pair_of(tmp_path, *views, prior=0, trust_focal_lengths=True)[0].configuration == "calibrated"


def test_guessed_focal_lengths_are_left_to_pycolmap(tmp_path, rng):
    pytest.importorskip("pycolmap")
    points = box(rng)
    views = seen(points, np.eye(3), np.zeros(3), rng), seen(points, TURN, np.array([1.0, 0.2, 0.1]), rng)
    pair, row, _ = pair_of(tmp_path, *with_outliers(*views, rng), prior=0, fallback="pycolmap")
    assert (pair.status, pair.configuration, row["config"]) == ("fallback", "uncalibrated", 3)
    assert pair.num_inliers == row["rows"] >= 190
    F, points1 = np.frombuffer(row["F"]).reshape(3, 3), np.column_stack([views[0], np.ones(200)])
    lines = points1 @ F.T
    distances = np.abs((lines * np.column_stack([views[1], np.ones(200)])).sum(axis=1))
    assert np.median(distances / np.linalg.norm(lines[:, :2], axis=1)) < 2.0


def test_homography(rng):
    H = np.array([[1.1, 0.1, 30], [-0.05, 0.9, -20], [1e-4, -2e-4, 1]])
    points = rng.uniform(0, 1000, (30, 2))
    moved = np.column_stack([points, np.ones(30)]) @ H.T
    moved = moved[:, :2] / moved[:, 2:]
    np.testing.assert_allclose(homography_of(points, moved), H, rtol=1e-6, atol=1e-9)
    moved[:4] += 200.0
    np.testing.assert_allclose(homography_of(points, moved), H, rtol=1e-6, atol=1e-9)
    assert homography_of(points[:3], points[:3]) is None


# --- what is refused -----------------------------------------------------------------------


def test_a_database_without_matches(tmp_path):
    path = write_photos(tmp_path / "a.db", Photos.taken(2, 20, 0.5), {})
    with pytest.raises(nonsac.InputError, match="holds no matches; match its images first"):
        nonsac.verify(path, tmp_path / "out.db", workers=1)
    assert os.listdir(tmp_path) == ["a.db"]


def test_what_is_damaged(scene, tmp_path):
    copy = tmp_path_copy(scene[0], tmp_path)
    copy.write_bytes(copy.read_bytes()[:20_000])
    with pytest.raises(nonsac.InputError, match="truncated or damaged"):
        nonsac.verify(copy, tmp_path / "out.db", workers=1)
    assert not (tmp_path / "out.db").exists()


def test_a_database_that_is_locked_or_read_only(scene, tmp_path, monkeypatch):
    from nonsac.io import colmap_sqlite

    monkeypatch.setattr(colmap_sqlite, "_SECONDS_TO_WAIT", 0.01)
    copy = tmp_path_copy(scene[0], tmp_path)
    with closing(sqlite3.connect(copy, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(nonsac.InputError, match="locked by another program"):
            nonsac.verify(copy, copy, workers=1)
        other.execute("ROLLBACK")
    assert rows_of(copy) == {}


def test_a_database_that_another_program_has_open(scene, verified, tmp_path):
    """In the mode that COLMAP uses, changes lie in a file beside it."""
    copy = tmp_path_copy(scene[0], tmp_path)
    with closing(sqlite3.connect(copy)) as other:
        other.execute("PRAGMA journal_mode=WAL")
        with other:
            other.execute("UPDATE images SET name = 'new.jpg' WHERE image_id = 9")
        found = nonsac.verify(copy, tmp_path / "out.db", workers=1)
        assert {p.image2 for p in found.pairs if not p.image2[0].isdecimal()} == {"new.jpg"}
        assert len(rows_of(tmp_path / "out.db")) == 36
        assert nonsac.verify(copy, copy, workers=1) == found
        assert other.execute("SELECT count(*) FROM two_view_geometries").fetchone() == (36,)
    assert sorted(os.listdir(tmp_path)) == [copy.name, "out.db"]


def test_a_dask_cluster_writes_the_same_bytes(scene, verified, tmp_path):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        nonsac.verify(scene[0], tmp_path / "out.db", workers=client)
    assert (tmp_path / "out.db").read_bytes() == verified[1].read_bytes()


def test_a_database_that_changes_while_it_is_read(scene, tmp_path):
    copy = tmp_path_copy(scene[0], tmp_path)

    def change(done, total):
        if done == total:
            copy.write_bytes(copy.read_bytes())

    with pytest.raises(nonsac.InputError, match="was changed by another program while it was read"):
        nonsac.verify(copy, tmp_path / "out.db", workers=1, progress=change)
    assert not (tmp_path / "out.db").exists()


def test_matches_that_change_before_they_are_written(scene, tmp_path, monkeypatch):
    """As many as before, in another order: the inliers would be others."""
    copy, write = tmp_path_copy(scene[0], tmp_path), verify.write_geometries

    def change_and_write(path, *rest):
        with closing(sqlite3.connect(path)) as database, database:
            key = (pair_id(3, 4),)
            data = database.execute("SELECT data FROM matches WHERE pair_id = ?", key).fetchone()[0]
            turned = np.frombuffer(data, np.uint32).reshape(-1, 2)[::-1].tobytes()
            database.execute("UPDATE matches SET data = ? WHERE pair_id = ?", (turned, *key))
        write(path, *rest)

    monkeypatch.setattr(verify, "write_geometries", change_and_write)
    for output in (copy, tmp_path / "out.db"):
        with pytest.raises(nonsac.InputError, match=r"the matches of 03\.jpg and 04.jpg have changed since"):
            nonsac.verify(copy, output, workers=1)
        copy = tmp_path_copy(scene[0], tmp_path)
    assert not (tmp_path / "out.db").exists()


def test_an_output_that_is_an_input_is_refused(scene, tmp_path):
    listed = tmp_path / "pairs.txt"
    listed.write_text(f"{name_of(0)} {name_of(1)}\n")
    with pytest.raises(nonsac.InputError, match="is read by this run"):
        nonsac.verify(scene[0], listed, pairs=listed, overwrite=True, workers=1)
    assert listed.read_text() == f"{name_of(0)} {name_of(1)}\n"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"fallback": "opencv"}, "fallback must be one of 'skip', 'pycolmap', got 'opencv'"),
        ({"noise": -1.0}, "noise must be"),
        ({"workers": 0}, "workers must be"),
        ({"max_smples": 3}, "did you mean max_samples"),
    ],
)
def test_arguments(scene, tmp_path, settings, message):
    with pytest.raises((TypeError, ValueError), match=message):
        nonsac.verify(scene[0], tmp_path / "out.db", **settings)


def test_an_output_is_not_replaced_unasked(scene, tmp_path):
    (tmp_path / "out.db").write_text("mine")
    with pytest.raises(nonsac.InputError, match="is there already"):
        nonsac.verify(scene[0], tmp_path / "out.db", workers=1)
    assert (tmp_path / "out.db").read_text() == "mine"


@pytest.mark.parametrize("line", ["one.jpg", "a.jpg b.jpg c.jpg", "a.jpg a.jpg"])
def test_lists_that_are_none(scene, tmp_path, line):
    (tmp_path / "pairs.txt").write_text(f"{name_of(0)} {name_of(1)}\n{line}\n")
    with pytest.raises(nonsac.InputError, match="line 2 "):
        nonsac.verify(scene[0], tmp_path / "out.db", pairs=tmp_path / "pairs.txt", workers=1)


def test_names_that_the_database_lacks(scene, tmp_path):
    (tmp_path / "pairs.txt").write_text(f"{name_of(0)} other.jpg\n")
    with pytest.raises(nonsac.InputError, match=r"holds no matches of 'other\.jpg'"):
        nonsac.verify(scene[0], tmp_path / "out.db", pairs=tmp_path / "pairs.txt", workers=1)


def test_records_of_something_else(tmp_path):
    with Journal(tmp_path / "a", {}, False, "pairs") as kept:
        kept.add(0, {"image1": "a"})
    with pytest.raises(ValueError, match="is not a record of a run"):
        Journal(tmp_path / "a", {}, True, "pairs", partial(verify._check_record, 5))


def test_a_pair_that_fails_takes_its_own_place_only(scene, verified, tmp_path, monkeypatch):
    run = pair_task.PairTask.__call__

    def fails(task, item):
        if item.names == (name_of(0), name_of(1)):
            raise RuntimeError("out of paper")
        return run(task, item)

    monkeypatch.setattr(pair_task.PairTask, "__call__", fails)
    found = nonsac.verify(scene[0], tmp_path / "out.db", workers=1, noise=verified[0].noise)
    assert found.pairs[0] == VerifiedPair(
        name_of(0),
        name_of(1),
        "undefined",
        "failed",
        verified[0].pairs[0].num_matches,
        error="RuntimeError: out of paper",
    )
    assert found.left_out["failed"] == 1
    assert len(found.kept) == 32
    assert set(rows_of(tmp_path / "out.db")) == set(rows_of(verified[1])) - {(0, 1)}


def test_lines_of_json(verified, tmp_path):
    found, _ = verified
    found.write(tmp_path / "pairs.jsonl")
    lines = [json.loads(line) for line in (tmp_path / "pairs.jsonl").read_text().splitlines()]
    assert [VerifiedPair(**line | {"remarks": tuple(line["remarks"])}) for line in lines] == list(found.pairs)
