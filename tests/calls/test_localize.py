"""Images that are found in a model: from files of hloc, databases and tables; and what is written of them."""

import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nonsac
from database_samples import hloc_files, name_of, write_model, write_photos
from nonsac.calls import localize
from nonsac.evaluation import rotation_error
from nonsac.io import read_colmap_pose
from nonsac.simulate.photos import Photos

PHOTOS, MODEL = 8, 5  # the first ones are the model


@pytest.fixture(scope="module")
def photos():
    return Photos.taken(PHOTOS, 600, 0.7, 3)


@pytest.fixture
def pairs():
    """Each of the other photos with all of the model; half of the matches are wrong, and of the last photo all."""
    return {(a, b): 1.0 if b == PHOTOS - 1 else 0.5 for b in range(MODEL, PHOTOS) for a in range(MODEL)}


@pytest.fixture
def hloc(photos, pairs, tmp_path):
    write_model(tmp_path / "sparse", photos, MODEL)
    _, _, features, matches, listed = hloc_files(tmp_path, photos, pairs)
    queries = tmp_path / "queries.txt"
    queries.write_text("".join(f"{name_of(k)} {photos.camera}\n" for k in range(MODEL, PHOTOS)))
    return (tmp_path / "sparse", features, matches), {"pairs": listed, "cameras": queries, "workers": 1}


def check_poses(lines, photos):
    for line in lines:
        name, *numbers = line.split()
        w, x, y, z, *translation = map(float, numbers)
        true = photos.poses[int(name[:2])]
        assert rotation_error(Rotation.from_quat([x, y, z, w]).as_matrix(), true[:, :3]) < 0.2
        np.testing.assert_allclose(translation, true[:, 3], atol=0.02)


def test_files_of_hloc(hloc, photos, tmp_path):
    files, settings = hloc
    found = nonsac.localize(*files, output=tmp_path / "poses.txt", **settings)
    assert [image.name for image in found.images] == [name_of(k) for k in range(MODEL, PHOTOS)]
    assert [image.status for image in found.images] == ["ok", "ok", "low_support"]
    lines = (tmp_path / "poses.txt").read_text().splitlines()
    assert [line.split()[0] for line in lines] == [name_of(5), name_of(6)]
    check_poses(lines, photos)
    assert found.images[2].T is None
    assert "3 images, 2 localized" in str(found)
    assert "1  low support" in str(found)


def test_a_folder_becomes_a_model(hloc, photos, tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    files, settings = hloc
    found = nonsac.localize(*files, output=tmp_path / "found", **settings)
    np.testing.assert_allclose(read_colmap_pose(tmp_path / "found", name_of(5)), found.images[0].T, atol=1e-9)
    model = pycolmap.Reconstruction(tmp_path / "found")
    assert {image.name for image in model.images.values()} == {name_of(5), name_of(6)}
    assert [camera.params.tolist() for camera in model.cameras.values()] == [list(photos.camera.params)]


def test_a_database_gives_the_same(hloc, photos, pairs, tmp_path):
    files, _ = hloc
    _, matches, *_ = hloc_files(tmp_path, photos, pairs)
    database = write_photos(tmp_path / "database.db", photos, matches)
    found = nonsac.localize(files[0], database, output=tmp_path / "a.txt", workers=1)
    assert [image.name for image in found.images] == [name_of(k) for k in range(MODEL, PHOTOS)]
    check_poses((tmp_path / "a.txt").read_text().splitlines(), photos)
    assert found.statuses == {"ok": 2, "low_support": 1}
    only = tmp_path / "one.txt"
    only.write_text(f"{name_of(6)} {photos.camera}\n")
    found = nonsac.localize(files[0], database, output=tmp_path / "b.txt", cameras=only, workers=1)
    assert [image.name for image in found.images] == [name_of(6)]


def test_guessed_focal_lengths_are_not_relied_on(hloc, photos, pairs, tmp_path):
    files, _ = hloc
    _, matches, *_ = hloc_files(tmp_path, photos, pairs)
    database = write_photos(tmp_path / "database.db", photos, matches, prior=0)
    found = nonsac.localize(files[0], database, output=tmp_path / "a.txt", workers=1)
    assert found.statuses == {"failed": 3}
    assert "is a guess of COLMAP's; give its camera (--cameras)" in found.images[0].error
    again = nonsac.localize(files[0], database, output=tmp_path / "b.txt", cameras=str(photos.camera), workers=1)
    assert again.statuses == {"ok": 2, "low_support": 1}


def test_a_point_that_many_images_show_counts_once(hloc, photos, pairs, tmp_path):
    files, settings = hloc
    _, matches, *_ = hloc_files(tmp_path, photos, pairs)
    found = nonsac.localize(*files, output=tmp_path / "poses.txt", **settings)
    for query, image in zip(range(MODEL, PHOTOS), found.images, strict=True):
        seen = {
            (ours, photos.shown[other][theirs])
            for other in range(MODEL)
            for theirs, ours in matches[other, query].tolist()
        }
        assert image.num_matches == len(seen)


def test_a_folder_of_tables(photos, tmp_path):
    folder = tmp_path / "tables"
    folder.mkdir()
    for number in (2, 3):
        points = photos.points[photos.shown[number]]
        rows = {"points2d": photos.keypoints[number], "points3d": points}
        np.savez(folder / f"{number:02}.npz", **rows, camera=str(photos.camera))
    found = nonsac.localize(folder, output=tmp_path / "a.txt", workers=1)
    assert found.statuses == {"ok": 2}
    lines = (tmp_path / "a.txt").read_text().splitlines()
    check_poses(lines, photos)
    assert [line.split()[0] for line in lines] == ["02", "03"]
    np.savez(folder / "03.npz", points2d=photos.keypoints[3], points3d=photos.points[photos.shown[3]])
    found = nonsac.localize(folder, output=tmp_path / "b.txt", workers=1)
    assert found.statuses == {"ok": 1, "failed": 1}
    assert "there is no camera; give it with cameras" in found.images[1].error
    found = nonsac.localize(folder, output=tmp_path / "c.txt", cameras=photos.camera, workers=2)
    assert found.statuses == {"ok": 2}


def test_a_run_that_was_stopped_goes_on_to_the_same_bytes(hloc, tmp_path):
    files, settings = hloc

    def stop(done, total):
        assert total == 3
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        nonsac.localize(*files, output=tmp_path / "a.txt", progress=stop, **settings)
    with pytest.raises(ValueError, match="left from a run that was stopped, with 2 images done"):
        nonsac.localize(*files, output=tmp_path / "a.txt", **settings)
    nonsac.localize(*files, output=tmp_path / "a.txt", **settings, resume=True)
    nonsac.localize(*files, output=tmp_path / "b.txt", **settings | {"workers": 2})
    assert (tmp_path / "a.txt").read_bytes() == (tmp_path / "b.txt").read_bytes()
    assert not (tmp_path / "a.txt.partial").exists()


@pytest.mark.parametrize("changed", ["cameras", "pairs", "matches"])
def test_a_run_does_not_go_on_with_other_files(hloc, tmp_path, changed):
    files, settings = hloc

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        nonsac.localize(*files, output=tmp_path / "a.txt", progress=stop, **settings)
    if changed == "cameras":
        text = settings["cameras"].read_text()
        settings["cameras"].write_text(text.replace("0 ", "1 ", 1))
    else:
        os.utime(settings["pairs"] if changed == "pairs" else files[2], (1, 1))
    name = "cameras" if changed == "cameras" else "files"
    with pytest.raises(ValueError, match=f"is of a run with {name} "):
        nonsac.localize(*files, output=tmp_path / "a.txt", **settings, resume=True)


def test_an_output_that_is_an_input_is_refused(hloc):
    files, settings = hloc
    before = settings["pairs"].read_bytes()
    with pytest.raises(nonsac.InputError, match="is read by this run"):
        nonsac.localize(*files, output=settings["pairs"], overwrite=True, **settings)
    assert settings["pairs"].read_bytes() == before


def test_a_model_alone_is_no_folder_of_tables(hloc, tmp_path):
    files, _ = hloc
    with pytest.raises(nonsac.InputError, match="is a model, no folder of tables"):
        nonsac.localize(files[0], output=tmp_path / "a.txt", workers=1)


def test_the_first_images_measure_the_noise_for_all(hloc, tmp_path, monkeypatch):
    files, settings = hloc
    monkeypatch.setattr(localize, "FIRST_PAIRS", 2)
    monkeypatch.setattr("nonsac.calls.pooling._FEWEST", 2)
    found = nonsac.localize(*files, output=tmp_path / "a.txt", **settings)
    assert found.noise == np.median([image.noise for image in found.images[:2]]) == pytest.approx(0.7, rel=0.2)
    given = nonsac.localize(*files, output=tmp_path / "b.txt", noise=0.6, **settings)
    assert given.noise == 0.6


def test_what_does_not_fit(hloc, photos, tmp_path):
    files, settings = hloc
    with pytest.raises(ValueError, match="files of hloc need pairs"):
        nonsac.localize(*files, output=tmp_path / "a.txt", workers=1)
    with pytest.raises(ValueError, match="got 3 files"):
        nonsac.localize(*files, tmp_path, output=tmp_path / "a.txt", **settings)
    (tmp_path / "a.txt").write_text("mine")
    with pytest.raises(nonsac.InputError, match="is there already"):
        nonsac.localize(*files, output=tmp_path / "a.txt", **settings)
    with pytest.raises(nonsac.InputError, match="is there already"):
        nonsac.localize(*files, output=tmp_path / "sparse", **settings)
    short = Photos(photos.camera, photos.poses, photos.points, [k[:50] for k in photos.keypoints], photos.shown)
    write_model(tmp_path / "short", short, MODEL)
    with pytest.raises(nonsac.InputError, match="names a keypoint that the image does not have in"):
        nonsac.localize(tmp_path / "short", *files[1:], output=tmp_path / "b.txt", **settings)
    others = tmp_path / "others.txt"
    others.write_text(f"{name_of(0)} {photos.camera}\n")
    with pytest.raises(nonsac.InputError, match="holds no pair of an image of"):
        nonsac.localize(*files, output=tmp_path / "b.txt", **settings | {"cameras": others})
    assert not os.path.exists(tmp_path / "b.txt")
