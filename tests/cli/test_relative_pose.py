"""`nonsac relative-pose`: every kind of input, every output, every refusal."""

import json
import os
import re
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import nonsac
from cli_samples import (
    BENT,
    FIRST,
    IMAGES,
    NUMBERS,
    SECOND,
    matrix,
    read_geometry,
    said,
    two_views,
    write_database,
    write_hloc,
    write_photo,
    write_table,
)
from nonsac import io, plot, simulate
from nonsac.calls import poses

CAMERAS = ("--camera1", str(FIRST), "--camera2", str(SECOND))
NAMES = ("--image1", IMAGES[0], "--image2", IMAGES[1])
HEADER = "x1 y1 x2 y2"


@pytest.fixture(scope="module")
def views():
    return two_views()


@pytest.fixture
def table(folder, views):
    """A file of these matches without cameras, and without weights."""
    return write_table("pairs.npy", views.rows, HEADER)


@pytest.fixture
def no_truth(folder):
    """Matches of a database, none of which is right."""
    return write_database(two_views(outliers=1.0))


@pytest.fixture
def drawn(monkeypatch):
    """What is drawn, without drawing it."""
    calls = []
    monkeypatch.setattr(plot, "two_views", lambda *arguments: calls.append(arguments))
    return calls


def as_json(run, *arguments, code=0):
    found, out, err = run("relative-pose", *arguments, "--json")
    assert found == code, err
    return json.loads(out)


def assert_same(report, result):
    np.testing.assert_array_equal(report["T"], result.T)
    assert report["num_inliers"] == result.num_inliers
    assert report["success"]


# --- input -------------------------------------------------------------


@pytest.mark.parametrize("name", ["pairs.npy", "pairs.csv", "pairs.txt", "pairs.parquet"])
def test_tables_with_cameras_of_options(folder, views, run, name):
    report = as_json(run, write_table(name, views.rows, HEADER), *CAMERAS)
    assert_same(report, views.solved())
    assert (report["camera1"], report["camera2"]) == (str(FIRST), str(SECOND))
    assert nonsac.evaluation.rotation_error(np.array(report["T"])[:3, :3], views.T[:3, :3]) < 0.5
    assert np.array(report["T"])[:3, 3] @ views.T[:3, 3] > 0.999


def test_npz_with_cameras_and_weights(folder, views, run):
    arrays = {"points1": views.points1, "points2": views.points2, "weights": views.weights}
    np.savez("pairs.npz", **arrays, K1=FIRST.K, camera2=str(SECOND))
    report = as_json(run, "pairs.npz")
    assert_same(report, views.solved(FIRST.K, SECOND, weights=views.weights))
    assert report["T"] != views.solved(FIRST.K, SECOND).T.tolist()
    assert (report["camera1"], report["camera2"]) == ("PINHOLE 500.0 510.0 495.0 505.0", str(SECOND))


def test_hloc_in_both_orders(folder, views, run):
    files = write_hloc(views)
    there = as_json(run, *files, *NAMES, *CAMERAS)
    assert_same(there, views.solved(weights=views.weights))
    swapped = ("--image1", IMAGES[1], "--image2", IMAGES[0], "--camera1", str(SECOND), "--camera2", str(FIRST))
    back = as_json(run, *files, *swapped)
    np.testing.assert_allclose(np.array(back["T"])[:3, :3], np.array(there["T"])[:3, :3].T, atol=0.02)


@pytest.mark.parametrize("names", [IMAGES, NUMBERS])
def test_database_by_name_or_number(folder, views, run, names):
    write_database(views)
    report = as_json(run, "database.db", "--image1", names[0], "--image2", names[1])
    assert_same(report, views.in_single_precision().solved())
    assert (report["camera1"], report["camera2"]) == (str(FIRST), str(SECOND))


def test_cameras_of_options_override_those_of_the_file(folder, views, run):
    np.savez("pairs.npz", points1=views.points1, points2=views.points2, K1=np.diag([9.0, 9, 1]), K2=SECOND.K)
    report = as_json(run, "pairs.npz", "--camera1", str(FIRST))
    assert_same(report, views.solved(FIRST, SECOND.K))
    report = as_json(run, "pairs.npz", *CAMERAS)
    assert_same(report, views.solved())


def test_a_camera_of_an_option_replaces_one_that_cannot_be_read(folder, views, run, refused):
    write_database(views)
    with closing(sqlite3.connect("database.db")) as database, database:
        database.execute("UPDATE cameras SET model = 17, params = ?", (np.zeros(2).tobytes(),))
    message = refused("relative-pose", "database.db", *NAMES)
    assert "database.db: the camera has the model EQUIRECTANGULAR, but nonsac knows only" in message
    assert message.count("database.db") == 1
    report = as_json(run, "database.db", *NAMES, *CAMERAS)
    assert_same(report, views.in_single_precision().solved())


def test_the_second_camera_is_the_first_by_default(folder, run):
    views = two_views(camera2=FIRST)
    report = as_json(run, write_table("pairs.npy", views.rows, HEADER), "--camera1", str(FIRST))
    assert_same(report, views.solved(FIRST, FIRST))
    assert report["camera2"] == str(FIRST)


@pytest.mark.parametrize("form", ["500,510,495,505", "500 510 495 505", "7 PINHOLE 1000 1020 500 510 495 505", "K.txt"])
def test_forms_of_cameras(table, views, run, form):
    Path("K.txt").write_text(f"# K\n{matrix(FIRST)}\n")
    report = as_json(run, table, "--camera1", form, "--camera2", str(SECOND))
    assert_same(report, views.solved())


def test_normalised_points_need_no_camera(folder, run):
    views = two_views()
    rows = np.hstack([FIRST.normalise(views.points1), SECOND.normalise(views.points2)])
    write_table("pairs.csv", rows, HEADER)
    report = as_json(run, "pairs.csv", "--noise", 0.001, "--picture", "p.svg")
    assert_same(report, nonsac.relative_pose(rows[:, :2], rows[:, 2:], noise=0.001))
    assert report["camera1"] is report["camera2"] is None
    _, out, _ = run("relative-pose", "pairs.csv", "--noise", 0.001)
    assert "camera1: none, the points are normalised" in out


def test_an_uncertain_pose_fails_unless_that_much_is_allowed(folder, run):
    half = np.tan(np.radians(5.5))
    views = simulate.narrow_view(200, 0.3, 0.004, 2)
    pixels = [500.0 / half * points + 500.0 for points in (views.points1, views.points2)]
    table = write_table("narrow.npy", np.hstack(pixels), HEADER)
    arguments = (table, "--camera1", f"PINHOLE {500 / half} {500 / half} 500 500", "--noise", 2.0)
    report = as_json(run, *arguments, code=1)
    assert report["status"] == "uncertain"
    assert 5.0 < report["uncertainty"]["rotation"] < 20.0
    allowed = as_json(run, *arguments, "--max-uncertainty", 30)
    assert allowed["success"]
    assert allowed["T"] == report["T"]
    as_json(run, *arguments, "--max-uncertainty", 5.5, code=1)


def test_options_are_passed_on(table, views, monkeypatch, run):
    told, result = {}, views.solved()

    def record(rows, second, *cameras, **options):
        assert (len(rows), rows.width, second, cameras) == (400, 4, None, (FIRST, SECOND))
        told.update(options)
        return result

    monkeypatch.setattr(poses, "relative_pose", record)
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
    run("relative-pose", table, *CAMERAS, *(x for k, v in options.items() for x in (f"--{k.replace('_', '-')}", v)))
    told.pop("progress")
    del options["seed"]
    assert told == options | {"rng": 5}


# --- output ------------------------------------------------------------


def test_for_people(table, views, run):
    pictures = ("--picture", "p.png", "--picture-hypotheses", "h.png")
    code, out, err = run("relative-pose", table, *CAMERAS, "--output", "T.txt", *pictures)
    assert (code, said(err)) == (0, [])
    assert out.startswith("Result(ok, confidence 1.000)")
    assert f"\ncamera1: {FIRST}\ncamera2: {SECOND}\n" in out
    assert "the unknown length of t is set to 1" in out
    result = views.solved()
    np.testing.assert_array_equal(io.read_transform("T.txt"), result.T)
    printed = [line.split() for line in out.splitlines() if re.fullmatch(r"( +[-+.\de]+){4}", line)]
    np.testing.assert_allclose(np.array(printed, float), result.T, atol=1e-8)
    assert out.endswith("wrote T.txt: T\nwrote p.png: the picture\nwrote h.png: what came of each sample\n")
    plot.hypotheses("same.png", result)
    assert Path("h.png").read_bytes() == Path("same.png").read_bytes()
    assert Path("p.png").read_bytes()[:4] == b"\x89PNG"


def test_remarks_are_printed(folder, run):
    """All points on a plane: the second pose that it allows puts some of them behind a camera, or it does not."""
    rng = np.random.default_rng(0)
    world = np.column_stack([rng.uniform(-2, 2, (300, 2)), np.zeros(300)])
    world[:, 2] = 5 + 0.2 * world[:, 0]
    seen = world + np.array([0.5, 0.1, 0.2])
    pixels = [FIRST.project(p[:, :2] / p[:, 2:]) + 0.3 * rng.standard_normal((300, 2)) for p in (world, seen)]
    write_table("pairs.npy", np.hstack(pixels), HEADER)
    code, out, _ = run("relative-pose", "pairs.npy", "--camera1", str(FIRST))
    assert "\n  remark: planar\n" in out
    report = as_json(run, "pairs.npy", "--camera1", str(FIRST), code=code)
    assert report["info"]["remarks"] == ["planar"]


@pytest.mark.parametrize("name", ["mask.npy", "mask.txt", "mask.csv"])
def test_save_inliers(table, views, run, name):
    code, out, _ = run("relative-pose", table, *CAMERAS, "--save-inliers", name)
    assert code == 0
    assert f"wrote {name}: which rows are inliers" in out
    mask = np.load(name) if name.endswith("npy") else np.array(Path(name).read_text().split("\n")[:-1])
    if name.endswith("npy"):
        assert mask.dtype == np.bool_
    else:
        assert set(mask) == {"0", "1"}
    np.testing.assert_array_equal(mask.astype(int), views.solved().inliers)
    assert (mask.astype(int) == views.inliers).mean() > 0.95
    assert sorted(os.listdir()) == sorted([name, table])


def test_picture_shows_pixels_and_the_lines_of_the_pose(table, views, run, drawn):
    as_json(run, table, *CAMERAS, "--picture", "p.png")
    ((path, points1, points2, inliers, F, *sizes, photo1, photo2, title),) = drawn
    np.testing.assert_array_equal(np.hstack([points1, points2]), views.rows)
    np.testing.assert_array_equal(inliers, views.solved().inliers)
    first, second = (np.column_stack([p, np.ones(len(p))])[inliers] for p in (points1, points2))
    lines = first @ F.T
    distances = np.abs((second * lines).sum(axis=1)) / np.linalg.norm(lines[:, :2], axis=1)
    assert np.median(distances) < 1.5
    assert sizes == [(1000, 1020), (1280, 1240)]
    assert (path.name, photo1, photo2) == ("p.png", None, None)
    assert re.fullmatch(r"trusted, 5\d % inliers", title)


def test_picture_without_sizes_or_with_a_lens(folder, run, drawn):
    views = two_views(camera1=BENT)
    write_table("pairs.npy", views.rows, HEADER)
    camera2 = ",".join(map(str, SECOND.params))
    report = as_json(run, "pairs.npy", "--camera1", str(BENT), "--camera2", camera2, "--picture", "p.svg")
    assert_same(report, views.solved(BENT))
    (_, _, _, _, _, *sizes, _, _, title) = drawn[0]
    assert sizes == [(1000, 1020), None]
    assert title.endswith("; epipolar lines without lens distortion")


def test_photos_are_drawn_behind_the_points(table, run, drawn):
    photos = ("--photo1", write_photo("1.png", 50, 51), "--photo2", write_photo("2.png", 64, 62))
    as_json(run, table, *CAMERAS, "--picture", "p.png", *photos)
    assert [photo.shape[:2] for photo in drawn[0][7:9]] == [(51, 50), (62, 64)]


def test_a_picture_of_photos(table, run):
    from matplotlib.image import imread

    as_json(run, table, *CAMERAS, "--picture", "without.png")
    as_json(run, table, *CAMERAS, "--picture", "with.png", "--photo2", write_photo("2.png", 64, 62))
    without, with_photo = (imread(name)[:, :, :3].mean(axis=(0, 2)) for name in ("without.png", "with.png"))
    darker = without - with_photo > 0.05
    assert darker[len(darker) // 2 :].mean() > 0.8
    assert not darker[: len(darker) // 2 - 50].any()


def test_json_is_all_of_stdout_whatever_is_written(folder, views, run):
    write_database(views)
    outputs = ("--output", "T.txt", "--save-inliers", "mask.npy", "--picture", "p.png", "--write-geometry")
    report = as_json(run, "database.db", *NAMES, *outputs)
    np.testing.assert_array_equal(io.read_transform("T.txt"), report["T"])
    assert sorted(os.listdir()) == ["T.txt", "database.db", "mask.npy", "p.png"]
    assert read_geometry() is not None


@pytest.mark.parametrize("swapped", [False, True])
def test_write_geometry(folder, views, run, swapped):
    write_database(views)
    names = IMAGES[::-1] if swapped else IMAGES
    options = ("--image1", names[0], "--image2", names[1], "--write-geometry", "--save-inliers", "mask.npy")
    code, out, _ = run("relative-pose", "database.db", *options, "--output", "T.txt")
    assert code == 0
    mask, T = np.load("mask.npy"), io.read_transform("T.txt")
    assert f"wrote database.db: the two-view geometry of {names[0]} and {names[1]}, {mask.sum()} matches" in out
    row = read_geometry()
    written = np.frombuffer(row["data"], "<u4").reshape(-1, 2)
    np.testing.assert_array_equal(written, np.column_stack([np.flatnonzero(mask)] * 2))
    t = np.frombuffer(row["tvec"])  # from the image of the smaller number, which is IMAGES[1]
    np.testing.assert_allclose(t, T[:3, 3] if swapped else -T[:3, :3].T @ T[:3, 3], atol=1e-12)
    assert abs(np.frombuffer(row["F"]).reshape(3, 3)).max() > 0


def test_no_geometry_of_an_answer_that_is_not_trusted(no_truth, run):
    before = Path(no_truth).read_bytes()
    options = ("--write-geometry", "--output", "T.txt", "--save-inliers", "mask.txt", "--picture", "p.svg")
    code, out, err = run("relative-pose", no_truth, *NAMES, *options)
    assert code == 1
    assert "Result(low_support" in out
    lines = said(err)
    assert lines[0].startswith("nonsac: NOT TRUSTED (low_support): ")
    assert lines[1:] == [
        "nonsac: T.txt holds T, and T is a guess that is NOT TRUSTED",
        "nonsac: mask.txt holds the inliers of T, and T is a guess that is NOT TRUSTED",
        "nonsac: database.db: the two-view geometry is NOT WRITTEN: the answer is not trusted",
    ]
    assert "NOT TRUSTED: low support" in Path("p.svg").read_text()
    assert Path(no_truth).read_bytes() == before
    assert read_geometry() is None


def test_too_few_matches(folder, views, run):
    write_table("pairs.csv", views.rows[:4], HEADER)
    outputs = ("--output", "T.txt", "--save-inliers", "mask.npy", "--picture", "p.svg")
    code, out, err = run("relative-pose", "pairs.csv", *CAMERAS, *outputs)
    assert code == 1
    assert out.startswith("Result(too_few: ")
    assert err.count("NOT WRITTEN: no answer was found") == 2
    assert sorted(os.listdir()) == ["p.svg", "pairs.csv"]
    assert "no trusted pose" in Path("p.svg").read_text()
    assert as_json(run, "pairs.csv", *CAMERAS, code=1)["T"] == [[None] * 4] * 4


def test_a_pair_without_matches(folder, views, run):
    write_database(views)
    options = ("--image1", IMAGES[0], "--image2", "three.jpg", "--picture", "p.png", "--write-geometry")
    code, out, err = run("relative-pose", "database.db", *options)
    assert code == 1
    assert out.startswith("Result(too_few: ")
    assert "nonsac: p.png is NOT WRITTEN: there is no finite point to draw\n" in err
    assert "NOT WRITTEN: the answer is not trusted" in err
    assert os.listdir() == ["database.db"]


def test_matches_that_are_not_finite(folder, views, run):
    rows = views.rows
    rows[3, 1] = np.nan
    write_table("pairs.npy", rows, HEADER)
    code, _, err = run("relative-pose", "pairs.npy", *CAMERAS, "--save-inliers", "mask.npy")
    assert code == 0
    assert len(said(err)) == 1
    assert err.splitlines()[-1].startswith("nonsac: warning: dropped 1 ")
    mask = np.load("mask.npy")
    assert len(mask) == 400
    assert not mask[3]


# --- refusals ----------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--camera1", "1000,1000"], "'--camera1': params holds 2 numbers in shape (2,); expected 4 for PINHOLE"),
        (["--camera1", ""], "'--camera1': '' is neither a file nor a camera such as 'PINHOLE 1600"),
        (["--camera1", "K.txt"], "'--camera1': 'K.txt' is neither a file nor a camera"),
        (["--camera1", "EQUIRECTANGULAR 2 1"], "model is 'EQUIRECTANGULAR'; expected one of SIMPLE_PINHOLE"),
        (["--camera1", "PINHOLE 1 2 x 4"], "'--camera1': 'PINHOLE 1 2 x 4' holds a word that is not a number"),
        (["--camera1", "0,500,1,1"], "'--camera1': fx is 0.0; expected a focal length above 0"),
        (["--camera1", "nan,500,1,1"], "'--camera1': fx is nan; expected a finite number"),
        (["--camera1", "bad.txt"], "'--camera1': bad.txt: holds 2 rows of 3 columns; write K as three lines"),
        (["--camera1", "singular.txt"], "'--camera1': singular.txt: fy is 0.0; expected a focal length above 0"),
        (["--camera1", "skew.txt"], "'--camera1': skew.txt: K has the skew 2.0"),
        (["--camera1", "words.txt"], "'--camera1': words.txt: line 2: 'b' is not a number"),
        (["--camera2", "0,1,1,1"], "'--camera2': fx is 0.0"),
        (["--camera2", str(SECOND)], "'--camera1': give the camera of the first image, too"),
        (["--samples", "0"], "'--samples': '0' is neither a number of at least 1 nor 'auto'"),
        (["--samples", "many"], "'--samples': 'many' is neither a number of at least 1 nor 'auto'"),
        (["--max-samples", "0"], "'--max-samples': '0' is not a whole number of at least 1"),
        (["--time-limit", "0"], "'--time-limit': '0' is not a positive number"),
        (["--noise", "0"], "'--noise': '0' is not a positive number"),
        (["--noise", "inf"], "'--noise': 'inf' is not a positive number"),
        (["--samples", "0"], "'--samples'"),
        (["--sample-size", "4"], "'--sample-size': '4' is neither a number of at least 5 nor 'auto'"),
        (["--estimator", "lmeds"], "'--estimator': 'lmeds' is not one of ransac, pcr99"),
        (["--estimator", "pcr99"], "'pcr99' is not for relative-pose (pcr99 is for 3D registrations"),
        (["--rule", "best"], "'--rule': rule must be one of most_inliers, closest_pair,"),
        (["--output", "T.npz"], "'--output': T.npz: T is written as text"),
        (["--save-inliers", "mask.npz"], "'--save-inliers': mask.npz: the inliers are written as .npy, .txt or .csv"),
        (["--save-inliers", "none/mask.npy"], "'--save-inliers': none/mask.npy: the folder"),
        (["--save-inliers", "pairs.npy"], "'--save-inliers': pairs.npy is already used for MATCHES"),
        (["--save-inliers", "a.txt", "--output", "./a.txt"], "a.txt is already used for --output"),
        (["--picture", "p.jpg"], "'--picture': path is 'p.jpg'; expected a picture"),
        (["--picture", "a.png", "--photo1", "a.png"], "'--picture': a.png is already used for --photo1"),
        (["--camera1", "singular.txt", "--output", "singular.txt"], "'--camera1': singular.txt: fy is 0.0"),
        (["--photo1", "a.png", *CAMERAS], "'--photo1': give --picture, too"),
        (["--photo2", "none.png", "--picture", "p.png", *CAMERAS], "'--photo2': none.png: no such file"),
        (["--photo2", "words.txt", "--picture", "p.png", *CAMERAS], "'--photo2': words.txt: is no image"),
        (["--photo1", "a.png", "--picture", "p.png", "--noise", "1"], "'--photo1': the points are not in pixels"),
        (["--image1", "1.jpg"], "'--image2': name both images, or none"),
        (["--image2", "1.jpg"], "'--image1': name both images, or none"),
        (["--image1", "1", "--image2", "2"], "'--image1': pairs.npy holds the matches of one pair"),
        (["--write-geometry", *CAMERAS], "'--write-geometry': pairs.npy is no COLMAP database"),
        (["other.h5", *CAMERAS], "'SECOND': pairs.npy needs no second file"),
    ],
)
def test_options_are_refused_before_any_work(table, refused, monkeypatch, options, message):
    monkeypatch.setattr(poses, "relative_pose", None)
    Path("bad.txt").write_text("1 0 0\n0 1 0\n")
    Path("singular.txt").write_text("500 0 1\n0 0 1\n0 0 1\n")
    Path("skew.txt").write_text("500 2 1\n0 500 1\n0 0 1\n")
    Path("words.txt").write_text("1 0 0\n0 b 0\n0 0 1\n")
    write_photo("a.png", 4, 4)
    assert message in refused("relative-pose", table, *options)


def test_an_output_may_not_replace_the_file_of_a_camera(table, refused):
    Path("K.txt").write_text(matrix(FIRST))
    message = refused("relative-pose", table, "--camera1", "K.txt", "--output", "K.txt")
    assert "'--output': K.txt is already used for --camera1" in message


def test_files_that_cannot_be_used(folder, views, refused):
    Path("cut.npz").write_bytes(b"PK\x03\x04 and so on")
    Path("text.db").write_text("no database")
    Path("pairs.foo").write_bytes(bytes(range(256)))
    Path("three.csv").write_text("1,2,3\n")
    np.savez("singular.npz", points1=views.points1, points2=views.points2, K1=np.diag([500.0, 0, 1]))
    np.savez("second.npz", points1=views.points1, points2=views.points2, K2=SECOND.K)
    np.savez("weights.npz", points1=views.points1, points2=views.points2, K1=FIRST.K, weights=-views.weights)
    assert refused("relative-pose", "none.npz") == "nonsac: none.npz: no such file; check the path\n"
    assert "none.db: no such file" in refused("relative-pose", "none.db", *NAMES)
    assert "cut.npz: is truncated or damaged" in refused("relative-pose", "cut.npz")
    assert "text.db: is not an SQLite database" in refused("relative-pose", "text.db", *NAMES)
    message = refused("relative-pose", "pairs.foo")
    assert "pairs.foo: is no table of rows, it looks like an unknown binary file; give one of Parquet file" in message
    message = refused("relative-pose", "three.csv")
    assert "three.csv: rows of 3 columns, not of 4 (x1 y1 x2 y2), or 5 with a weight; choose columns" in message
    assert "singular.npz: camera1: fy is 0.0; expected a focal length" in refused("relative-pose", "singular.npz")
    assert "'--camera1': give the camera of the first image" in refused("relative-pose", "second.npz")
    assert "weights.npz: weights must not be negative" in refused("relative-pose", "weights.npz")


def test_images_that_are_not_there(folder, views, refused):
    write_hloc(views)
    write_database(views)
    unknown = ("--image1", IMAGES[0], "--image2", "no.jpg")
    hloc = ("relative-pose", "features.h5", "matches.h5", *CAMERAS)
    assert "features.h5: holds no keypoints of image 'no.jpg'" in refused(*hloc, *unknown)
    assert "database.db: holds no image 'no.jpg' (it holds two.jpg" in refused("relative-pose", "database.db", *unknown)
    unknown = ("--image1", 4, "--image2", 77)
    assert "database.db: holds no image 77 (it holds 4" in refused("relative-pose", "database.db", *unknown)
    same = ("--image1", 4, "--image2", IMAGES[1])
    assert "are the same image" in refused("relative-pose", "database.db", *same)
    assert "'--image1': database.db holds the matches of many images" in refused("relative-pose", "database.db")


def test_hloc_files_that_do_not_go_together(folder, views, refused):
    write_hloc(views)
    write_database(views)
    assert "'SECOND': features.h5: hloc keeps matches apart" in refused("relative-pose", "features.h5", *NAMES)
    assert "'--image1': features.h5 holds" in refused("relative-pose", "features.h5", "matches.h5", *CAMERAS)
    message = refused("relative-pose", "features.h5", "matches.h5", *NAMES)
    assert "'--camera1': the points look like pixels, and there is no camera" in message
    message = refused("relative-pose", "features.h5", "none.h5", *NAMES, *CAMERAS)
    assert message == "nonsac: none.h5: no such file; check the path\n"
    assert "'SECOND': database.db needs no second" in refused("relative-pose", "database.db", "matches.h5", *NAMES)


def test_geometry_that_could_not_be_written_is_refused_before_any_work(folder, views, refused, monkeypatch):
    monkeypatch.setattr(poses, "relative_pose", None)
    write_database(views)
    write_hloc(views)
    geometry = (*NAMES, "--write-geometry")
    message = refused("relative-pose", "features.h5", "matches.h5", *CAMERAS, *geometry)
    assert "'--write-geometry': features.h5 is no COLMAP database" in message
    for camera in (CAMERAS[:2], CAMERAS[2:]):
        message = refused("relative-pose", "database.db", *camera, *geometry)
        assert "has to fit the cameras of the database; leave out --camera1 and --camera2" in message
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK or Path(path).is_dir())
    assert "database.db is write-protected" in refused("relative-pose", "database.db", *geometry)
