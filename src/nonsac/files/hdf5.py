"""Open HDF5 files, and find datasets that are all there."""

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.files.claims import check_expansion, check_shape, size_of
from nonsac.files.content import check_kind, check_regular
from nonsac.files.errors import FilePath, InputError, input_error, library_missing

_MOST_LINKS = 16  # one behind the other; as many as HDF5 follows
_PREFIXES = ("HDF5_EXT_PREFIX", "HDF5_VDS_PREFIX")
_COPY = "copy the dataset into this file, with h5repack or h5py say"


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
        claims_much = "memory allocation failed" in str(error)
        damage = "it claims more memory than there is" if claims_much else error
        problem = f"is truncated, damaged or being written ({damage})"
        raise input_error(path, problem, "close it elsewhere, or copy or compute it again") from error


def nodes_of(group: Any) -> list[tuple[str, Any]]:
    """All groups and datasets in a group, with their paths in it, of which some bytes may be no text."""
    found: list[tuple[str, Any]] = []

    def visit(name: str | bytes, node: Any) -> None:
        found.append((name if isinstance(name, str) else name.decode("utf-8", "replace"), node))

    group.visititems(visit)
    return found


@dataclass(frozen=True)
class Parts:
    """Checks that a dataset is all there: HDF5 itself takes parts that are missing for fill values.

    Attributes
    ----------
    path
        The file that the user named.
    others
        The other files that were found to hold parts of it.
    """

    path: FilePath
    others: list[str]

    def find(self, group: Any, name: str) -> Any:
        """What has this name, as h5py follows links, also into other files; None if there is nothing.

        Raises
        ------
        InputError
            If a link leads to a file that is missing or no regular one.
        """
        self._check_links(group, name, 0)
        return group.get(name)

    def check(self, dataset: Any, name: str, depth: int = 0) -> None:
        """Refuse a dataset that has parts outside of HDF5 files, or that are missing.

        Raises
        ------
        InputError
            If it has; the message says which ones.
        """
        shape = check_shape(self.path, dataset.shape)
        if dataset.external or dataset.id.get_create_plist().get_external_count():
            # Such a file can name any other one, of which the bytes would pass for numbers.
            raise input_error(self.path, f"the numbers of dataset {name!r} lie in other files, as raw bytes", _COPY)
        if dataset.is_virtual:
            self._check_virtual(dataset, name, depth)
        elif dataset.chunks is not None:
            self._check_chunks(dataset, name)
        elif math.prod(shape) and dataset.id.get_storage_size() < math.prod(shape) * dataset.dtype.itemsize:
            raise self._missing(f"the numbers of dataset {name!r}")

    def _check_chunks(self, dataset: Any, name: str) -> None:
        across = [-(-length // step) for length, step in zip(dataset.shape, dataset.chunks, strict=True)]
        if dataset.id.get_num_chunks() < math.prod(across):
            first = _first_missing(across, dataset.chunks, _written_chunks(dataset))
            last = min(first + dataset.chunks[0], dataset.shape[0]) - 1
            raise self._missing(f"rows {first} to {last} of dataset {name!r}")
        fix = "write it in smaller chunks"
        numbers, stored = math.prod(dataset.chunks), size_of(dataset.file.filename)
        check_expansion(self.path, f"a chunk of dataset {name!r}", numbers, stored, fix)

    def _check_virtual(self, dataset: Any, name: str, depth: int) -> None:
        covered = 0
        for source in dataset.virtual_sources():
            what = f"the part {source.dset_name!r} of dataset {name!r}"
            if "%" in source.file_name + source.dset_name or depth == _MOST_LINKS:
                raise input_error(self.path, f"{what} cannot be followed", _COPY)
            covered += _points_in(source.vspace)
            with self._opened(dataset.file, source.file_name) as file:
                part = self.find(file, source.dset_name)
                if not hasattr(part, "shape"):
                    raise self._missing(what)
                self.check(part, source.dset_name, depth + 1)
                if not _holds(part, source):
                    raise self._missing(f"the end of {what}")
        if covered < dataset.size:
            raise self._missing(f"parts of dataset {name!r}")

    def _check_links(self, group: Any, name: str, depth: int) -> None:
        from h5py import ExternalLink, Group, SoftLink

        if depth > _MOST_LINKS:
            raise input_error(self.path, f"too many links lead to {name!r}", _COPY)
        for part in filter(None, name.split("/")):
            link = group.get(part, getlink=True)
            if isinstance(link, ExternalLink):
                with self._opened(group.file, link.filename) as file:
                    self._check_links(file, link.path, depth + 1)
            elif isinstance(link, SoftLink):
                self._check_links(group.file if link.path.startswith("/") else group, link.path, depth + 1)
            group = group.get(part)
            if not isinstance(group, Group):
                return

    @contextmanager
    def _opened(self, file: Any, name: str) -> Iterator[Any]:
        """The file that another one names; opening a pipe or a device would wait, or never end."""
        from h5py import File

        if name == ".":
            yield file
            return
        there = [place for place in _places(file.filename, name) if os.path.exists(place)]
        if not there:
            raise self._missing(f"the file {name}, which a link or dataset names")
        if not all(map(os.path.isfile, there)):
            raise input_error(self.path, f"names {name}, which is no regular file", _COPY)
        self.others.append(there[0])
        with File(there[0], "r") as other:
            yield other

    def _missing(self, what: str) -> InputError:
        return input_error(self.path, f"lacks {what} (never written, or gone)", "write or copy all of it")


def read_dataset(path: FilePath, group: Any, name: str) -> NDArray[Any]:
    """Read a whole dataset of a group.

    Raises
    ------
    InputError
        If parts of it are missing or lie elsewhere, or it would take up far more memory than the file has bytes.
    """
    parts = Parts(path, [])
    dataset = parts.find(group, name)
    if not hasattr(dataset, "shape"):
        raise input_error(path, f"{name!r} is no dataset", "write it again")
    parts.check(dataset, name)
    stored = sum(map(size_of, {dataset.file.filename, *parts.others}))
    check_expansion(path, f"the dataset {name!r}", dataset.size, stored, "write it without compression")
    return np.asarray(dataset)


def _written_chunks(dataset: Any) -> set[tuple[int, ...]]:
    """The first indices of the chunks that are there."""
    found: set[tuple[int, ...]] = set()
    if hasattr(dataset.id, "chunk_iter"):
        dataset.id.chunk_iter(lambda info: found.add(tuple(info.chunk_offset)))
        return found
    return {tuple(dataset.id.get_chunk_info(number).chunk_offset) for number in range(dataset.id.get_num_chunks())}


def _first_missing(across: Sequence[int], steps: Sequence[int], written: set[tuple[int, ...]]) -> int:
    """The first row of the first chunk that is not there, of so many chunks along each axis."""
    for number in range(math.prod(across)):
        start, rest = [], number
        for count, step in zip(reversed(across), reversed(steps), strict=True):
            rest, place = divmod(rest, count)
            start.append(place * step)
        if tuple(reversed(start)) not in written:
            return start[-1]
    return 0


def _holds(dataset: Any, source: Any) -> bool:
    """Whether a dataset is as large as a virtual one takes it to be."""
    from h5py import h5s

    if source.src_space.get_select_type() == h5s.SEL_ALL:
        return bool(dataset.size >= _points_in(source.vspace))
    _, last = source.src_space.get_select_bounds()
    return len(last) == dataset.ndim and all(end < length for end, length in zip(last, dataset.shape, strict=True))


def _points_in(space: Any) -> int:
    """How many numbers a selection has, 0 if it has no end."""
    try:
        return max(int(space.get_select_npoints()), 0)
    except (ValueError, RuntimeError):
        return 0


def _places(file: str, name: str) -> Sequence[str]:
    """Where HDF5 looks for a file that another one names."""
    folders = [os.environ[prefix] for prefix in _PREFIXES if prefix in os.environ]
    folders += [os.path.dirname(file), os.path.dirname(os.path.realpath(file)), os.curdir]
    given = [name] if os.path.isabs(name) else []
    return given + [os.path.join(folder, Path(name).name if given else name) for folder in folders]


def _import_h5py(path: FilePath, files: str, extra: str) -> Any:
    try:
        import h5py  # type: ignore[import-untyped,unused-ignore]
    except ImportError as error:
        raise library_missing(path, files, "h5py", extra) from error
    return h5py
