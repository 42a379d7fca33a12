import struct
import sys
from functools import partial

import numpy as np
import pytest

from limits import little_memory
from nonsac.io import read_cloud
from nonsac.sources import LasSource

__all__ = ["little_memory"]


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


POINTS = np.arange(900.0).reshape(300, 3)


def laz(path, point_format=0, version="1.2"):
    laspy = pytest.importorskip("laspy")
    pytest.importorskip("lazrs")
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.add_extra_dim(laspy.ExtraBytesParams("more", "f8"))
    data = laspy.LasData(header)
    data.x, data.y, data.z = POINTS.T
    data.write(path)
    return bytearray(path.read_bytes())


FORMATS = {"points": (0, "1.2"), "layers": (6, "1.4"), "colours": (8, "1.4")}


@pytest.fixture(params=FORMATS.values(), ids=FORMATS)
def squeezed(request, tmp_path):
    """A LAZ file, and a function that damages it: where, from where, in which form, and to what."""
    path = tmp_path / "a.laz"
    content = laz(path, *request.param)
    first = struct.unpack_from("<I", content, 96)[0]
    table = struct.unpack_from("<q", content, first)[0]
    record = content.index(struct.pack("<HHBB", 3 if request.param[0] else 2, 0, 2, 2))
    starts = {"header": 0, "points": first, "table": table, "record": record}

    def damage(place, offset, form, value):
        damaged = bytearray(content)
        struct.pack_into(form, damaged, starts[place] + offset, value)
        path.write_bytes(damaged)
        return path

    np.testing.assert_allclose(read_cloud(path), POINTS)
    return damage


@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize(
    ("place", "problem"),
    [
        (("header", 100, "<I", 2**32 - 1), "4294967295 records do not fit into"),
        (("header", 96, "<I", 2**32 - 1), "its points start at byte 4294967295 of"),
        (("table", 4, "<I", 2**32 - 1), "300 points do not make 4294967295 chunks"),
        (("table", 4, "<I", 301), "300 points do not make 301 chunks"),
        (("points", 0, "<q", 2**40), "it has no table of chunks"),
        (("points", 0, "<q", -1), "it has no table of chunks"),
        (("table", 8, "<I", 2**32 - 1), ""),
        (("record", 12, "<I", 2**32 - 2), "the record of the compression does not fit its 300 points"),
        (("record", 32, "<H", 0), "the record of the compression does not fit its 300 points"),
        (("record", 36, "<H", 65535), "the record of the compression does not fit its 300 points"),
    ],
)
def test_numbers_in_compressed_files(squeezed, refused, place, problem):
    path = squeezed(*place)
    for read in (read_cloud, LasSource):
        assert problem in refused(read, path)


@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize("layer", range(17))
@pytest.mark.parametrize("kind", ["layers", "colours"])
def test_layers_that_do_not_fit_into_their_chunk(tmp_path, refused, kind, layer):
    path = tmp_path / "a.laz"
    content = laz(path, *FORMATS[kind])
    (first,) = struct.unpack_from("<I", content, 96)
    (size,) = struct.unpack_from("<H", content, 105)
    struct.pack_into("<I", content, first + 8 + size + 4 + 4 * layer, 2**32 - 1)
    path.write_bytes(content)
    assert "the layers of a chunk do not fit into it" in refused(read_cloud, path)


@pytest.mark.usefixtures("little_memory")
def test_counts_are_compared_with_the_bytes_that_are_there(make_file, squeezed, refused):
    pytest.importorskip("laspy")
    for count in (3, 200_000_000, 2**32 - 1):
        path = make_file("a.las", las([[1, 2, 3], [4, 5, 6]], count))
        for read in (read_cloud, LasSource):
            assert f"its header promises {count} point rows, it holds 2" in refused(read, path)
    path = squeezed("header", 107, "<I", 2**32 - 1)
    if path.read_bytes()[25] == 4:
        path = squeezed("header", 247, "<Q", 2**62)
    for read in (read_cloud, LasSource):
        assert "points would take up" in refused(read, path)


def test_a_panic_of_the_library_is_an_error_of_the_file(make_file, refused, monkeypatch):
    """It is no Exception, so that nothing else would catch it."""
    laspy = pytest.importorskip("laspy")
    path = make_file("a.las", las([[1, 2, 3]]))
    for kind in (type("PanicException", (BaseException,), {}), KeyboardInterrupt):

        def panic(*_, kind=kind):
            raise kind("attempt to divide by zero")

        monkeypatch.setattr(laspy.LasReader, "read_points", panic)
        if kind is KeyboardInterrupt:
            with pytest.raises(KeyboardInterrupt):
                read_cloud(path)
        else:
            assert "is truncated or damaged (attempt to divide by zero)" in refused(read_cloud, path)
