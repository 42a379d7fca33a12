"""Read and write the points of PLY files.

An own reader, as trimesh 5.2 takes a truncated ASCII file for a whole one, and refuses binary files in
which triangles are mixed with larger faces, vertices have list properties, or bytes follow the last
element. plyfile is under the GPL.
"""

import re
import struct
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nonsac.files.content import read_content
from nonsac.files.errors import FilePath, input_error
from nonsac.files.records import find_axes, truncated, unpack_columns
from nonsac.files.text import Table, split_lines

_HEADER_END = re.compile(rb"\n[ \t]*end_header[ \t]*\r?\n")
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "ushort": "H",
    "int": "i",
    "uint": "I",
    "float": "f",
    "double": "d",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}


@dataclass(frozen=True)
class _Property:
    name: str
    type: str
    length_type: str | None = None

    @property
    def first_type(self) -> str:
        """The type of what comes first in a row: the value, or the length of the list."""
        return self.length_type or self.type


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def has_lists(self) -> bool:
        return any(item.length_type for item in self.properties)

    @property
    def least_row_size(self) -> int:
        """Bytes in a row whose lists are all empty."""
        return sum(struct.calcsize("=" + item.first_type) for item in self.properties)


def read_ply(path: FilePath) -> NDArray[np.float64]:
    """Read the vertices of a PLY file, ASCII or binary, in their order.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    ndarray of float64, shape (n, 3)
        All vertices, also those of no face.

    Raises
    ------
    InputError
        If the file cannot be read, is no PLY file, is truncated, or has no vertices with x, y and z.
    """
    content = read_content(path, "PLY file")
    end = _HEADER_END.search(content)
    if end is None:
        raise input_error(path, "the PLY header has no end_header line", "copy or export the file again")
    order, elements = _parse_header(path, content[: end.start()].decode("ascii", errors="replace"))
    names = [element.name for element in elements]
    if "vertex" not in names:
        problem = "the PLY header declares no vertex element"
        raise input_error(path, problem, "export the file with its points")
    position = names.index("vertex")
    vertex = elements[position]
    axes = find_axes(path, [item.name for item in vertex.properties])
    if any(vertex.properties[axis].length_type for axis in axes):
        raise input_error(path, "x, y and z are lists in the PLY header", "export them as single numbers")
    if order:
        return _read_binary(path, content[end.end() :], order, elements[: position + 1], axes)
    table = Table(path, split_lines(content[end.end() :]), content.count(b"\n", 0, end.end()) + 1)
    return _read_ascii(table, elements, position, axes)


def write_ply(path: Path, points: NDArray[np.float64]) -> None:
    """Write points, shape (n, 3), as a binary little-endian PLY file of doubles."""
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property double x\nproperty double y\nproperty double z\nend_header\n"
    )
    path.write_bytes(header.encode() + points.astype("<f8").tobytes())


def _parse_header(path: FilePath, header: str) -> tuple[str, list[_Element]]:
    order: str | None = None
    elements: list[_Element] = []
    for number, line in enumerate(header.split("\n"), 1):
        try:
            match line.split():
                case ["format", name, *_]:
                    order = _BYTE_ORDERS[name]
                case ["element", name, count] if int(count) >= 0:
                    elements.append(_Element(name, int(count)))
                case ["property", "list", length_type, value_type, name] if _TYPES[length_type] not in "fd":
                    elements[-1].properties.append(_Property(name, _TYPES[value_type], _TYPES[length_type]))
                case ["property", value_type, name]:
                    elements[-1].properties.append(_Property(name, _TYPES[value_type]))
                case ["element" | "property", *_]:
                    raise ValueError
        except (KeyError, IndexError, ValueError):
            problem = f"line {number} of the PLY header is not valid: {line[:60]!r}"
            raise input_error(path, problem, "export the file again") from None
    if order is None:
        raise input_error(path, "the PLY header has no format line", "export the file again")
    return order, elements


def _read_ascii(table: Table, elements: Sequence[_Element], position: int, axes: Sequence[int]) -> NDArray[np.float64]:
    filled = [index for index, line in enumerate(table.lines) if line]
    # Counting the rows of all elements, as a face must not pass for a missing vertex.
    promised = sum(element.count for element in elements if element.properties)
    if len(filled) < promised:
        raise truncated(table.path, promised, len(filled), "data")
    vertex = elements[position]
    skipped = sum(element.count for element in elements[:position] if element.properties)
    filled = filled[skipped : skipped + vertex.count]
    if not filled:
        return np.empty((0, 3))
    rows = Table(table.path, table.lines[filled[0] : filled[-1] + 1], table.first_number + filled[0])
    if not vertex.has_lists:
        return rows.numbers(axes)
    return np.array([_axes_after_lists(table.path, vertex, number, row) for number, row in rows.rows()])


def _axes_after_lists(path: FilePath, vertex: _Element, number: int, row: Sequence[str]) -> list[float]:
    values: dict[str, float] = {}
    position = 0
    try:
        for item in vertex.properties:
            if item.length_type:
                position += max(int(row[position]), 0)
            else:
                values.setdefault(item.name, float(row[position]))
            position += 1
        return [values[axis] for axis in "xyz"]
    except (IndexError, ValueError, KeyError):
        problem = f"line {number} does not fit the vertex properties in the PLY header"
        raise input_error(path, problem, "export the file again") from None


def _read_binary(
    path: FilePath, body: bytes, order: str, elements: Sequence[_Element], axes: Sequence[int]
) -> NDArray[np.float64]:
    *before, vertex = elements
    start = 0
    for element in before:
        if element.has_lists:
            starts = _property_starts(path, body, start, order, element)
            start = deque(starts, maxlen=1).pop()[-1] if element.count else start
        else:
            start += element.count * element.least_row_size
    if vertex.has_lists:
        rows = _property_starts(path, body, start, order, vertex)
        values = (_value(body, order, vertex, axis, starts) for starts in rows for axis in axes)
        return np.fromiter(values, np.float64).reshape(-1, 3)
    found = max(len(body) - start, 0) // vertex.least_row_size
    if found < vertex.count:
        raise truncated(path, vertex.count, found)
    sizes = [struct.calcsize("=" + item.type) for item in vertex.properties]
    offsets = [start + sum(sizes[:axis]) for axis in axes]
    formats = [np.dtype(order + vertex.properties[axis].type) for axis in axes]
    return unpack_columns(body, vertex.count, formats, offsets, [vertex.least_row_size] * 3)


def _property_starts(path: FilePath, body: bytes, start: int, order: str, element: _Element) -> Iterator[list[int]]:
    """Yield for each row where its properties start and, at last, where it ends: rows with lists differ."""
    for row in range(element.count):
        starts = [start]
        for item in element.properties:
            end = start + struct.calcsize("=" + item.first_type)
            if item.length_type and end <= len(body):
                (length,) = struct.unpack_from(order + item.length_type, body, start)
                end += max(length, 0) * struct.calcsize("=" + item.type)
            if end > len(body):
                raise truncated(path, element.count, row, element.name)
            starts.append(start := end)
        yield starts


def _value(body: bytes, order: str, element: _Element, index: int, starts: Sequence[int]) -> float:
    return float(struct.unpack_from(order + element.properties[index].type, body, starts[index])[0])
