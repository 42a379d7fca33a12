"""Small files that hold some hundred megabytes: reading them has to be refused, or to be cheap."""

from __future__ import annotations

import importlib.util
import io
import json
import random
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np

from fuzz.mutations import Files

_ROWS = 10_000_000  # of four doubles
_BLOCK = bytes(2**20)


def _zeros() -> Iterator[bytes]:
    for start in range(0, 32 * _ROWS, len(_BLOCK)):
        yield _BLOCK[: 32 * _ROWS - start]


@cache
def _deflated() -> bytes:
    packer = zlib.compressobj(1)
    return b"".join([*map(packer.compress, _zeros()), packer.flush()])


def _npz() -> Files:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (_ROWS, 4)})
    buffer = io.BytesIO()
    deflating = zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
    with deflating as archive, archive.open("rows.npy", "w") as member:
        member.write(header.getvalue())
        for block in _zeros():
            member.write(block)
    return {"a.npz": buffer.getvalue()}


def _hdf5() -> Files:
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        rows = file.create_dataset("rows", (_ROWS, 4), "<f8", chunks=(_ROWS, 4), compression="gzip")
        rows.id.write_direct_chunk((0, 0), _deflated())
    return {"a.h5": buffer.getvalue()}


def _zarr() -> Files:
    shape = {"shape": [_ROWS, 4], "chunks": [_ROWS, 4], "order": "C"}
    kind = {"dtype": "<f8", "fill_value": 0.0, "filters": None, "compressor": {"id": "zlib", "level": 1}}
    metadata = {"zarr_format": 2} | shape | kind
    return {"a.zarr/.zarray": json.dumps(metadata).encode(), "a.zarr/0.0": _deflated()}


def _parquet() -> Files:
    import pyarrow as pa
    from pyarrow.parquet import write_table

    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(_ROWS, np.int8)), pa.array([1.5]))
    buffer = io.BytesIO()
    names = ["x1", "y1", "x2", "y2"]
    write_table(pa.table(dict.fromkeys(names, column)), buffer, row_group_size=_ROWS, store_schema=False)
    return {"a.parquet": buffer.getvalue()}


def _pcd() -> Files:
    """LZF, which packs 264 equal bytes into three."""
    packed = b"\x00\x00" + b"\xe0\xff\x00" * 60_000
    count = (1 + 264 * 60_000) // 24
    header = "# .PCD v.7\nVERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\n"
    header += f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary_compressed\n"
    return {"a.pcd": header.encode() + struct.pack("<II", len(packed), 24 * count) + packed}


_MAKERS: dict[str, tuple[Callable[[], Files], str]] = {
    "npz": (_npz, "numpy"),
    "hdf5": (_hdf5, "h5py"),
    "zarr": (_zarr, "zarr"),
    "parquet": (_parquet, "pyarrow"),
    "pcd": (_pcd, "numpy"),
}


@cache
def made() -> list[Files]:
    return [make() for make, library in _MAKERS.values() if importlib.util.find_spec(library) is not None]


def one(rng: random.Random) -> Files:
    """One of them, or one of which a length is off."""
    files = dict(rng.choice(made()))
    if rng.random() < 0.5:
        name = rng.choice(sorted(files))
        content = bytearray(files[name])
        content[rng.randrange(min(len(content), 400))] ^= 1 << rng.randrange(8)
        files[name] = bytes(content)
    return files


def seeds() -> list[Any]:
    """What is not large, so that it can be read."""
    made()
    return [{"a.npy": _saved()}]


def _saved() -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.zeros((5, 4)))
    return buffer.getvalue()
