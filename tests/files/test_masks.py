import numpy as np
import pytest

from nonsac.files.masks import check_mask_suffix, write_mask
from nonsac.io import InputError

PIECES = [np.array([True, False, True]), np.array([], bool), np.array([False])]


@pytest.mark.parametrize(("name", "read"), [("m.npy", np.load), ("m.txt", np.loadtxt), ("m.CSV", np.loadtxt)])
def test_pieces_are_one_mask(tmp_path, name, read):
    write_mask(tmp_path / name, iter(PIECES), 4)
    mask = read(tmp_path / name)
    assert name != "m.npy" or mask.dtype == bool
    np.testing.assert_array_equal(mask, [1, 0, 1, 0])


def test_no_rows(tmp_path):
    write_mask(tmp_path / "m.npy", [], 0)
    assert np.load(tmp_path / "m.npy").shape == (0,)


def test_a_failure_leaves_the_old_file(tmp_path):
    path = tmp_path / "m.npy"
    path.write_text("old")

    def pieces():
        yield PIECES[0]
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match=r"m\.npy: cannot be written \(No space left on device\)"):
        write_mask(path, pieces(), 4)
    assert [file.name for file in tmp_path.iterdir()] == ["m.npy"]
    assert path.read_text() == "old"


def test_other_suffixes_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"m\.png: the inliers are written as \.npy, \.txt or \.csv; end the name in"):
        check_mask_suffix(tmp_path / "m.png")
    with pytest.raises(InputError, match="the inliers are written as"):
        write_mask(tmp_path / "m.parquet", PIECES, 4)
