"""Read and write the points of PCD files.

An own reader, as pypcd4 1.5 takes truncated files for whole ones, and refuses the versions before 0.7,
headers without COUNT, and ASCII rows with two spaces or a tab between values.
"""

import struct
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.content import read_content
from nonsac.files.errors import FilePath, input_error
from nonsac.files.records import find_axes, truncated, unpack_columns
from nonsac.files.text import Table, split_lines

_NUMBER_KINDS = {"F": "<f", "I": "<i", "U": "<u"}
_LITERAL_LIMIT = 32
_LONG_MATCH = 9


@dataclass(frozen=True)
class _Header:
    """What the header of a PCD file says; `offsets` are those of the axes within one point."""

    count: int
    encoding: str
    formats: list[np.dtype[Any]]
    columns: list[int]
    offsets: list[int]
    point_size: int


def read_pcd(path: FilePath) -> NDArray[np.float64]:
    """Read the points of a PCD file: ASCII, binary or compressed binary.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    ndarray of float64, shape (n, 3)
        The points in the order of the file; invalid ones are NaN, as there.

    Raises
    ------
    InputError
        If the file cannot be read, is no PCD file, is truncated, or has no fields x, y and z.
    """
    content = read_content(path, "PCD file")
    fields, start = _split_header(path, content)
    header = _parse_header(path, fields)
    if header.encoding == "ascii":
        return _read_ascii(path, content, start, header)
    body = content[start:]
    steps = [header.point_size] * 3
    offsets = header.offsets
    if header.encoding == "binary_compressed":
        body = _decompress_body(path, body)
        # Compressed files hold all values of the first field, then all of the second, and so on.
        steps = [kind.itemsize for kind in header.formats]
        offsets = [offset * header.count for offset in offsets]
    found = len(body) // header.point_size
    if found < header.count:
        raise truncated(path, header.count, found)
    return unpack_columns(body, header.count, header.formats, offsets, steps)


def write_pcd(path: Path, points: NDArray[np.float64]) -> None:
    """Write points, shape (n, 3), as a binary PCD file of doubles."""
    count = len(points)
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    )
    path.write_bytes(header.encode() + points.astype("<f8").tobytes())


def decompress_lzf(data: bytes, most: int = sys.maxsize) -> bytes:
    """Undo LZF compression.

    Parameters
    ----------
    data
        The compressed bytes.
    most
        How many bytes they may have been.

    Returns
    -------
    bytes
        The original bytes.

    Raises
    ------
    IndexError, ValueError
        If the data are damaged, or were more than that.
    """
    output = bytearray()
    position = 0
    while position < len(data) and len(output) <= most:
        control = data[position]
        position += 1
        if control < _LITERAL_LIMIT:
            output += data[position : position + control + 1]
            position += control + 1
            continue
        length = (control >> 5) + 2
        if length == _LONG_MATCH:
            length += data[position]
            position += 1
        start = len(output) - ((control & 31) << 8) - data[position] - 1
        position += 1
        if start < 0:
            raise ValueError("a match starts before the data")
        match = output[start : start + length]
        if len(match) < length:
            # The match reaches into the bytes that it produces itself, and so repeats.
            match = (match * length)[:length]
        output += match
    if len(output) > most:
        raise ValueError(f"more than {most} bytes")
    return bytes(output)


def _split_header(path: FilePath, content: bytes) -> tuple[dict[str, list[str]], int]:
    fields: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in fields:
        end = content.find(b"\n", start)
        if end < 0:
            raise input_error(path, "the PCD header has no DATA line", "copy or export the file again")
        words = content[start:end].decode("ascii", errors="replace").split()
        if words and not words[0].startswith("#"):
            fields[words[0].upper()] = words[1:]
        start = end + 1
    return fields, start


def _parse_header(path: FilePath, fields: dict[str, list[str]]) -> _Header:
    names = fields.get("FIELDS", fields.get("COLUMNS", []))
    axes = find_axes(path, names)
    try:
        repeats = [int(text) for text in fields.get("COUNT", ["1"] * len(names))]
        pairs = zip(fields["TYPE"], fields["SIZE"], strict=True)
        kinds = [np.dtype(f"{_NUMBER_KINDS[letter]}{int(size)}") for letter, size in pairs]
        count = int(fields["POINTS"][0]) if "POINTS" in fields else _grid_size(fields)
        encoding = fields["DATA"][0]
        if not len(names) == len(kinds) == len(repeats) or min(count, *repeats) < 0:
            raise ValueError
        if any(repeats[axis] != 1 for axis in axes):
            raise ValueError
    except (KeyError, IndexError, ValueError, TypeError):
        problem = "the PCD header is not valid: FIELDS, SIZE, TYPE, COUNT or POINTS are missing or disagree"
        raise input_error(path, problem, "export the file again") from None
    if encoding not in ("ascii", "binary", "binary_compressed"):
        problem = f"the PCD header names the unknown encoding {encoding!r}"
        raise input_error(path, problem, "export the file as ascii, binary or binary_compressed")
    sizes = [kind.itemsize * repeat for kind, repeat in zip(kinds, repeats, strict=True)]
    return _Header(
        count,
        encoding,
        formats=[kinds[axis] for axis in axes],
        columns=[sum(repeats[:axis]) for axis in axes],
        offsets=[sum(sizes[:axis]) for axis in axes],
        point_size=sum(sizes),
    )


def _grid_size(fields: dict[str, list[str]]) -> int:
    return int(fields["WIDTH"][0]) * int(fields.get("HEIGHT", ["1"])[0])


def _read_ascii(path: FilePath, content: bytes, start: int, header: _Header) -> NDArray[np.float64]:
    lines = split_lines(content[start:])
    if max(header.columns) >= len(content):  # no row is so long
        raise truncated(path, header.count, 0)
    points = Table(path, lines, content.count(b"\n", 0, start) + 1).numbers(header.columns)
    if len(points) < header.count:
        raise truncated(path, header.count, len(points))
    return points[: header.count]


def _decompress_body(path: FilePath, body: bytes) -> bytes:
    try:
        compressed_size, size = struct.unpack_from("<II", body)
        data = decompress_lzf(body[8 : 8 + compressed_size], size)
        if len(data) != size:
            raise ValueError(f"{len(data)} bytes instead of {size}")
    except (struct.error, IndexError, ValueError) as error:
        problem = f"the compressed points are truncated or damaged ({error})"
        raise input_error(path, problem, "copy or export the file again") from error
    return data
