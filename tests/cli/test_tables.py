"""Tables that are read in pieces: `plan`, and the other commands on Parquet, Arrow and the like."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import nonsac
from cli_samples import FIRST, SECOND, scene, subprocess_nonsac, two_views, write_table
from nonsac import plot, simulate
from nonsac.cli import run as flow

CAMERAS = ("--camera1", str(FIRST), "--camera2", str(SECOND))
MATCHES, POINTS, PAIRS = ("x1", "y1", "x2", "y2"), ("u", "v", "X", "Y", "Z"), ("x1", "y1", "z1", "x2", "y2", "z2")


@pytest.fixture(scope="module")
def views():
    return two_views()


@pytest.fixture(scope="module")
def pairs():
    return simulate.registration(400, 0.5, 0.01, 1)


def write(path, columns, rows_in_a_group=150):
    """A folder of Parquet files, one such file, or an Arrow file, with a column of words before the others."""
    pa = pytest.importorskip("pyarrow")
    from pyarrow import feather, parquet

    table = pa.table({"word": ["a"] * len(next(iter(columns.values())))} | columns)
    if path.endswith(".arrow"):
        feather.write_feather(table, path, chunksize=rows_in_a_group)
    elif path.endswith(".parquet"):
        parquet.write_table(table, path, row_group_size=rows_in_a_group)
    else:
        Path(path).mkdir()
        half = table.num_rows // 2
        parquet.write_table(table[:half], f"{path}/1.parquet", row_group_size=rows_in_a_group)
        parquet.write_table(table[half:], f"{path}/2.parquet", row_group_size=rows_in_a_group)
    return path


def columns(names, rows):
    """Reversed, so that they are found by name alone."""
    return dict(reversed(list(zip(names, rows.T, strict=True))))


def as_json(run, *arguments):
    code, out, err = run(*arguments, "--json")
    assert code == 0, err
    return json.loads(out)


# --- answers are those of the arrays -----------------------------------


@pytest.mark.parametrize("path", ["rows.arrow", "rows", "rows/*.parquet"])
def test_relative_pose(folder, views, run, path):
    write(path.split("/")[0], columns(MATCHES, views.rows) | {"weight": views.weights})
    report = as_json(run, "relative-pose", path, *CAMERAS)
    np.testing.assert_array_equal(report["T"], views.solved(weights=views.weights).T)


@pytest.mark.parametrize("path", ["rows.arrow", "rows"])
def test_absolute_pose(folder, run, path):
    points = scene()
    write(path, columns(POINTS, points.rows))
    report = as_json(run, "absolute-pose", path, "--camera", str(FIRST))
    np.testing.assert_array_equal(report["T"], points.solved().T)


@pytest.mark.parametrize("path", ["rows.arrow", "rows", "rows.parquet"])
def test_register_pairs(folder, pairs, run, path):
    write(path, columns(PAIRS, np.hstack([pairs.source, pairs.target])))
    report = as_json(run, "register-pairs", path, "--noise", 0.01)
    np.testing.assert_array_equal(report["T"], nonsac.register_pairs(pairs.source, pairs.target, noise=0.01).T)


@pytest.fixture
def read(monkeypatch):
    """How many rows are read of sources of files, call by call."""
    counts = []

    def take(source, indices):
        counts.append(len(indices))
        return source.original_take(indices)

    def chunks(source, rows, start=0, stop=None):
        counts.append((len(source) if stop is None else stop) - start)
        return source.original_chunks(rows, start, stop)

    for kind in (nonsac.NpySource, nonsac.ParquetSource):
        monkeypatch.setattr(kind, "original_take", kind.take, raising=False)
        monkeypatch.setattr(kind, "original_chunks", kind.chunks, raising=False)
        monkeypatch.setattr(kind, "take", take)
        monkeypatch.setattr(kind, "chunks", chunks)
    return counts


@pytest.mark.parametrize("name", ["rows.npy", "rows.parquet", "rows.arrow"])
def test_tables_are_read_in_pieces(folder, run, read, name):
    """Of a table of whatever size no more is read than the call itself reads, and 1,000 rows that are looked at."""
    many = two_views(n=6000)
    if name == "rows.npy":
        np.save(name, many.rows)
    else:
        write(name, columns(MATCHES, many.rows), 1000)
    chosen = {"samples": 2, "sample_size": 200, "refine": "union", "workers": 1}
    source = nonsac.open_source(name, layout="x1 y1 | x2 y2")
    expected = nonsac.relative_pose(source, None, FIRST, SECOND, **chosen)
    by_the_call = read.copy()
    read.clear()
    options = [part for key, value in chosen.items() for part in (f"--{key.replace('_', '-')}", value)]
    report = as_json(run, "relative-pose", name, *CAMERAS, *options)
    assert read == [1000, *by_the_call]
    np.testing.assert_array_equal(report["T"], expected.T)
    assert name != "rows.npy" or sum(read) < 4000


@pytest.mark.parametrize("chosen", ["c,d,a,b", "3, 4,1,2"])
def test_columns_of_options(folder, views, run, chosen):
    a, b, c, d = views.rows.T
    write("rows.parquet", {"a": c, "b": d, "c": a, "d": b})
    report = as_json(run, "relative-pose", "rows.parquet", *CAMERAS, "--columns", chosen)
    np.testing.assert_array_equal(report["T"], views.solved().T)


def test_columns_of_text(folder, views, run):
    np.savetxt("rows.csv", views.rows[:, ::-1], "%.17g", ",", header="d,c,b,a", comments="")
    report = as_json(run, "relative-pose", "rows.csv", *CAMERAS, "--columns", "a,b,c,d")
    np.testing.assert_array_equal(report["T"], views.solved().T)


def test_a_dataset(folder, views, run):
    h5py = pytest.importorskip("h5py")
    with h5py.File("rows.h5", "w") as file:
        file["some/rows"] = views.rows
    report = as_json(run, "relative-pose", "rows.h5", *CAMERAS, "--dataset", "some/rows")
    np.testing.assert_array_equal(report["T"], views.solved().T)


# --- files that are written --------------------------------------------


def test_all_inliers_are_written_and_some_rows_drawn(folder, views, run, monkeypatch):
    drawn = []
    monkeypatch.setattr(plot, "two_views", lambda *arguments: drawn.append(arguments))
    monkeypatch.setattr(flow, "_DRAWN", (60, 2))
    monkeypatch.setattr("nonsac.io.matches._SMALL", 1000)
    write("rows.arrow", columns(MATCHES, views.rows), 100)
    outputs = ("--save-inliers", "mask.npy", "--picture", "p.png")
    code, _, err = run("relative-pose", "rows.arrow", *CAMERAS, *outputs)
    assert code == 0
    assert "nonsac: p.png shows 60 of 400 rows\n" in err
    mask = np.load("mask.npy")
    np.testing.assert_array_equal(mask, views.solved().inliers)
    _, first, second, inliers = drawn[0][:4]
    places = [int(np.flatnonzero((views.points1 == point).all(axis=1))[0]) for point in first]
    assert len(set(places)) == 60
    np.testing.assert_array_equal(second, views.points2[places])
    np.testing.assert_array_equal(inliers, mask[places])
    assert "shows" not in run("relative-pose", "rows.arrow", *CAMERAS, *outputs, "--quiet")[2]


@pytest.mark.parametrize("command", ["relative-pose", "absolute-pose", "register-pairs"])
def test_pictures(folder, views, pairs, run, command):
    names, rows, options = {
        "relative-pose": (MATCHES, views.rows, CAMERAS),
        "absolute-pose": (POINTS, scene().rows, ("--camera", str(FIRST))),
        "register-pairs": (PAIRS, np.hstack([pairs.source, pairs.target]), ("--noise", "0.01")),
    }[command]
    write("rows.arrow", columns(names, rows))
    code, _, err = run(command, "rows.arrow", *options, "--picture", "p.png")
    assert code == 0, err
    assert Path("p.png").stat().st_size > 1000


@pytest.mark.parametrize("name", ["rows.npy", "rows.parquet", "rows.csv"])
def test_all_rows_of_a_small_table_are_drawn(folder, views, run, monkeypatch, name):
    drawn = []
    monkeypatch.setattr(plot, "two_views", lambda *arguments: drawn.append(arguments))
    monkeypatch.setattr(flow, "_DRAWN", (60, 2))
    write_table(name, views.rows, " ".join(MATCHES))
    code, _, err = run("relative-pose", name, *CAMERAS, "--picture", "p.png")
    assert code == 0
    assert "shows" not in err
    np.testing.assert_array_equal(np.hstack(drawn[0][1:3]), views.rows)
    np.testing.assert_array_equal(drawn[0][3], views.solved().inliers)


@pytest.mark.parametrize("name", ["pairs.npy", "pairs.parquet", "pairs.csv"])
def test_the_source_of_a_small_table_is_written_aligned(folder, pairs, run, refused, monkeypatch, name):
    write_table(name, np.hstack([pairs.source, pairs.target]), " ".join(PAIRS))
    assert run("register-pairs", name, "--noise", 0.01, "--save-aligned", "moved.npy")[0] == 0
    result = nonsac.register_pairs(pairs.source, pairs.target, noise=0.01)
    np.testing.assert_array_equal(np.load("moved.npy"), result.apply(pairs.source))
    monkeypatch.setattr("nonsac.io.matches._SMALL", 1000)
    if name != "pairs.csv":  # text is in memory
        message = refused("register-pairs", name, "--save-aligned", "a.ply")
        assert f"'--save-aligned': {name} is read in pieces, never whole; write T with --output" in message


@pytest.mark.parametrize("name", ["rows.dat", "rows", "rows.tsv", "rows.npy"])
def test_the_content_says_of_which_kind_a_file_is(folder, views, run, name):
    np.savetxt("text", views.rows, "%.17g", "\t")
    for kind in ("text", write_table("array.npy", views.rows, ""), write_table("p.parquet", views.rows, "x1 y1 x2 y2")):
        Path(name).write_bytes(Path(kind).read_bytes())
        report = as_json(run, "relative-pose", name, *CAMERAS)
        np.testing.assert_array_equal(report["T"], views.solved().T)


@pytest.mark.parametrize("name", ["rows.csv", "rows.parquet"])
def test_columns_are_found_by_name_in_whatever_order_and_case(folder, views, run, name):
    table = np.column_stack([views.weights, views.rows[:, ::-1], views.weights])
    write_table(name, table, "id Y2 X2 Y1 X1 weight")
    report = as_json(run, "relative-pose", name, *CAMERAS)
    np.testing.assert_array_equal(report["T"], views.solved(weights=views.weights).T)


# --- refusals ----------------------------------------------------------


def test_what_cannot_be_used(folder, views, refused):
    write("rows.arrow", dict(zip("abcd", views.rows.T, strict=True)) | {"e": views.weights, "f": views.weights})
    write("words.arrow", {"a": np.arange(3)})
    write("odd.parquet", columns(MATCHES, views.rows))
    Path("rows").mkdir()
    for name in ("1", "2"):
        Path(f"rows/{name}.parquet").write_bytes(Path("odd.parquet").read_bytes())
    write("rows/3.parquet", columns(MATCHES[:3], views.rows[:, :3]))
    Path("cut.arrow").write_bytes(Path("rows.arrow").read_bytes()[:3000])
    np.savetxt("rows.csv", views.rows, delimiter=",")
    np.save("six.npy", np.column_stack([views.rows, views.weights, views.weights]))
    np.save("across.npy", views.rows.T)
    unfit, chosen = "(a b c d e f), of which none is called x1 y1 x2 y2", "a,b,c,d"
    for arguments, message in (
        (
            ["rows.arrow"],
            f"rows.arrow: rows of 6 columns {unfit}; rename the columns, or choose them, by name or position (columns=",
        ),
        (["six.npy"], "six.npy: rows of 6 columns, not of 4 (x1 y1 x2 y2), or 5 with a weight; choose columns"),
        (["across.npy"], "across.npy: rows of 400 columns, not of 4 (x1 y1 x2 y2), or 5 with a weight; transpose it"),
        (["rows.arrow", "--columns", "a,b,c,g"], "rows.arrow: holds no column 'g' (it holds word, a, b, c, d, e, f)"),
        (["rows.arrow", "--columns", "a,b,,c"], "'--columns': 'a,b,,c' is no list of columns such as x1,y1,x2,y2"),
        (["rows.arrow", "--columns", "a,b,word,c"], "rows.arrow: column 'word' holds string, not numbers"),
        (["rows.arrow", "--columns", "1,2,3"], "columns must choose 4 (x1 y1 x2 y2), or 5 with a weight; got 3"),
        (["rows.arrow", "--columns", "1,2,3,77"], "rows.arrow: holds no column 77, counted from 0 (it holds word, a"),
        (["rows.arrow", "--dataset", "x"], "rows.arrow: holds no datasets, it is an Arrow file"),
        (["rows"], "rows/3.parquet: holds no column 'y2' (it holds word, x2, y1, x1)"),
        (["cut.arrow"], "cut.arrow: is truncated or damaged"),
        (["none.arrow", "--columns", chosen], "none.arrow: no such file; check the path"),
        (["*.feather"], "*.feather: no file matches this pattern; check the path"),
        (["rows.csv", "--columns", "x,y,z,u"], "rows.csv: has no header line"),
        (
            ["rows.arrow", "--columns", chosen, "--image1", "a", "--image2", "b"],
            "'--columns': rows.arrow is no table",
        ),
        (["rows.arrow", "--columns", "a,b,c,d"], "'--camera1': the points look like pixels, and there is no camera"),
        (["memory://nothing.parquet"], "memory://nothing.parquet: no such file; check the path"),
    ):
        assert message in refused("relative-pose", *arguments), arguments


@pytest.mark.parametrize("name", ["rows.csv", "rows.npy", "rows.parquet"])
def test_weights_that_mean_nothing(folder, views, refused, name):
    for weights, message in (
        (np.where(np.arange(400) == 200, -0.5, 1.0), "weights must not be negative, got -0.5"),
        (np.zeros(400), "weights must not all be zero"),
    ):
        write_table(name, np.column_stack([views.rows, weights]), " ".join((*MATCHES, "weight")))
        assert f"{name}: {message}" in refused("relative-pose", name, *CAMERAS)


def test_weights_of_the_rows_that_are_looked_at(folder, views, run, refused):
    """They are those of the first block: if they are zero, others may follow."""
    tables = {}
    for name, weight in (("negative.arrow", -0.5), ("zero.arrow", 0.0)):
        tables[name] = np.column_stack([views.rows, np.where(np.arange(400) < 50, weight, 1.0)])
        write(name, columns((*MATCHES, "weight"), tables[name]), 50)
    message = refused("relative-pose", "negative.arrow", *CAMERAS)
    assert "negative.arrow: weights must not be negative, got -0.5" in message
    report = as_json(run, "relative-pose", "zero.arrow", *CAMERAS)
    np.testing.assert_array_equal(report["T"], views.solved(weights=tables["zero.arrow"][:, 4]).T)


# --- plans -------------------------------------------------------------


def test_a_plan(folder, views, run):
    write("rows", columns(MATCHES, views.rows) | {"more": views.weights})
    code, out, err = run("plan", "rows", "--problem", "relative-pose")
    assert (code, err) == (0, "")
    assert out.startswith("400 rows of 4 columns, in 4 blocks that are read whole (ParquetSource)\n")
    assert "estimated" in out
    report = json.loads(run("plan", "rows", "--json", "--samples", 3, "--sample-size", 50)[1])
    assert report == nonsac.plan(nonsac.open_source("rows"), samples=3, sample_size=50).to_dict()
    assert (report["columns"], report["rows_read"]) == (5, 400)
    assert json.loads(run("plan", "rows", "--json", "--draw", "blocks")[1]) == json.loads(
        run("plan", "rows", "--json")[1]
    )
    assert json.loads(run("plan", "rows", "--json", "--columns", "x1")[1])["columns"] == 1


def test_plans_that_cannot_be_made(folder, views, refused):
    write("rows", columns(MATCHES, views.rows))
    message = refused("plan", "rows", "--problem", "absolute-pose")
    assert "rows: rows of 4 columns (y2 x2 y1 x1), of which none is called u v X Y Z; rename" in message
    assert "none: no such file" in refused("plan", "none")
    assert "'--samples'" in refused("plan", "rows", "--samples", 0)
    assert "'--problem'" in refused("plan", "rows", "--problem", "line")
    assert "'--draw'" in refused("plan", "rows", "--draw", "groups")


@pytest.mark.parametrize("name", ["-", "/dev/stdin"])
@pytest.mark.slow
def test_a_table_from_standard_input(folder, views, name):
    write_table("rows.csv", views.rows[:, [2, 3, 0, 1]], "x1 y1 x0 y0")
    done = subprocess_nonsac("relative-pose", name, *CAMERAS, "--json", input=Path("rows.csv").read_text())
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(json.loads(done.stdout)["T"], views.solved().T)
    done = subprocess_nonsac("relative-pose", name, *CAMERAS, input="1 2\x00")
    assert done.returncode == 2
    assert f"nonsac: {name}: is not a text table, it looks like an unknown binary file" in done.stderr


def test_a_manifest_is_a_regular_file(folder, refused):
    Path("pairs.csv").symlink_to("/dev/zero")
    message = refused("batch", "pairs.csv", "--call", "relative-pose", "--output", "a.jsonl")
    assert "pairs.csv: is no regular file; copy what it gives to a file on disk" in message


def test_a_photo_is_a_regular_file(folder, views, refused):
    write_table("rows.csv", views.rows, "x1 y1 x2 y2")
    os.mkfifo("photo.png")
    message = refused("relative-pose", "rows.csv", *CAMERAS, "--photo1", "photo.png", "--picture", "p.png")
    assert "'--photo1': photo.png: is no regular file" in message
