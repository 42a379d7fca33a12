"""What a header promises is compared with the bytes that are there before anything is made of it."""

import contextlib
import io
import re
import struct
import zipfile

import numpy as np
import pytest

import nonsac
from io_samples import FACES, XYZ, compressed, npy, npz, pcd_header, ply_header
from limits import little_memory
from nonsac.files import claims
from nonsac.files.arrays import open_npz
from nonsac.io import InputError, read_cloud, read_matches

pytestmark = pytest.mark.usefixtures("little_memory")
__all__ = ["little_memory"]

ROWS = bytes(60 * 4 * 8)
NO_SHAPE = "which no array has"


@pytest.mark.parametrize(
    ("shape", "problem"),
    [
        ("(-5, 4)", NO_SHAPE),
        ("(60, -4)", NO_SHAPE),
        ("(True, 4)", NO_SHAPE),
        (f"({10**22}, 4)", "more than any file holds"),
        (f"(0, {10**22})", "more than any file holds"),
        ("(4, 1000000000)", "is truncated"),
        ("(60, 100000000)", "is truncated"),
        ("(1000000000, 4)", "is truncated"),
        ("(0, 1000000000)", ""),
    ],
)
def test_shapes_of_arrays(make_file, shape, problem):
    content = npy((60, 4), ROWS)
    header = content[10 : -len(ROWS)].decode().replace("(60, 4)", shape).rstrip() + "\n"
    content = content[:8] + len(header).to_bytes(2, "little") + header.encode() + ROWS
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("points.npy", content)
    for read in (nonsac.open_source, read_cloud, read_matches):
        with pytest.raises(InputError, match=r"a.npy: ") as caught:
            read(make_file("a.npy", content))
        assert problem in str(caught.value) or "columns, more than 100000" in str(caught.value)
    for read in (read_cloud, read_matches):
        with pytest.raises(InputError, match=r"a.npz: "):
            read(make_file("a.npz", archive.getvalue()))


def test_a_sparse_file_holds_what_it_promises(tmp_path):
    path = tmp_path / "sparse.npy"
    path.write_bytes(npy((2**30, 4), b""))
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size + 2**35)
    np.testing.assert_array_equal(nonsac.open_source(path).take(np.array([2**30 - 1])), np.zeros((1, 4)))


def deflated(**members):
    archive = io.BytesIO()
    np.savez_compressed(archive, **members)
    return archive.getvalue()


@pytest.mark.parametrize("array", [np.zeros((3_000_000, 3)), np.zeros((3_000_000, 3), "i1")], ids=["f8", "i1"])
def test_archives_do_not_explode(make_file, array):
    path = make_file("a.npz", deflated(points=array))
    for read in (nonsac.open_source, read_cloud):
        with pytest.raises(InputError, match=r"the array points would take up 72 MB .* save it uncompressed"):
            read(path)


def test_archives_that_are_large_may_expand_much(make_file, rng):
    content = deflated(points1=rng.normal(size=(60_000, 2)), points2=np.zeros((60_000, 2)), weights=np.zeros(9_000_000))
    with open_npz(make_file("a.npz", content)) as archive:
        assert archive.load("weights").shape == (9_000_000,)


def test_only_the_members_needed_are_read(make_file, monkeypatch):
    path = make_file("a.npz", npz(points=np.ones((5, 3)), other=np.zeros(7000), more=np.zeros((2, 2, 2))))
    damaged = bytearray(path.read_bytes())
    damaged[damaged.index(bytes(7000 * 8))] = 1  # its checksum is wrong
    path.write_bytes(damaged)
    np.testing.assert_array_equal(read_cloud(path), np.ones((5, 3)))
    np.testing.assert_array_equal(nonsac.open_source(path).take(np.arange(5)), np.ones((5, 3)))
    with open_npz(path) as archive, pytest.raises(InputError, match="damaged"):
        archive.load("other")


def test_archives_of_other_programs(make_file):
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_BZIP2) as file:
        file.writestr("points.npy", npy((60, 4), ROWS))
    with pytest.raises(InputError, match="compressed in a way that NumPy does not write"):
        read_cloud(make_file("a.npz", archive.getvalue()))


def test_what_is_in_proportion_passes():
    claims.check_expansion("a", "it", 4 << 20, 1, "")
    claims.check_expansion("a", "it", 100 << 20, 8 << 20, "")
    for numbers, stored in [((4 << 20) + 1, 1), ((100 << 20) + 1, 8 << 20)]:
        with pytest.raises(InputError, match=r"a: it would take up (33.6|839) MB of memory, from (1 bytes|8.39 MB)"):
            claims.check_expansion("a", "it", numbers, stored, "save it")


def test_headers_that_python_2_wrote(make_file):
    body = npy((2, 3), np.ones((2, 3)).tobytes()).replace(b"(2, 3)", b"(2L,3)")
    np.testing.assert_array_equal(read_cloud(make_file("a.npy", body)), np.ones((2, 3)))
    np.testing.assert_array_equal(nonsac.open_source(make_file("a.npy", body)).take(np.arange(2)), np.ones((2, 3)))


CLOUDS = {
    "ascii.ply": ply_header("ascii", FACES, f"element vertex 2\n{XYZ}") + b"3 0 1 2\n3 0 1 2\n1 2 3\n4 5 6\n",
    "binary.ply": ply_header("binary_little_endian", f"element vertex 2\n{XYZ}") + np.arange(6.0).tobytes(),
    "list.ply": ply_header("binary_little_endian", f"element vertex 2\nproperty list uchar short w\n{XYZ}")
    + 2 * (b"\0" + bytes(24)),
    "ascii.pcd": pcd_header("ascii") + b"1 2 3\n4 5 6\n",
    "binary.pcd": pcd_header("binary") + np.arange(6.0).tobytes(),
    "compressed.pcd": pcd_header("binary_compressed") + compressed(np.arange(6.0).tobytes()),
}
COUNTS = ["-1", "4294967295", str(2**63), str(10**22), "9" * 5000, "True", "nan", "0x10", ""]


@pytest.mark.parametrize("count", COUNTS, ids=lambda count: count[:25])
@pytest.mark.parametrize("name", CLOUDS)
def test_numbers_in_headers(make_file, name, count):
    """Each number of the header in turn, but for its first line."""
    content = CLOUDS[name]
    assert len(read_cloud(make_file(name, content))) == 2
    header = content[: content.index(b"end_header" if name.endswith("ply") else b"\nDATA")]
    for number in re.finditer(rb"(?<=[A-Zx] )[0-9]+|(?<= )[0-9](?= |\n)", header):
        damaged = content[: number.start()] + count.encode() + content[number.end() :]
        with contextlib.suppress(InputError):
            assert len(read_cloud(make_file(name, damaged))) <= 2


def test_compressed_points_do_not_explode(make_file):
    packed = b"\0a" + 90_000 * b"\xe0\xff\0"  # each of these three bytes makes 264
    header = struct.pack("<II", len(packed), 48)
    path = make_file("a.pcd", pcd_header("binary_compressed") + header + packed)
    with pytest.raises(InputError, match="the compressed points are truncated or damaged"):
        read_cloud(path)
