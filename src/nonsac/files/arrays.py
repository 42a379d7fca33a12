"""Read NumPy files, and check the shape and type of arrays."""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from nonsac.files.claims import check_expansion
from nonsac.files.content import check_kind, read_content
from nonsac.files.errors import FilePath, input_error
from nonsac.files.npy import HEAD_LENGTH, NpyHeader, parse_npy_header, read_npy_head
from nonsac.files.positioned import PositionedFile
from nonsac.values.quiet import as_doubles


def load_npy(path: FilePath) -> NDArray[Any]:
    """Load the array of an NPY file, never unpickling anything.

    Raises
    ------
    InputError
        If the file cannot be read, is no NPY file, is truncated, or holds pickled objects.
    """
    content = read_content(path, "NumPy array")
    header = parse_npy_header(path, content[:HEAD_LENGTH])
    _check_whole(path, header, len(content))
    array: NDArray[Any] = _load(path, lambda: np.load(BytesIO(content), allow_pickle=False))
    return array


@dataclass(frozen=True)
class Archive:
    """An open NPZ file, whose arrays are loaded one by one, never unpickling anything.

    Attributes
    ----------
    path
        The file.
    size
        Its bytes.
    members
        The members of the archive by the keys of their arrays.
    archive
        What Python made of the file.
    """

    path: FilePath
    size: int
    members: Mapping[str, ZipInfo]
    archive: ZipFile

    @property
    def names(self) -> tuple[str, ...]:
        """The keys of its arrays."""
        return tuple(self.members)

    def shape(self, name: str) -> tuple[int, ...]:
        """The shape of an array by its key, of which only the header is read; () of what is no array."""
        if not self.members[name].filename.endswith(".npy"):
            return ()
        return self._header(name).shape

    def load(self, name: str) -> NDArray[Any]:
        """Load an array by its key."""
        header, member = self._header(name), self.members[name]
        _check_whole(self.path, header, member.file_size)
        fix = "save it uncompressed, with numpy.savez"
        numbers = max(math.prod(header.shape), (member.file_size + 7) // 8)
        check_expansion(self.path, f"the array {name}", numbers, self.size, fix)
        with self._opened(name) as file:
            array: NDArray[Any] = _load(self.path, lambda: npy.read_array(file, allow_pickle=False))
        return array

    def load_only(self, widths: Sequence[int], fix: str) -> NDArray[np.float64]:
        """Load the only array of shape (n, width) for one of the widths; `fix` ends the message if it is not one."""
        fitting = [name for name in self.names if len(shape := self.shape(name)) == 2 and shape[1] in widths]
        if len(fitting) != 1:
            problem = f"cannot tell which array to use (its keys are: {', '.join(self.names) or 'none'})"
            raise input_error(self.path, problem, fix)
        array = self.load(fitting[0])
        return as_rows(self.path, array, array.shape[1])

    def _header(self, name: str) -> NpyHeader:
        with self._opened(name) as file:
            return parse_npy_header(self.path, _load(self.path, lambda: read_npy_head(file)))

    def _opened(self, name: str) -> IO[bytes]:
        member = self.members[name]
        if member.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
            problem = f"its member {member.filename} is compressed in a way that NumPy does not write"
            raise input_error(self.path, problem, "save it again, with numpy.savez")
        file: IO[bytes] = _load(self.path, lambda: self.archive.open(member))
        return file


@contextmanager
def open_npz(path: FilePath) -> Iterator[Archive]:
    """Open an NPZ file, to load arrays from it.

    Raises
    ------
    InputError
        If the file cannot be read, is no NPZ file or is damaged; on loading, also if it holds pickled objects or
        would expand beyond measure.
    """
    check_kind(path, "NumPy archive")
    size = PositionedFile(path).size
    with _load(path, lambda: ZipFile(path)) as archive:
        members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
        yield Archive(path, size, members, archive)


def load_npz(path: FilePath, wanted: Sequence[tuple[str, ...]], width: int) -> list[NDArray[np.float64]]:
    """Load arrays of an NPZ file by name or, failing that, by shape.

    Parameters
    ----------
    path
        The file.
    wanted
        Groups of names; the arrays of the first group that the file holds are loaded.
    width
        If it holds no group, the only array of shape (n, width) is loaded.

    Returns
    -------
    list of ndarray of float64
        The arrays of the group, each of shape (n, 3), or the one of shape (n, width).

    Raises
    ------
    InputError
        If the file cannot be read, is no NPZ file, is damaged, holds pickled objects under these names, or
        nothing fits.
    """
    with open_npz(path) as archive:
        for group in wanted:
            if all(name in archive.names for name in group):
                return [as_rows(path, archive.load(name), 3) for name in group]
        groups = " or ".join("/".join(group) for group in wanted)
        return [archive.load_only([width], f"save it under {groups}")]


def as_rows(path: FilePath, array: NDArray[Any], width: int) -> NDArray[np.float64]:
    """Check that an array has the shape (n, width), and turn it into doubles.

    Parameters
    ----------
    path
        The file the array comes from or goes to, for the message.
    array
        Integers or floating-point numbers.
    width
        Number of columns wanted.

    Returns
    -------
    ndarray of float64, shape (n, width)
        The array, C-contiguous.

    Raises
    ------
    InputError
        If shape or type do not fit.
    """
    if array.dtype.kind not in "iuf":
        raise input_error(path, f"holds an array of type {array.dtype}", "save plain numbers")
    if array.shape[1:] == (width,):
        return array if array.dtype == np.float64 and array.flags.c_contiguous else as_doubles(array)
    problem = f"holds an array of shape {array.shape} instead of (n, {width})"
    if array.T.shape[1:] == (width,):
        raise input_error(path, problem, "transpose it before saving, one point per row: points.T")
    raise input_error(path, problem, f"save one point per row, in {width} columns")


def _check_whole(path: FilePath, header: NpyHeader, size: int) -> None:
    """Check that so many bytes, header and all, hold the array that the header promises."""
    held = header.rows_in(size)
    if held < header.rows:
        problem = f"is truncated or damaged (its header promises {header.rows} rows, it holds {held})"
        raise input_error(path, problem, "copy or save the file again")


def _load(path: FilePath, load: Callable[[], Any]) -> Any:
    try:
        # NumPy warns if Python 2 has written the header of an array.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return load()
    # NumPy passes on the errors of zipfile, zlib and tokenize, which share no type.
    except Exception as error:
        if "allow_pickle" in str(error):
            problem = "holds pickled objects, which are never loaded"
            raise input_error(path, problem, "save plain numbers") from None
        problem = f"is truncated or damaged ({error})"
        raise input_error(path, problem, "copy or save the file again") from error
