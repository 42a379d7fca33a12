"""Matched rows of any format, opened in one way: for the calls' own readers, jobs and commands."""

import numpy as np
import pytest

import nonsac
from match_samples import POINTS as POINT_ROWS
from match_samples import WEIGHTS, K, fill_database, parquet, write_binary_model
from nonsac.io import open_matches, read_colmap_pair, read_colmap_points, read_hloc
from nonsac.layouts import MATCHES, PAIRS, POINTS
from nonsac.sources import ParquetSource
from nonsac.sources import parquet as parquet_module

CSV = "x1,y1,x2,y2\n1,2,3,4\n"


def rows_of(opened):
    return opened.source.take(np.arange(len(opened.source)))


@pytest.fixture
def database(tmp_path):
    fill_database(tmp_path / "database.db")
    return tmp_path / "database.db"


def test_a_table_stays_where_it_is(make_file, monkeypatch):
    columns = dict(zip(["z", "y", "x", "v", "u"], POINT_ROWS.T[::-1], strict=True))
    path = make_file("a.parquet", parquet(**columns, weight=WEIGHTS, other=WEIGHTS))
    monkeypatch.setattr(ParquetSource, "read_block", None)
    opened = open_matches(POINTS, [path])
    assert isinstance(opened.source, ParquetSource)
    assert opened.source.names == ("u", "v", "x", "y", "z", "weight")
    assert (opened.cameras, opened.indices, opened.is_small) == ((None,), None, True)
    monkeypatch.undo()
    np.testing.assert_array_equal(rows_of(opened), np.column_stack([POINT_ROWS, WEIGHTS]))


def test_a_table_that_is_large_is_not_small(tmp_path):
    np.lib.format.open_memmap(tmp_path / "a.npy", "w+", np.float64, (2_000_001, 4))
    assert not open_matches(MATCHES, [tmp_path / "a.npy"]).is_small
    np.save(tmp_path / "b.npy", np.zeros((1000, 4)))
    assert open_matches(MATCHES, [tmp_path / "b.npy"]).is_small


@pytest.mark.parametrize(
    ("layout", "keys", "cameras"),
    [
        (MATCHES, {}, (None, None)),
        (MATCHES, {"K2": K}, (None, K)),
        (MATCHES, {"camera1": "PINHOLE 640 480 500 510 320 240", "K2": K}, ("PINHOLE 640 480 500 510 320 240", K)),
        (POINTS, {"K": K}, (K,)),
        (PAIRS, {"K": K}, ()),
    ],
)
def test_cameras_are_those_of_the_archive(tmp_path, rng, layout, keys, cameras):
    rows = rng.normal(size=(5, len(layout.names)))
    np.savez(tmp_path / "a.npz", **dict(zip(layout.keys[0], layout.parts(rows), strict=True)), **keys)
    opened = open_matches(layout, [tmp_path / "a.npz"])
    np.testing.assert_array_equal(rows_of(opened), rows)
    assert len(opened.cameras) == len(cameras)
    for found, expected in zip(opened.cameras, cameras, strict=True):
        assert found is expected is None or np.array_equal(found, expected)


def test_columns_and_datasets_are_those_of_a_table(tmp_path, make_file):
    assert rows_of(open_matches(MATCHES, [make_file("a.csv", CSV)], columns=[3, 2, 1, 0])).tolist() == [[4, 3, 2, 1]]
    np.savez(tmp_path / "a.npz", a=np.zeros((2, 4)), b=np.ones((2, 4)))
    assert rows_of(open_matches(MATCHES, [tmp_path / "a.npz"], dataset="b")).all()
    with pytest.importorskip("h5py").File(tmp_path / "a.h5", "w") as file:
        file["rows"] = np.ones((2, 6))
        for name in PAIRS.names:
            file[name] = np.full(2, 7.0)
    assert rows_of(open_matches(PAIRS, [tmp_path / "a.h5"], dataset="rows")).shape == (2, 6)
    assert (rows_of(open_matches(PAIRS, [tmp_path / "a.h5"], columns=PAIRS.names)) == 7.0).all()
    assert rows_of(open_matches(MATCHES, [tmp_path / "a.h5"], dataset="rows", columns=[0, 1, 2, 3])).shape == (2, 4)


def test_a_pair_of_a_database_comes_with_its_cameras_and_numbers(database):
    matches, opened = read_colmap_pair(database, 3, "b.jpg"), open_matches(MATCHES, [database], [3, "b.jpg"])
    np.testing.assert_array_equal(rows_of(opened), np.hstack([matches.points1, matches.points2]))
    assert opened.cameras == (matches.camera1, matches.camera2)
    np.testing.assert_array_equal(opened.indices, matches.indices)


def test_an_image_of_a_model_comes_with_its_camera(tmp_path):
    model = write_binary_model(tmp_path / "sparse")
    points, opened = read_colmap_points(model, "b.jpg"), open_matches(POINTS, [model], ["b.jpg"])
    np.testing.assert_array_equal(rows_of(opened), np.hstack([points.points2d, points.points3d]))
    assert opened.cameras == (points.camera,)


@pytest.mark.parametrize("matched", [True, False])
def test_both_files_of_hloc_belong_together(tmp_path, matched):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "features.h5", "w") as file:
        for name in "ab":
            file[f"{name}/keypoints"] = np.arange(8.0).reshape(4, 2)
    with h5py.File(tmp_path / "matches.h5", "w") as file:
        file["a/b/matches0"] = np.array([3, -1, 0, -1] if matched else [-1] * 4)
        file["a/b/matching_scores0"] = np.linspace(0, 1, 4)
    files = [tmp_path / "features.h5", tmp_path / "matches.h5"]
    expected, opened = read_hloc(*files, "a", "b"), open_matches(MATCHES, files, ["a", "b"])
    assert len(opened.source) == len(expected) == 2 * matched
    table = np.column_stack([expected.points1, expected.points2, expected.weights])
    np.testing.assert_array_equal(rows_of(opened), table)
    np.testing.assert_array_equal(opened.indices, expected.indices)
    assert opened.cameras == (None, None)


def test_two_clouds_match_row_by_row(make_file):
    opened = open_matches(PAIRS, [make_file("a.xyz", "1 2 3\n4 5 6\n"), make_file("b.xyz", "7 8 9\n0 1 2\n")])
    np.testing.assert_array_equal(rows_of(opened), [[1, 2, 3, 7, 8, 9], [4, 5, 6, 0, 1, 2]])
    assert opened.cameras == ()


def test_a_url_is_opened_as_a_table(make_file):
    pytest.importorskip("fsspec")
    columns = {name: [1.0, 2.0] for name in MATCHES.names}
    url = f"file://{make_file('a.db.parquet', parquet(**columns))}"
    opened = open_matches(MATCHES, [url])
    np.testing.assert_array_equal(rows_of(opened), [[1.0] * 4, [2.0] * 4])
    assert opened.cameras == (None, None)


def test_a_table_is_opened_for_its_footer_once(make_file, monkeypatch):
    seen, opened = [], parquet_module._opened
    monkeypatch.setattr(parquet_module, "_opened", lambda path: seen.append(path) or opened(path))
    path = make_file("a.parquet", parquet(**{name: [1.0, 2.0] for name in (*reversed(PAIRS.names), "other")}))
    open_matches(PAIRS, [path])
    assert seen == [str(path)]


@pytest.mark.parametrize(
    ("layout", "files", "named", "message"),
    [
        (
            MATCHES,
            "a",
            {"images": ["a"]},
            "a.csv: matches are those of two images; name two, as image1 and image2, or n",
        ),
        (MATCHES, "a", {"images": [None, "b"]}, "a.csv: matches are those of two images; name two, as image1 and"),
        (POINTS, "a", {"images": ["a", "b"]}, "a.csv: points are those of one image; name one, as image"),
        (PAIRS, "a", {"images": [3]}, "a.csv: pairs of points have no images; leave their names out"),
        (
            MATCHES,
            "ab",
            {},
            "b.csv: hloc keeps the matches of many images, of which none is named; name two, as image1",
        ),
        (
            MATCHES,
            "ab",
            {"images": ["a"]},
            "b.csv: hloc keeps the matches of many images, of which 1 is named; name tw",
        ),
        (POINTS, "ab", {"images": ["a"]}, "b.csv: a second file is for pairs of images or of clouds; give one file of"),
        (MATCHES, "abc", {}, "c.csv: is one file too many; give one file, or two that belong together"),
        (PAIRS, "abc", {}, "c.csv: is one file too many"),
        (PAIRS, "ab", {"columns": [0]}, "a.csv: only a table by itself has columns or a dataset to choose; leave them"),
        (MATCHES, "a", {"images": [1, 2], "dataset": "a"}, "a.csv: only a table by itself has columns or a dataset"),
        (PAIRS, "ab", {}, "a.csv: holds 1 points and b.csv holds 2, so they are no pairs; for unmatched clouds use"),
    ],
)
def test_what_does_not_belong_together_is_refused(make_file, tmp_path, monkeypatch, layout, files, named, message):
    monkeypatch.chdir(tmp_path)
    for name in "abc":
        make_file(f"{name}.csv", "1 2 3\n" if name == "a" else "1 2 3\n4 5 6\n")
    with pytest.raises(nonsac.InputError) as caught:
        open_matches(layout, [f"{name}.csv" for name in files], **named)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_no_files_are_refused():
    with pytest.raises(ValueError, match="files must name at least one"):
        open_matches(MATCHES, [])
