import pickle
import sys

import numpy as np
import pytest

from nonsac.io import read_cloud
from nonsac.sources import LasSource, las

laspy = pytest.importorskip("laspy")
pytest.importorskip("lazrs")

KINDS = [(".las", 0, "1.2"), (".las", 7, "1.4"), (".laz", 0, "1.2"), (".laz", 7, "1.4")]


@pytest.fixture(params=KINDS, ids=lambda kind: f"{kind[0][1:]} format {kind[1]}")
def written(request, tmp_path, rng):
    """A cloud of 120,000 points on disk, and its points."""
    suffix, point_format, version = request.param
    return write(tmp_path / f"a{suffix}", rng, 120_000, point_format, version)


def write(path, rng, count=120_000, point_format=0, version="1.2"):
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = np.array([0.01, 0.001, 0.5]), np.array([1000.0, -5e6, 3.0])
    header.add_extra_dim(laspy.ExtraBytesParams("more", "f8"))
    data = laspy.LasData(header)
    data.X, data.Y, data.Z = rng.integers(-(10**6), 10**6, (3, count), dtype=np.int32)
    data.write(path)
    return path, np.asarray(laspy.read(path).xyz)


def test_points(written, rng):
    path, points = written
    source, indices = LasSource(path), np.append(rng.integers(0, 120_000, 50), [119_999, 0])
    assert (len(source), source.width, source.about.names) == (120_000, 3, ("x", "y", "z"))
    np.testing.assert_array_equal(source.take(indices), points[indices])
    np.testing.assert_array_equal(np.vstack(list(source.chunks(70_000, 9))), points[9:])
    np.testing.assert_array_equal(read_cloud(path), points)


def test_a_compressed_cloud_comes_in_its_chunks(tmp_path, rng, monkeypatch):
    path, points = write(tmp_path / "a.laz", rng)
    source, opened = LasSource(path), []
    np.testing.assert_array_equal(source.about.blocks, [0, 50_000, 100_000, 120_000])
    open_las = las.open_las
    monkeypatch.setattr(las, "open_las", lambda *given, **named: opened.append(given) or open_las(*given, **named))
    np.testing.assert_array_equal(source.take(np.array([110_000, 3, 4])), points[[110_000, 3, 4]])
    assert len(opened) == 2
    assert source.bytes_to_take(10**4) == path.stat().st_size


def test_any_point_of_another_cloud_is_read_by_itself(tmp_path, rng):
    path, _ = write(tmp_path / "a.las", rng)
    assert LasSource(path).about.blocks is None
    assert LasSource(path).bytes_to_take(10) == 10 * (12 + 4096)


def test_a_large_cloud_is_read_in_pieces(written, monkeypatch):
    path, points = written
    monkeypatch.setattr("nonsac.files.las._POINTS_AT_ONCE", 50_001)
    np.testing.assert_array_equal(read_cloud(path), points)


def test_travels_as_a_short_description(written):
    path, points = written
    source = LasSource(path)
    source.take(np.array([1]))
    told = pickle.dumps(source)
    assert len(told) < 2000
    np.testing.assert_array_equal(pickle.loads(told).take(np.array([9, 0])), points[[9, 0]])
    assert repr(source) == f"LasSource({str(path)!r}: 120000 x 3)"


def test_a_file_that_changes_or_goes_is_noticed(written, refused, change):
    path, _ = written
    source, other = LasSource(path), LasSource(path)
    change(path)
    assert "was changed while it was read" in refused(path, source.take, np.array([1]))
    assert "was changed while it was read" in refused(path, list, source.chunks(50_000))
    path.unlink()
    assert "no such file" in refused(path, other.take, np.array([1]))


def test_truncated_files(written, refused):
    path, _ = written
    content = path.read_bytes()
    for size in (4, 100, 226, 1000, len(content) // 2, len(content) - 40):
        path.write_bytes(content[:size])
        assert "truncated" in refused(path, LasSource, path)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_no_points(tmp_path, rng, suffix):
    path, _ = write(tmp_path / f"a{suffix}", rng, 0)
    source = LasSource(path)
    assert len(source) == 0
    assert list(source.chunks(5)) == []


def test_what_is_no_cloud(tmp_path, refused):
    path = tmp_path / "a.las"
    path.write_bytes(b"1 2 3\n")
    assert "is not a LAS file, it looks like a text table" in refused(path, LasSource, path)
    path.write_bytes(b"")
    assert "the file is empty" in refused(path, LasSource, path)
    assert "is a folder" in refused(tmp_path, LasSource, tmp_path)


def test_laspy_missing(tmp_path, rng, refused, monkeypatch):
    path, _ = write(tmp_path / "a.las", rng, 5)
    monkeypatch.setitem(sys.modules, "laspy", None)
    assert refused(path, LasSource, path).endswith('needs laspy; pip install "nonsac[las]"')
