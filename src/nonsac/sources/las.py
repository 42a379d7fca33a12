"""Points of LAS and LAZ files."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.errors import FilePath
from nonsac.files.las import open_las, stored_coordinates
from nonsac.files.positioned import PositionedFile
from nonsac.files.records import truncated
from nonsac.sources.blocks import EvenBlockSource
from nonsac.sources.records import Records, RecordSource
from nonsac.sources.wrapped import WrappedSource
from nonsac.values.quiet import quiet

_USUAL_CHUNK = 50_000
_NO_FIXED_CHUNK = 2**32 - 1
_COORDINATE = np.dtype("<i4")


class LasSource(WrappedSource):
    """x, y and z of a LAS or LAZ file, in the units of its coordinate system.

    Any point of a LAS file can be read by itself; those of a LAZ file come in the chunks that it is compressed in.

    Parameters
    ----------
    path : path
        The file.

    Raises
    ------
    InputError
        If laspy is missing, or the file cannot be read, is no LAS file, is truncated or damaged; on reading also if
        it was changed in the meantime.
    """

    def __init__(self, path: FilePath) -> None:
        file = PositionedFile(path)
        with open_las(file.name, single_threaded=True) as reader:
            header = reader.header
            self.scales, self.offsets = np.array(header.scales), np.array(header.offsets)
            rows = _LazBlocks(file, reader) if header.are_points_compressed else _las_records(file, header)
        super().__init__(rows, file.name, ("x", "y", "z"))

    def take(self, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        return self._moved(super().take(indices))

    def chunks(self, rows: int, start: int = 0, stop: int | None = None) -> Iterator[NDArray[np.float64]]:
        return map(self._moved, super().chunks(rows, start, stop))

    @quiet
    def _moved(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        points *= self.scales
        points += self.offsets
        return points


def _las_records(file: PositionedFile, header: Any) -> RecordSource:
    size, first = header.point_format.size, header.offset_to_point_data
    held = max(0, file.size - first) // size
    if held < header.point_count:
        raise truncated(file.name, header.point_count, held)
    columns = tuple((position, _COORDINATE) for position in (0, 4, 8))
    return RecordSource([Records(file, first, size, header.point_count, columns)])


class _LazBlocks(EvenBlockSource):
    def __init__(self, file: PositionedFile, reader: Any) -> None:
        self.file = file
        count, chunk = reader.header.point_count, _chunk_points(reader.header)
        super().__init__(count, chunk, 3, file.size)
        if count:
            reader.seek(count - 1)

    def read_block(self, block: int) -> NDArray[np.float64]:
        first, last = self.bounds(block)
        self.file.check()
        with open_las(self.file.path, single_threaded=True) as reader:
            reader.seek(first)
            points = stored_coordinates(reader.read_points(last - first))
        self.file.check()
        return points.astype(np.float64)


def _chunk_points(header: Any) -> int:
    """Points in a compressed chunk of the file, as its record of the compression says."""
    found = header.vlrs.get("LasZipVlr")
    points = struct.unpack_from("<I", found[0].record_data, 12)[0] if found else 0
    return _USUAL_CHUNK if points in (0, _NO_FIXED_CHUNK) else int(points)
