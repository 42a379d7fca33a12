"""Open HDF5 files."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from nonsac.files.content import check_kind, check_regular
from nonsac.files.errors import FilePath, InputError, input_error, library_missing


@contextmanager
def open_hdf5(path: FilePath, files: str = "HDF5 files", extra: str = "hdf5") -> Iterator[Any]:
    """Open an HDF5 file to read from it.

    Parameters
    ----------
    path
        The file.
    files, extra
        What such files are called, and the extra of nonsac that has h5py, if it is missing.

    Raises
    ------
    InputError
        If h5py is missing, the file cannot be read, is no HDF5 file, is truncated or damaged; within the block, too.
    """
    h5py = _import_h5py(path, files, extra)
    check_regular(path)
    if not h5py.is_hdf5(path):  # with a user block, which MATLAB writes, it does not start like one
        check_kind(path, "HDF5 file")
    try:
        with h5py.File(path, "r") as file:
            yield file
    except InputError:
        raise
    # h5py passes on the errors of the HDF5 library as OSError, KeyError, RuntimeError and others.
    except Exception as error:
        problem = f"is truncated, damaged or being written ({error})"
        raise input_error(path, problem, "close it elsewhere, or copy or compute it again") from error


def _import_h5py(path: FilePath, files: str, extra: str) -> Any:
    try:
        import h5py  # type: ignore[import-untyped,unused-ignore]
    except ImportError as error:
        raise library_missing(path, files, "h5py", extra) from error
    return h5py
