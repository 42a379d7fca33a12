import pickle

import numpy as np
import pytest

from nonsac.sources import NpySource

RECORDS = np.array(
    [(i, 2.5 * i, -i, "ab", i % 200) for i in range(300)],
    [("x", "f8"), ("y", ">f4"), ("größe", "i2"), ("label", "U2"), ("n", "u1")],
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "rows.npy"


@pytest.mark.parametrize("order", "CF")
@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", "f2", "i1", "u1", ">i2", "u4", "i8", "g"])
def test_rows_of_any_dtype_and_order(path, rng, dtype, order):
    rows = np.asarray(rng.integers(0, 100, (700, 3)).astype(dtype), order=order)
    np.save(path, rows)
    indices = rng.integers(0, 700, 100)
    for columns in (None, [2, 0], [1], [np.int64(1), 1]):
        source, chosen = NpySource(path, columns), rows[:, slice(None) if columns is None else columns]
        assert (len(source), source.width) == chosen.shape
        np.testing.assert_array_equal(source.take(indices), chosen[indices])
        np.testing.assert_array_equal(np.vstack(list(source.chunks(300))), chosen)
        assert source.about.names is None


def test_fields(path, rng):
    save_with_any_names(path)
    source, indices = NpySource(path, ["größe", "y", 0]), rng.integers(0, 300, 100)
    assert (source.names, source.about.names) == (("größe", "y", "x"), None)
    expected = np.column_stack([RECORDS[name].astype(float) for name in source.names])
    np.testing.assert_array_equal(source.take(indices), expected[indices])
    np.testing.assert_array_equal(np.vstack(list(source.chunks(70))), expected)


def test_fields_that_nobody_chose_are_found_by_name(path):
    np.save(path, np.zeros(5, [("y", "f4"), ("x", "i2")]))
    assert NpySource(path).about.names == ("y", "x")


def save_with_any_names(path):
    with path.open("wb") as file:
        np.lib.format.write_array(file, RECORDS, version=(3, 0))


def test_all_fields_must_be_numbers(path, refused):
    save_with_any_names(path)
    assert "holds a field 'label' of type <U2" in refused(path, NpySource, path)
    assert "holds no column 'z' (it holds x, y, größe, label and 1 more)" in refused(path, NpySource, path, ["z"])


def test_version_2(path):
    with path.open("wb") as file:
        np.lib.format.write_array(file, np.arange(6.0).reshape(3, 2), version=(2, 0))
    np.testing.assert_array_equal(NpySource(path).take(np.array([2])), [[4, 5]])


def test_only_the_columns_asked_for_are_read(path):
    np.save(path, np.zeros((1000, 100)))
    assert NpySource(path, [3, 4]).bytes_to_take(10) == 10 * (16 + 4096)
    np.save(path, np.zeros((1000, 100), order="F"))
    assert NpySource(path, [3, 90]).bytes_to_take(10**6) == 2 * 8000


def test_no_rows(path):
    np.save(path, np.zeros((0, 3)))
    source = NpySource(path)
    assert (len(source), source.width) == (0, 3)
    assert list(source.chunks(5)) == []


def test_travels_as_a_short_description(path):
    np.save(path, np.asfortranarray(np.arange(60.0).reshape(10, 6)))
    told = pickle.dumps(NpySource(path))
    assert len(told) < 2000
    np.testing.assert_array_equal(pickle.loads(told).take(np.array([3])), [np.arange(18.0, 24)])
    assert repr(NpySource(path)) == f"NpySource({str(path)!r}: 10 x 6)"


@pytest.mark.parametrize("order", "CF")
def test_a_file_that_changes_is_noticed(path, refused, change, order):
    np.save(path, np.zeros((10, 3), order=order))
    source = NpySource(path)
    change(path)
    assert "was changed while it was read" in refused(path, source.take, np.array([1]))
    assert "was changed while it was read" in refused(path, list, source.chunks(5))


def test_a_file_that_is_gone(path, refused):
    np.save(path, np.zeros((10, 3)))
    source = NpySource(path)
    path.unlink()
    assert "no such file" in refused(path, source.take, np.array([1]))


@pytest.mark.parametrize(
    ("array", "problem"),
    [
        (np.zeros(3), "holds an array of shape (3,) instead of (n, D)"),
        (np.zeros((3, 2, 2)), "holds an array of shape (3, 2, 2) instead of (n, D)"),
        (np.zeros((3, 0)), "holds an array of shape (3, 0) instead of (n, D)"),
        (np.zeros((3, 2), complex), "holds an array of type complex128"),
        (np.zeros((3, 2), bool), "holds an array of type bool"),
        (np.array([["a", "b"]]), "holds an array of type <U1"),
        (np.array([[None, 1]]), "holds pickled objects, which are never loaded"),
        (np.zeros(3, [("x", "O")]), "holds pickled objects, which are never loaded"),
        (np.zeros(3, [("x", "f8", (3,))]), "holds a field 'x' of type ('<f8', (3,))"),
    ],
)
def test_other_arrays_are_refused(path, refused, array, problem):
    np.save(path, array)
    assert problem in refused(path, NpySource, path)


@pytest.mark.parametrize("columns", [[3], [-1], ["x"], []])
def test_columns_it_does_not_hold(path, refused, columns):
    np.save(path, np.zeros((4, 3)))
    message = refused(path, NpySource, path, columns)
    assert "holds no column" in message if columns else "none of its columns" in message
    assert "(it holds 0, 1, 2)" in message or not columns


@pytest.mark.parametrize("columns", ["xyz", [True], [1.0], [None]])
def test_columns_of_another_type(path, columns):
    np.save(path, np.zeros((4, 3)))
    with pytest.raises(TypeError, match="columns must"):
        NpySource(path, columns)


def test_damaged_files(tmp_path, path, refused):
    np.save(path, np.zeros((10, 3)))
    content = path.read_bytes()
    for size in (len(content) - 1, 128 + 24):
        path.write_bytes(content[:size])
        message = refused(path, NpySource, path)
        assert f"truncated: its header promises 10 array rows, it holds {(size - 128) // 24}" in message
    for size in (7, 9, 50):
        path.write_bytes(content[:size])
        assert "is truncated or damaged" in refused(path, NpySource, path)
    path.write_bytes(b"1 2 3\n")
    assert "is not a NumPy array, it looks like a text table" in refused(path, NpySource, path)
    path.write_bytes(b"")
    assert "the file is empty" in refused(path, NpySource, path)
    assert "is a folder" in refused(tmp_path, NpySource, tmp_path)
