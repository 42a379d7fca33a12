import numpy as np
import pytest

import nonsac
from nonsac.io import InputError
from nonsac.layouts import MATCHES
from nonsac.sources import ArraySource, ParquetSource
from nonsac.sources.columns import pick_columns

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
    with pytest.raises(InputError, match=r"flat.npz: the array 'a' has not the shape \(n, D\)"):
        nonsac.open_source(tmp_path / "flat.npz", dataset="a")
    with pytest.raises(InputError, match=r"two.npz: holds 5 columns, no column 7"):
        nonsac.open_source(tmp_path / "two.npz", dataset="a", columns=[7])
    np.savez(tmp_path / "odd.npz", x=ROWS, X=ROWS[1:])
    with pytest.raises(InputError, match=r"odd.npz: holds no rows of numbers"):
        nonsac.open_source(tmp_path / "odd.npz")


def test_columns_that_were_asked_for_stay_in_their_order(tmp_path):
    """Also where calls know their names: x2 y2 x1 y1 are the cameras the other way round."""
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    columns = {name: np.arange(6.0) + 10 * place for place, name in enumerate(("x1", "y1", "x2", "y2"))}
    parquet.write_table(pyarrow.table(columns), tmp_path / "rows.parquet")
    turned = ["x2", "y2", "x1", "y1"]
    for chosen, first in ((None, [0, 10, 20, 30]), (turned, [20, 30, 0, 10]), ([2, 3, 0, 1], [20, 30, 0, 10])):
        source = pick_columns(nonsac.open_source(tmp_path / "rows.parquet", columns=chosen), MATCHES)
        np.testing.assert_array_equal(source.take(np.array([0]))[0], first)
