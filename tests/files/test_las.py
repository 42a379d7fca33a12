import struct
import sys
from functools import partial

import numpy as np
import pytest

from nonsac.io import read_cloud


def las(points, count=None):
    """Build a LAS 1.2 file of point format 0 from the definition of the format."""
    head = b"LASF" + struct.pack("<HHIHH8sBB32s32sHHH", 0, 0, 0, 0, 0, b"", 1, 2, b"hand", b"hand", 1, 2026, 227)
    head += struct.pack("<IIBHI5I", 227, 0, 0, 20, len(points) if count is None else count, len(points), 0, 0, 0, 0)
    head += struct.pack("<3d", 0.01, 0.01, 0.5) + struct.pack("<3d", 1000, 2000, 0)
    head += struct.pack("<6d", 2000, 0, 3000, 0, 100, 0)
    return head + b"".join(struct.pack("<3i", *point) + bytes(8) for point in points)


def test_las(make_file):
    pytest.importorskip("laspy")
    points = read_cloud(make_file("a.las", las([[1, 2, 3], [-100, 50, 4]])))
    assert points.dtype == np.float64
    assert points.flags.c_contiguous
    np.testing.assert_allclose(points, [[1000.01, 2000.02, 1.5], [999, 2000.5, 2]], rtol=1e-15)


def test_laz(tmp_path):
    laspy = pytest.importorskip("laspy")
    pytest.importorskip("lazrs")
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.array([0.5, 0.5, 0.5])
    data = laspy.LasData(header)
    data.x, data.y, data.z = np.array([[1.5, 2.0], [3.0, 4.5], [5.0, 6.0]])
    data.write(tmp_path / "a.laz")
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.laz"), [[1.5, 3, 5], [2, 4.5, 6]])


def test_damaged(make_file, refused):
    pytest.importorskip("laspy")
    whole = las([[1, 2, 3], [4, 5, 6]])
    for size in (4, 100, 226, 227, 247, 266):
        assert "truncated" in refused(read_cloud, make_file("a.las", whole[:size]))
    assert "holds no points" in refused(read_cloud, make_file("a.las", las([])))


def test_laspy_missing(make_file, refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "laspy", None)
    message = refused(read_cloud, make_file("a.las", las([[1, 2, 3]])))
    assert message.endswith('needs laspy; pip install "nonsac[las]"')


def test_laz_library_missing(tmp_path, refused, monkeypatch):
    laspy = pytest.importorskip("laspy")
    test_laz(tmp_path)
    monkeypatch.setattr(laspy.LazBackend, "detect_available", classmethod(lambda _: ()))
    monkeypatch.setattr(laspy, "read", partial(laspy.read, laz_backend=()))
    assert refused(read_cloud, tmp_path / "a.laz").endswith('pip install "nonsac[las]"')
