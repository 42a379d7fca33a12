"""`nonsac absolute-pose`: every kind of input, every output, every refusal."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import nonsac
from cli_samples import BENT, FIRST, SECOND, matrix, said, scene, write_model, write_photo, write_table
from nonsac import io, plot
from nonsac.calls import poses

CAMERA = ("--camera", str(FIRST))
HEADER = "u v X Y Z"


@pytest.fixture(scope="module")
def points():
    return scene()


@pytest.fixture
def table(folder, points):
    """A file of these matches without a camera, and without weights."""
    return write_table("points.npy", points.rows, HEADER)


@pytest.fixture
def drawn(monkeypatch):
    """What is drawn, without drawing it."""
    calls = []
    monkeypatch.setattr(plot, "reprojections", lambda *arguments: calls.append(arguments))
    return calls


def as_json(run, *arguments, code=0):
    found, out, err = run("absolute-pose", *arguments, "--json")
    assert found == code, err
    return json.loads(out)


def assert_same(report, result):
    np.testing.assert_array_equal(report["T"], result.T)
    assert report["num_inliers"] == result.num_inliers
    assert report["success"]


# --- input -------------------------------------------------------------


@pytest.mark.parametrize("name", ["points.npy", "points.csv", "points.txt", "points.parquet"])
def test_tables_with_a_camera_of_the_option(folder, points, run, name):
    report = as_json(run, write_table(name, points.rows, HEADER), *CAMERA)
    assert_same(report, points.solved())
    assert report["camera"] == str(FIRST)
    np.testing.assert_allclose(report["T"], points.T, atol=0.01)
    np.testing.assert_allclose(report["centre"], -points.T[:3, :3].T @ points.T[:3, 3], atol=0.01)


def test_npz_with_camera_and_weights(folder, points, run):
    weights = np.where(points.inliers, 1.0, 0.25)
    np.savez("points.npz", x=points.points2d, X=points.points3d, weights=weights, K=FIRST.K)
    report = as_json(run, "points.npz")
    assert_same(report, points.solved(FIRST.K, weights=weights))
    assert report["T"] != points.solved().T.tolist()


@pytest.mark.parametrize("image", ["one.jpg", 3])
@pytest.mark.parametrize("name", ["sparse", "sparse/images.txt"])
def test_model_by_name_or_number(folder, points, run, image, name):
    write_model(points)
    report = as_json(run, name, "--image", image)
    assert_same(report, points.solved())
    assert report["camera"] == str(FIRST)


def test_the_camera_of_the_option_overrides_that_of_the_file(folder, points, run):
    write_model(points, SECOND)
    assert_same(as_json(run, "sparse", "--image", "one.jpg", *CAMERA), points.solved())


def test_camera_with_a_lens_in_a_file_of_its_own(folder, run):
    points = scene(camera=BENT)
    table = write_table("points.txt", points.rows, HEADER)
    assert_same(as_json(run, table, "--camera", str(BENT), "--picture", "p.png"), points.solved(BENT))
    Path("K.txt").write_text(matrix(BENT))
    report = as_json(run, table, "--camera", "K.txt", "--noise", 4)
    assert_same(report, points.solved(BENT.K, noise=4))


def test_normalised_points_need_no_camera(folder, points, run):
    normalised = FIRST.normalise(points.points2d)
    write_table("points.csv", np.hstack([normalised, points.points3d]), HEADER)
    report = as_json(run, "points.csv", "--noise", 0.001, "--picture", "p.svg")
    assert_same(report, nonsac.absolute_pose(normalised, points.points3d, noise=0.001))
    assert report["camera"] is None


def test_options_are_passed_on(table, points, monkeypatch, run):
    told, result = {}, points.solved()

    def record(rows, second, camera, **options):
        assert (len(rows), rows.width, second, camera) == (400, 5, None, FIRST)
        told.update(options)
        return result

    monkeypatch.setattr(poses, "absolute_pose", record)
    options = {
        "noise": 0.7,
        "samples": 3,
        "sample_size": 50,
        "max_samples": 9,
        "max_uncertainty": 3.0,
        "draw": "blocks",
        "time_limit": 60.0,
        "max_memory": "1 GB",
        "estimator": "ransac",
        "rule": "most_inliers",
        "refine": "full",
        "seed": 5,
        "workers": 1,
    }
    run("absolute-pose", table, *CAMERA, *(x for k, v in options.items() for x in (f"--{k.replace('_', '-')}", v)))
    told.pop("progress")
    del options["seed"]
    assert told == options | {"rng": 5}


# --- output ------------------------------------------------------------


def test_for_people_with_all_outputs(table, points, run):
    outputs = ("--output", "T.txt", "--save-inliers", "mask.csv", "--picture", "p.pdf")
    code, out, err = run("absolute-pose", table, *CAMERA, *outputs)
    assert (code, said(err)) == (0, [])
    result = points.solved()
    centre = ", ".join(f"{x:.6g}" for x in -result.R.T @ result.t)
    assert out.startswith("Result(ok, confidence 1.000)")
    assert f"\ncamera: {FIRST}\nT, from the world to the frame of the camera, which is at [{centre}]:\n" in out
    assert out.endswith("wrote T.txt: T\nwrote mask.csv: which rows are inliers\nwrote p.pdf: the picture\n")
    np.testing.assert_array_equal(io.read_transform("T.txt"), result.T)
    np.testing.assert_array_equal(np.loadtxt("mask.csv"), result.inliers)
    assert Path("p.pdf").read_bytes()[:5] == b"%PDF-"


@pytest.mark.parametrize("camera", [FIRST, BENT])
def test_picture_shows_pixels_and_projections(folder, run, drawn, camera):
    points = scene(camera=camera)
    write_table("points.npy", points.rows, HEADER)
    photo = write_photo("photo.png", 50, 51)
    as_json(run, "points.npy", "--camera", str(camera), "--picture", "p.png", "--photo", photo)
    ((path, observed, projected, inliers, size, photo, title),) = drawn
    np.testing.assert_array_equal(observed, points.points2d)
    np.testing.assert_array_equal(inliers, points.solved(camera).inliers)
    assert np.linalg.norm(observed - projected, axis=1)[points.inliers].max() < 4
    assert np.linalg.norm(observed - projected, axis=1)[~points.inliers].max() > 100
    assert (path.name, size, photo.shape[:2]) == ("p.png", (1000, 1020), (51, 50))
    assert title == "trusted, 50 % inliers"


def test_points_behind_the_camera_are_projected_nowhere(folder, points, run, drawn):
    turned = points.points3d.copy()
    turned[:5] = -9 * turned[:5]
    write_table("points.npy", np.hstack([points.points2d, turned]), HEADER)
    report = as_json(run, "points.npy", *CAMERA, "--picture", "p.png")
    depths = turned @ np.array(report["T"])[2, :3] + np.array(report["T"])[2, 3]
    np.testing.assert_array_equal(np.isnan(drawn[0][2]).all(axis=1), depths <= 0)
    assert (depths <= 0).any()


def test_an_answer_that_is_not_trusted(folder, run):
    table = write_table("points.npy", scene(outliers=1.0).rows, HEADER)
    outputs = ("--output", "T.txt", "--save-inliers", "mask.npy", "--picture", "p.svg")
    code, out, err = run("absolute-pose", table, *CAMERA, *outputs)
    assert code == 1
    assert "Result(low_support" in out
    lines = said(err)
    assert lines[0].startswith("nonsac: NOT TRUSTED (low_support): ")
    assert lines[1:] == [
        "nonsac: T.txt holds T, and T is a guess that is NOT TRUSTED",
        "nonsac: mask.npy holds the inliers of T, and T is a guess that is NOT TRUSTED",
    ]
    assert "NOT TRUSTED: low support" in Path("p.svg").read_text()


def test_too_few_points(folder, points, run):
    write_table("points.csv", points.rows[:2], HEADER)
    outputs = ("--output", "T.txt", "--save-inliers", "mask.npy", "--picture", "p.png")
    code, out, err = run("absolute-pose", "points.csv", *CAMERA, *outputs)
    assert code == 1
    assert out.startswith("Result(too_few: ")
    assert err.count("NOT WRITTEN: no answer was found") == 2
    assert sorted(os.listdir()) == ["p.png", "points.csv"]
    assert as_json(run, "points.csv", *CAMERA, code=1)["centre"] is None


def test_points_that_are_not_finite(folder, points, run):
    rows = points.rows
    rows[3, 1] = rows[5, 4] = np.nan
    write_table("points.npy", rows, HEADER)
    code, _, err = run("absolute-pose", "points.npy", *CAMERA, "--save-inliers", "mask.npy")
    assert code == 0
    assert len(said(err)) == 1
    assert err.splitlines()[-1].startswith("nonsac: warning: dropped 2 ")
    assert len(np.load("mask.npy")) == 400
    write_table("points.npy", np.full((5, 5), np.nan), HEADER)
    code, _, err = run("absolute-pose", "points.npy", *CAMERA, "--picture", "p.png")
    assert code == 1
    assert "p.png is NOT WRITTEN: there is no finite point to draw" in err


# --- refusals ----------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--camera", "1000"], "'--camera': params holds 1 numbers in shape (1,); expected 4 for PINHOLE"),
        (["--camera", "PINHOLE"], "'--camera': 'PINHOLE' is neither a file nor a camera"),
        (["--camera", "PINHOLE 0 1 1 1"], "'--camera': fx is 0.0; expected a focal length above 0"),
        (["--camera1", str(FIRST)], "No such option"),
        (["--samples", "0"], "'--samples': '0' is neither a number of at least 1 nor 'auto'"),
        (["--samples", "many"], "'--samples': 'many' is neither a number of at least 1 nor 'auto'"),
        (["--max-samples", "0"], "'--max-samples': '0' is not a whole number of at least 1"),
        (["--time-limit", "0"], "'--time-limit': '0' is not a positive number"),
        (["--noise", "-1"], "'--noise': '-1' is not a positive number"),
        (["--sample-size", "2"], "'--sample-size': '2' is neither a number of at least 3 nor 'auto'"),
        (["--estimator", "lmeds"], "'--estimator': 'lmeds' is not one of ransac, pcr99"),
        (["--estimator", "pcr99"], "'--estimator': 'pcr99' is not for absolute-pose (pcr99 is for Registration, got"),
        (["--rule", "best"], "'--rule': rule must be one of most_inliers, closest_pair,"),
        (["--output", "T.png"], "'--output': T.png: T is written as text"),
        (["--save-inliers", "mask"], "'--save-inliers': mask: the inliers are written as"),
        (["--save-inliers", "points.npy"], "points.npy is already used for POINTS"),
        (["--picture", "p.gif"], "'--picture': path is 'p.gif'; expected a picture"),
        (["--photo", "a.png", *CAMERA], "'--photo': give --picture, too"),
        (["--photo", "points.npy", "--picture", "p.png", *CAMERA], "'--photo': points.npy: is no image"),
        (["--photo", "points.npy", "--picture", "p.png", "--noise", "1"], "'--photo': the points are not in pixels"),
        (["--image", "one.jpg"], "'--image': points.npy holds the points of one image"),
    ],
)
def test_options_are_refused_before_any_work(table, refused, monkeypatch, options, message):
    monkeypatch.setattr(poses, "absolute_pose", None)
    assert message in refused("absolute-pose", table, *options)


def test_files_that_cannot_be_used(folder, points, refused):
    write_model(points)
    np.savez("skew.npz", x=points.points2d, X=points.points3d, K=[[500.0, 1, 500], [0, 500, 500], [0, 0, 1]])
    np.savez("weights.npz", x=points.points2d, X=points.points3d, K=FIRST.K, weights=np.zeros(400))
    Path("four.csv").write_text("1,2,3,4\n")
    Path("empty").mkdir()
    assert refused("absolute-pose", "none.npz") == "nonsac: none.npz: no such file; check the path\n"
    assert "none: no such file" in refused("absolute-pose", "none", "--image", "one.jpg")
    assert "empty: is no model of COLMAP" in refused("absolute-pose", "empty", "--image", "one.jpg")
    message = refused("absolute-pose", "four.csv", *CAMERA)
    assert "four.csv: rows of 4 columns, not of 5 (u v X Y Z), or 6 with a weight" in message
    assert "skew.npz: camera: K has the skew 1.0" in refused("absolute-pose", "skew.npz")
    assert "weights.npz: weights must not all be zero" in refused("absolute-pose", "weights.npz")
    assert "'--image': sparse holds the points of many images; name one" in refused("absolute-pose", "sparse")
    message = refused("absolute-pose", "sparse", "--image", "no.jpg")
    assert "holds no image 'no.jpg' (it holds one.jpg)" in message


@pytest.mark.parametrize("name", ["sparse", "sparse/images.txt"])
def test_the_model_is_not_overwritten(folder, points, refused, name):
    write_model(points)
    message = refused("absolute-pose", name, "--image", 3, "--output", "sparse/points3D.txt")
    assert "'--output': sparse/points3D.txt is already used for POINTS" in message
