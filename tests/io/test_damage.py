"""Whatever happens to a file, reading it gives points or an InputError."""

import contextlib
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from io_samples import FACES, XYZ, compressed, mixed_faces, npy, npz, pcd_header, ply_header
from nonsac.io import InputError, read_cloud, read_pairs, read_transform

BODY = struct.pack("<6d", *range(6))
SAMPLES = {
    "ascii.ply": ply_header("ascii", FACES, f"element vertex 2\n{XYZ}") + b"3 0 1 2\n3 0 1 2\n1 2 3\n4 5 6\n",
    "binary.ply": ply_header("binary_little_endian", FACES, f"element vertex 2\n{XYZ}") + mixed_faces("<") + BODY,
    "list.ply": ply_header("binary_big_endian", f"element vertex 1\nproperty list uchar short w\n{XYZ}")
    + b"\x01\x00\x00"
    + BODY[:24],
    "ascii.pcd": pcd_header("ascii") + b"1 2 3\n4 5 6\n",
    "binary.pcd": pcd_header("binary") + BODY,
    "compressed.pcd": pcd_header("binary_compressed") + compressed(BODY),
    "a.csv": b"x,y,z\n1,2,3\n4,5,6\n",
    "a.pts": b"2\n1 2 3\n4 5 6\n",
    "a.npy": npy((2, 3), BODY),
    "a.npz": npz(points=np.ones((2, 3))),
}


@pytest.mark.parametrize("name", SAMPLES)
@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files(tmp_path, name, data):
    content = bytearray(SAMPLES[name])
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / name
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content)
    for read in (read_cloud, read_pairs, read_transform):
        with contextlib.suppress(InputError):
            read(path)
