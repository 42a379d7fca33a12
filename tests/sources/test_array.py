import numpy as np
import pytest

from nonsac.sources import ArraySource

LAYOUTS = {
    "C": lambda rows: rows,
    "Fortran": np.asfortranarray,
    "float32": lambda rows: rows.astype(np.float32),
    "float16": lambda rows: rows.astype(np.float16),
    "integers": lambda rows: rows.astype(np.int32),
    "unsigned": lambda rows: rows.astype(np.uint8),
    "reversed": lambda rows: rows[::-1, ::-1],
    "big endian": lambda rows: rows.astype(">f8"),
    "nested lists": lambda rows: rows.tolist(),
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_rows_of_any_dtype_and_order(layout):
    given = layout(np.arange(21.0).reshape(7, 3))
    source, indices = ArraySource(given), np.array([6, 0, 0, 3])
    assert (len(source), source.width) == (7, 3)
    np.testing.assert_array_equal(source.take(indices), np.asarray(given)[indices])
    for rows in (source.take(indices), next(source.chunks(3))):
        assert rows.dtype == np.float64
        assert rows.dtype.isnative
        assert rows.flags.c_contiguous
        assert rows.flags.writeable


def test_rows_of_a_memory_map(tmp_path):
    np.save(tmp_path / "rows.npy", np.arange(12.0).reshape(4, 3))
    source = ArraySource(np.load(tmp_path / "rows.npy", mmap_mode="r"))
    assert isinstance(source.rows, np.memmap)
    np.testing.assert_array_equal(source.take(np.array([3])), [[9.0, 10, 11]])


def test_the_array_is_not_copied():
    rows = np.zeros((5, 2), np.float32, order="F")
    assert ArraySource(rows).rows is rows


@pytest.mark.parametrize("shape", [(3,), (2, 2, 2), ()])
def test_other_shapes_are_refused_by_name(shape):
    with pytest.raises(ValueError, match=r"rows must be a \(n, D\) array"):
        ArraySource(np.zeros(shape))


@pytest.mark.parametrize("wrong", [np.zeros((2, 2), complex), np.zeros((2, 2), bool), [["a", "b"]], [[None, 1]]])
def test_other_dtypes_are_refused_by_name(wrong):
    with pytest.raises(TypeError, match="rows must be an array of real numbers"):
        ArraySource(wrong)
