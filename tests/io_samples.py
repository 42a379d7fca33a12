"""Sample files, built byte by byte from the definitions of their formats."""

import io
import struct

import numpy as np

XYZ = "property double x\nproperty double y\nproperty double z\n"
FACES = "element face 2\nproperty list uchar int vertex_indices\n"


def ply_header(form, *parts, vertices=4):
    lines = "".join(parts) or f"element vertex {vertices}\n{XYZ}"
    return f"ply\nformat {form} 1.0\ncomment made by hand\n{lines}end_header\n".encode()


def mixed_faces(order):
    return struct.pack(order + "B3iB4i", 3, 0, 1, 2, 4, 0, 1, 2, 3)


def pcd_header(data, changes=None):
    fields = {
        "VERSION": "0.7",
        "FIELDS": "x y z",
        "SIZE": "8 8 8",
        "TYPE": "F F F",
        "COUNT": "1 1 1",
        "WIDTH": "2",
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": "2",
        "DATA": data,
    }
    fields |= changes or {}
    text = "".join(f"{name} {value}\n" for name, value in fields.items() if value is not None)
    return b"# .PCD v.7 - Point Cloud Data file format\n" + text.encode()


def literals(data):
    """Compress to LZF without any match."""
    pieces = [data[start : start + 32] for start in range(0, len(data), 32)]
    return b"".join(bytes([len(piece) - 1]) + piece for piece in pieces)


def compressed(data):
    packed = literals(data)
    return struct.pack("<II", len(packed), len(data)) + packed


def npy(shape, body, kind="<f8"):
    """Build an NPY file, version 1.0, from the definition of the format."""
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    text += " " * (-(len(text) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + body


def npz(**members):
    buffer = io.BytesIO()
    np.savez(buffer, **members)
    return buffer.getvalue()
