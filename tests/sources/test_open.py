import os

import numpy as np
import pytest

import nonsac
from nonsac.io import InputError
from nonsac.layouts import MATCHES, PAIRS, POINTS, Layout
from nonsac.sources import ArraySource, ParquetSource
from nonsac.sources.columns import arranged

ROWS = np.arange(60.0).reshape(12, 5)
NAMES = ("u", "v", "X", "Y", "Z")


def npy(path):
    with path.open("wb") as file:
        np.save(file, ROWS)


def npz(path):
    with path.open("wb") as file:
        np.savez(file, rows=ROWS, K=np.arange(9))


def csv(path):
    np.savetxt(path, ROWS, delimiter=",", header=",".join(NAMES), comments="")


def text(path):
    np.savetxt(path, ROWS)


def parquet(path):
    pq = pytest.importorskip("pyarrow.parquet")
    pq.write_table(pytest.importorskip("pyarrow").table(dict(zip(NAMES, ROWS.T, strict=True))), path)


def feather(path):
    write = pytest.importorskip("pyarrow.feather").write_feather
    write(pytest.importorskip("pyarrow").table(dict(zip(NAMES, ROWS.T, strict=True))), str(path))


def folder(path):
    path.mkdir()
    parquet(path / "a.parquet")


def hdf5(path):
    with pytest.importorskip("h5py").File(path, "w") as file:
        file["rows"] = ROWS


def zarr_array(path):
    zarr = pytest.importorskip("zarr")
    zarr.create_array(str(path), data=ROWS)


def zarr_group(path):
    zarr = pytest.importorskip("zarr")
    zarr.open_group(str(path), mode="w").create_array("rows", data=ROWS)


def las(path):
    laspy = pytest.importorskip("laspy")
    cloud = laspy.create()
    cloud.x, cloud.y, cloud.z = ROWS[:, :3].T
    with path.open("wb") as file:
        cloud.write(file)


KINDS = {
    "npy": (npy, "NpySource"),
    "npz": (npz, "ArraySource"),
    "csv": (csv, "ArraySource"),
    "text": (text, "ArraySource"),
    "parquet": (parquet, "ParquetSource"),
    "feather": (feather, "ParquetSource"),
    "folder": (folder, "ParquetSource"),
    "hdf5": (hdf5, "Hdf5Source"),
    "zarr array": (zarr_array, "ZarrSource"),
    "zarr group": (zarr_group, "ZarrSource"),
    "las": (las, "LasSource"),
}


@pytest.mark.parametrize("name", ["rows", "rows.bin"])
@pytest.mark.parametrize(("write", "kind"), KINDS.values(), ids=KINDS)
def test_the_content_tells_the_kind(tmp_path, write, kind, name):
    write(tmp_path / name)
    source = nonsac.open_source(tmp_path / name)
    assert type(source).__name__ == kind
    rows = ROWS[:, :3] if kind == "LasSource" else ROWS
    np.testing.assert_allclose(source.take(np.array([11, 0])), rows[[11, 0]], atol=0.01 if kind == "LasSource" else 0)


@pytest.mark.parametrize(("write", "kind"), [pair for pair in KINDS.values() if pair[0] is not las])
def test_columns_by_position(tmp_path, write, kind):
    write(tmp_path / "rows")
    source = nonsac.open_source(tmp_path / "rows", columns=[3, 0])
    np.testing.assert_array_equal(source.take(np.arange(12)), ROWS[:, [3, 0]])


@pytest.mark.parametrize("write", [csv, parquet, feather, folder])
def test_columns_by_name(tmp_path, write):
    write(tmp_path / "rows")
    source = nonsac.open_source(tmp_path / "rows", columns=["Y", "u"])
    np.testing.assert_array_equal(source.take(np.arange(12)), ROWS[:, [3, 0]])
    with pytest.raises(InputError, match=r"rows\S*: .*(no column 'w'|names no w).*[zZ]"):
        nonsac.open_source(tmp_path / "rows", columns=["w", "u"])


@pytest.mark.parametrize("write", [npz, hdf5, zarr_group])
def test_datasets(tmp_path, write):
    write(tmp_path / "rows")
    np.testing.assert_array_equal(nonsac.open_source(tmp_path / "rows", dataset="rows").take(np.arange(12)), ROWS)
    with pytest.raises(InputError, match="rows: "):
        nonsac.open_source(tmp_path / "rows", dataset="other")


def test_an_array_has_no_names(tmp_path):
    zarr_array(tmp_path / "rows")
    with pytest.raises(InputError, match=r"rows: holds no column 'Y'"):
        nonsac.open_source(tmp_path / "rows", columns=["Y"])


@pytest.mark.parametrize("kind", ["hdf5", "zarr"])
def test_columns_that_are_arrays_of_their_own(tmp_path, kind):
    library = pytest.importorskip("h5py" if kind == "hdf5" else "zarr")
    if kind == "hdf5":
        with library.File(tmp_path / "rows", "w") as file:
            for name, column in zip(NAMES, ROWS.T, strict=True):
                file[name] = column
    else:
        group = library.open_group(str(tmp_path / "rows"), mode="w")
        for name, column in zip(NAMES, ROWS.T, strict=True):
            group.create_array(name, data=np.ascontiguousarray(column))
    source = nonsac.open_source(tmp_path / "rows", columns=["Y", "u"])
    np.testing.assert_array_equal(source.take(np.arange(12)), ROWS[:, [3, 0]])
    with pytest.raises(InputError, match=r"rows: cannot tell which array holds the rows \(n, D\): there is none"):
        nonsac.open_source(tmp_path / "rows")


def test_lists_and_patterns_and_urls(tmp_path):
    parquet(tmp_path / "a.parquet")
    feather(tmp_path / "b.arrow")
    for paths in ([tmp_path / "a.parquet", tmp_path / "b.arrow"], f"{tmp_path}/[ab].*", f"file://{tmp_path}/*"):
        source = nonsac.open_source(paths)
        assert isinstance(source, ParquetSource)
        np.testing.assert_array_equal(source.take(np.arange(24)), np.vstack([ROWS, ROWS]))


@pytest.mark.parametrize("keys", [("points2d", "points3d"), ("x", "X")])
def test_the_parts_of_an_archive_stand_side_by_side(tmp_path, keys):
    np.savez(tmp_path / "rows.npz", **dict(zip(keys, (ROWS[:, :2], ROWS[:, 2:]), strict=True)))
    source = nonsac.open_source(tmp_path / "rows.npz")
    assert isinstance(source, ArraySource)
    np.testing.assert_array_equal(source.take(np.arange(12)), ROWS)


def test_what_is_no_table_is_refused(tmp_path):
    path = tmp_path / "rows"
    for content, message in (
        (b"", "the file is empty"),
        (b"\x89PNG\r\n", "is no table of rows, it looks like a PNG image"),
        (b"\x00\x01\x02", "is no table of rows, it looks like an unknown binary file"),
        (b"1 2\n3 x\n", "line 2: 'x' is not a number"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=f"rows: {message}"):
            nonsac.open_source(path)
    text(path)
    with pytest.raises(InputError, match="rows: holds no datasets, it is a text table"):
        nonsac.open_source(path, dataset="a")
    for columns in ([-1], [0, 5]):
        with pytest.raises(InputError, match=f"rows: holds 5 columns, no column {columns[-1]}; count them from 0"):
            nonsac.open_source(path, columns=columns)
    with pytest.raises(InputError, match="rows: has no header line"):
        nonsac.open_source(path, columns=["u"])
    with pytest.raises(InputError, match="a text table cannot be read from a URL; download it"):
        nonsac.open_source(f"file://{path}")
    with pytest.raises(InputError, match="none: no such file"):
        nonsac.open_source(tmp_path / "none")
    np.savez(tmp_path / "two.npz", a=ROWS, b=ROWS)
    with pytest.raises(InputError, match=r"two.npz: cannot tell which array .* a, b; name one"):
        nonsac.open_source(tmp_path / "two.npz")
    np.savez(tmp_path / "flat.npz", a=ROWS[0])
    with pytest.raises(InputError, match=r"flat.npz: the array 'a' has the shape \(5,\), not \(n, D\)"):
        nonsac.open_source(tmp_path / "flat.npz", dataset="a")
    with pytest.raises(InputError, match=r"two.npz: holds 5 columns, no column 7"):
        nonsac.open_source(tmp_path / "two.npz", dataset="a", columns=[7])
    np.savez(tmp_path / "odd.npz", x=ROWS, X=ROWS[1:])
    with pytest.raises(
        InputError, match=r"odd.npz: its arrays have 12 and 11 rows, which should match one by one; sav"
    ):
        nonsac.open_source(tmp_path / "odd.npz")
    np.savez(tmp_path / "flat.npz", x=ROWS, X=ROWS[:, 0])
    with pytest.raises(InputError, match=r"flat.npz: holds no rows of numbers"):
        nonsac.open_source(tmp_path / "flat.npz")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# nothing\n", "the file holds no rows; export it again with its rows"),
        ("a b c\n1 2\n", "its header names 3 columns, its rows have 2; name every column, or remove the header line"),
        ("a b\n1 2\n3\n", "line 3 has 1 columns where 2 are needed"),
    ],
)
def test_text_without_whole_rows_is_refused(make_file, refused, text, message):
    path = make_file("rows.txt", text)
    assert message in refused(path, nonsac.open_source, path)


# --- the columns that a call needs ------------------------------------------------------------------------------------


def named(path, kind, columns):
    """A file of these columns, in this order, of a kind that has names."""
    if kind == "csv":
        np.savetxt(path, np.column_stack(list(columns.values())), "%.17g", ",", header=",".join(columns), comments="")
    elif kind in ("parquet", "feather"):
        library = pytest.importorskip(f"pyarrow.{kind}")
        write = library.write_table if kind == "parquet" else library.write_feather
        write(pytest.importorskip("pyarrow").table(columns), str(path))
    elif kind == "npy":
        rows = np.zeros(12, [(name, "f8") for name in columns])
        for name, column in columns.items():
            rows[name] = column
        with path.open("wb") as file:
            np.save(file, rows)


NAMED = ["csv", "parquet", "feather", "npy"]


@pytest.mark.parametrize("layout", [POINTS, "u v | X Y Z", Layout("U V x y z")])
@pytest.mark.parametrize("kind", NAMED)
def test_columns_are_found_by_name_in_whatever_case_and_order(tmp_path, kind, layout):
    """Beside others; and the weight comes last."""
    order = [("z", 4), ("WEIGHT", None), ("id", 0), ("v", 1), ("U", 0), ("X", 2), ("y", 3)]
    columns = {name: np.linspace(0.1, 1, 12) if place is None else ROWS[:, place] for name, place in order}
    columns["id"] = np.full(12, np.nan)
    named(tmp_path / "rows", kind, columns)
    source = nonsac.open_source(tmp_path / "rows", layout=layout)
    expected = np.column_stack([ROWS, columns["WEIGHT"]])
    np.testing.assert_array_equal(source.take(np.array([11, 0])), expected[[11, 0]])
    del columns["WEIGHT"]
    named(tmp_path / "plain", kind, columns)
    np.testing.assert_array_equal(nonsac.open_source(tmp_path / "plain", layout=layout).take(np.arange(12)), ROWS)


@pytest.mark.parametrize("kind", NAMED)
def test_a_file_that_names_its_columns_must_have_them_all(tmp_path, refused, kind):
    path = tmp_path / "rows"
    named(path, kind, dict(zip(("a", "b", "u", "v", "z"), ROWS.T, strict=True)))
    message = refused(path, lambda: nonsac.open_source(path, layout=POINTS))
    assert (
        "rows of 5 columns (a b u v z), of which none is called X Y; rename the columns, or choose them, by" in message
    )
    assert message.endswith("in the order of u v X Y Z")
    source = nonsac.open_source(path, layout=POINTS, columns=[2, 3, 0, 1, 4])
    np.testing.assert_array_equal(source.take(np.arange(12)), ROWS[:, [2, 3, 0, 1, 4]])


@pytest.mark.parametrize("kind", NAMED)
@pytest.mark.parametrize(
    ("layout", "names"),
    [
        (MATCHES, ("x0", "y0", "x1", "y1")),
        (MATCHES, ("x1 [px]", "y1 [px]", "x2 [px]", "y2 [px]")),
        (MATCHES, ("x_1", "y_1", "x_2", "y_2")),
        (POINTS, ("x", "y", "X", "Y", "Z")),
        (POINTS, ("U", "V", "Easting [m]", "Northing [m]", "Height [m]")),
    ],
)
def test_columns_are_found_by_usual_names(tmp_path, kind, layout, names):
    """Beside an id that comes first; opened with a layout or by a call."""
    held = dict(zip(names[::-1], ROWS[:, : len(names)].T[::-1], strict=True))
    named(tmp_path / "rows", kind, {"id": np.arange(12.0)} | held)
    for source in (nonsac.open_source(tmp_path / "rows", layout=layout), nonsac.open_source(tmp_path / "rows")):
        np.testing.assert_array_equal(arranged(source, layout).take(np.arange(12)), ROWS[:, : len(names)])


@pytest.mark.parametrize("kind", NAMED)
@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("id", "x [m]", "y [m]", "z [m]"), r"\(id x \[m\] y \[m\] z \[m\]\), of which none is called x1 y1 x2 y2"),
        (
            ("id", "u1", "v1", "u2", "v2"),
            r"\(id u1 v1 u2 v2\), of which none is called x1 y1 x2 y2; rename the columns, or ch",
        ),
        (
            ("GPSTime", "Easting", "Northing", "Height"),
            "of which none is called x1 y1 x2 y2; rename the columns, or ch",
        ),
        (("x1 [px]", "y1 [mm]", "x2", "y2"), r"where the units of the coordinates differ \(mm, px\); rename the"),
        (("x1 [px]", "x_1", "y1", "x2", "y2"), r"where several columns could be x1 \(x1 \[px\], x_1\); rename"),
    ],
)
def test_names_that_leave_a_doubt_are_refused(tmp_path, refused, kind, names, message):
    path = tmp_path / "rows"
    named(path, kind, dict.fromkeys(names, np.ones(12)))
    with pytest.raises(InputError, match=message):
        nonsac.open_source(path, layout=MATCHES)
    with pytest.raises(ValueError, match=message):
        nonsac.relative_pose(nonsac.open_source(path))
    assert "(columns=, --columns), in the order of" in refused(path, lambda: nonsac.open_source(path, layout=MATCHES))


@pytest.mark.parametrize("kind", ["hdf5", "zarr", "npz"])
def test_arrays_that_are_named_as_the_columns(tmp_path, refused, kind):
    path, held = tmp_path / "rows", {name: np.ascontiguousarray(c) for name, c in zip(NAMES, ROWS.T, strict=True)}

    def write(path, arrays):
        if kind == "npz":
            with path.open("wb") as file:
                np.savez(file, **arrays)
        elif kind == "hdf5":
            with pytest.importorskip("h5py").File(path, "w") as file:
                for name, array in arrays.items():
                    file[name] = array
        else:
            group = pytest.importorskip("zarr").open_group(str(path), mode="w")
            for name, array in arrays.items():
                group.create_array(name, data=array)

    write(path, {"id": np.arange(12.0), "weight": np.full(12, 2.0)} | held)
    expected = np.column_stack([ROWS, np.full(12, 2.0)])
    np.testing.assert_array_equal(nonsac.open_source(path, layout=POINTS).take(np.arange(12)), expected)
    if kind != "npz":
        message = refused(path, lambda: nonsac.open_source(path, layout=MATCHES))
        assert "of which none is called x1 y1 x2 y2" in message
        write(tmp_path / "both", {"table": ROWS} | {name: held[name] for name in "uv"})
        source = nonsac.open_source(tmp_path / "both", layout=POINTS)
        np.testing.assert_array_equal(source.take(np.arange(12)), ROWS)


@pytest.mark.parametrize("chunks", [None, (5, 5)])
@pytest.mark.parametrize("block", [512, 2048])
def test_hdf5_behind_a_user_block(tmp_path, chunks, block):
    """As MATLAB writes it."""
    path = tmp_path / "rows.mat"
    with pytest.importorskip("h5py").File(path, "w", userblock_size=block) as file:
        file.create_dataset("rows", data=ROWS, chunks=chunks)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    np.testing.assert_array_equal(nonsac.open_source(path, layout=POINTS).take(np.arange(12)), ROWS)


@pytest.mark.parametrize("kind", ["parquet", "feather"])
def test_what_is_missing_in_nullable_columns_is_nan(tmp_path, kind):
    pa = pytest.importorskip("pyarrow")
    columns = {"x1": pa.array([1.0, None]), "y1": pa.array([None, 2], pa.int32()), "x2": pa.array([3, 4], pa.uint8())}
    named(tmp_path / "rows", kind, columns | {"y2": pa.array([None, None], pa.float32())})
    rows = nonsac.open_source(tmp_path / "rows", layout=MATCHES).take(np.arange(2))
    np.testing.assert_array_equal(rows, [[1, np.nan, 3, np.nan], [np.nan, 2, 4, np.nan]])


@pytest.mark.parametrize(("name", "held"), [("y2", "null"), ("weight", "string")])
def test_columns_of_no_numbers_are_refused_with_the_way_out(tmp_path, refused, name, held):
    pa = pytest.importorskip("pyarrow")
    columns = {column: pa.array([1.0]) for column in MATCHES.names} | {"weight": pa.array([1.0])}
    path = tmp_path / "rows"
    named(path, "parquet", columns | {name: pa.nulls(1) if held == "null" else pa.array(["high"])})
    message = refused(path, lambda: nonsac.open_source(path, layout=MATCHES))
    assert f"column '{name}' holds {held}, not numbers; save one column of numbers" in message


@pytest.mark.parametrize("kind", NAMED)
def test_columns_that_were_asked_for_stay_in_their_order(tmp_path, kind):
    """Also if calls know their names: x2 y2 x1 y1 are the cameras the other way round."""
    columns = {name: np.arange(12.0) + 20 * place for place, name in enumerate(("x1", "y1", "x2", "y2"))}
    named(tmp_path / "rows", kind, columns)
    turned = ["x2", "y2", "x1", "y1"]
    for chosen, first in ((None, [0, 20, 40, 60]), (turned, [40, 60, 0, 20]), ([2, 3, 0, 1], [40, 60, 0, 20])):
        source = nonsac.open_source(tmp_path / "rows", columns=chosen)
        assert source.about.names == (None if chosen else ("x1", "y1", "x2", "y2"))
        for same in (arranged(source, MATCHES), nonsac.open_source(tmp_path / "rows", layout=MATCHES, columns=chosen)):
            np.testing.assert_array_equal(same.take(np.array([0]))[0], first)


def test_the_header_of_a_text_names_its_columns_of_numbers(make_file):
    path = make_file("rows.txt", "x;word;Y\n1;a;2\n3;b;4\n")
    source = nonsac.open_source(path)
    assert source.about.names == ("x", "y")
    np.testing.assert_array_equal(source.take(np.arange(2)), [[1, 2], [3, 4]])
    assert nonsac.open_source(path, columns=["Y", 0]).about.names is None


def test_columns_of_both_parts_of_an_npz_count_on(tmp_path):
    np.savez(tmp_path / "rows.npz", points1=ROWS[:, :2], points2=ROWS[:, 2:4], weights=ROWS[:, 4])
    source = nonsac.open_source(tmp_path / "rows.npz", layout=MATCHES, columns=[2, 3, 1, 0])
    np.testing.assert_array_equal(source.take(np.arange(12)), ROWS[:, [2, 3, 1, 0]])


def test_as_many_columns_are_chosen_as_the_layout_has(tmp_path):
    np.save(tmp_path / "rows.npy", ROWS)
    with pytest.raises(ValueError, match=r"columns must choose 4 \(x1 y1 x2 y2\), or 5 with a weight; got 3"):
        nonsac.open_source(tmp_path / "rows.npy", layout=MATCHES, columns=[0, 1, 2])


def test_what_is_no_table_of_rows_says_what_to_do(tmp_path, make_file):
    with pytest.raises(InputError, match=r"it looks like a UTF-16 text; save it as UTF-8 text"):
        nonsac.open_source(make_file("a.csv", "1 2 3\n".encode("utf-16")))
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=r"no file matches this pattern; check the path \(files in folders match"):
        nonsac.open_source(tmp_path / "fol*")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")
def test_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match=r"pipe: is no regular file; copy what it gives"):
        nonsac.open_source(tmp_path / "pipe")


@pytest.mark.parametrize("write", [npy, parquet, hdf5, zarr_array, text, npz])
def test_messages_name_the_file_as_the_user_did(tmp_path, monkeypatch, write):
    write(tmp_path / "rows")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"^rows: "):
        nonsac.open_source("rows", columns=[99])


@pytest.mark.parametrize("write", [npy, text, hdf5, zarr_array, zarr_group, npz])
def test_columns_without_names_are_taken_by_position_and_number(tmp_path, refused, write):
    path = tmp_path / "rows"
    write(path)
    for layout in (POINTS, "a b | c d"):  # four, and a weight
        np.testing.assert_array_equal(nonsac.open_source(path, layout=layout).take(np.arange(12)), ROWS)
    for layout, wanted in ((PAIRS, "6 (x1 y1 z1 x2 y2 z2), or 7 with"), ("a | b c", "3 (a b c), or 4 with")):
        message = refused(path, lambda layout=layout: nonsac.open_source(path, layout=layout))
        if write is npz:
            assert "cannot tell which array to use (its keys are: rows, K); save" in message
        else:
            assert f"rows of 5 columns, not of {wanted} a weight; choose columns" in message
        if write is text and layout is not PAIRS:
            assert message.endswith("choose columns, or name them in a header line: a b c")
    for layout in (PAIRS, MATCHES):
        chosen = [0] * len(layout.names)
        assert nonsac.open_source(path, layout=layout, columns=chosen).width == len(chosen)
        with pytest.raises(ValueError, match=r"^columns must choose .* with a weight; got 1"):
            nonsac.open_source(path, layout=layout, columns=[0])


def test_rows_that_stand_as_columns_are_noticed(tmp_path, refused):
    np.save(tmp_path / "rows.npy", np.zeros((4, 700)))
    path = tmp_path / "rows.npy"
    message = refused(path, lambda: nonsac.open_source(path, layout=MATCHES))
    assert message.endswith(
        "rows of 700 columns, not of 4 (x1 y1 x2 y2), or 5 with a weight; transpose it, one row per match"
    )


@pytest.mark.parametrize("layout", [MATCHES, POINTS, PAIRS], ids=lambda layout: layout.columns)
def test_the_keys_of_an_archive_are_those_of_the_layout(tmp_path, rng, layout):
    rows = rng.normal(size=(7, len(layout.names)))
    for keys in layout.keys:
        parts = dict(zip(keys, layout.parts(rows), strict=True))
        np.savez(tmp_path / "rows.npz", **parts, other=np.zeros((3, len(layout.names))))
        np.testing.assert_array_equal(nonsac.open_source(tmp_path / "rows.npz", layout=layout).take(np.arange(7)), rows)
        np.savez(tmp_path / "rows.npz", **parts, weights=np.arange(7))
        for same in (layout, f" {layout.columns.replace('|', ' | ')}"):
            source = nonsac.open_source(tmp_path / "rows.npz", layout=same)
            np.testing.assert_array_equal(source.take(np.arange(7)), np.column_stack([rows, np.arange(7)]))


def test_a_layout_of_ones_own_finds_its_only_array_in_an_archive(tmp_path):
    np.savez(tmp_path / "rows.npz", K=np.eye(3), rows=ROWS)
    for layout in ("a b c d e", "a | b c d"):
        np.testing.assert_array_equal(
            nonsac.open_source(tmp_path / "rows.npz", layout=layout).take(np.arange(12)), ROWS
        )


def test_names_of_datasets_that_are_no_text_are_shown(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in (b"rows\xff", b"others"):
            file.create_dataset(name, data=np.ones((5, 4)))
    for wanted in (None, "x"):
        with pytest.raises(nonsac.InputError, match="rows\ufffd"):
            nonsac.open_source(tmp_path / "a.h5", dataset=wanted)
