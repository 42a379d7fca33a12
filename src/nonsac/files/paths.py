"""Names of files on this machine or behind URLs: what they stand for, and how to open them."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from nonsac.files.content import check_regular, unreadable
from nonsac.files.errors import FilePath, InputError, input_error, library_missing
from nonsac.values.checks import file_name

Choice = TypeVar("Choice")

Stamp = tuple[int, int]


def is_url(path: FilePath) -> bool:
    return "://" in os.fspath(path)


def listed_files(paths: FilePath | Sequence[FilePath], suffixes: Sequence[str]) -> list[str]:
    """The files that a file, folder, glob or URL, or a list of them, stand for; sorted within each.

    Of a folder, the files at any depth with one of the suffixes or, if none has one, all; as usual, not those whose
    names or folders begin with `_` or `.`.

    Raises
    ------
    InputError
        If one stands for no file at all.
    """
    given = [paths] if isinstance(paths, (str, os.PathLike)) else list(paths)
    if not given:
        raise ValueError("paths must name at least one file, folder or URL")
    return [file for path in given for file in _files_of(os.fspath(path), suffixes)]


def open_file(path: str) -> Any:
    """The file, to be read by pyarrow, h5py or the like."""
    if not is_url(path):
        check_regular(path)
        return open(path, "rb", buffering=0)
    fs, name = _file_system(path)
    return fs.open(name, "rb", cache_type="none")  # its readers ask for what they need, and for no more


def read_head(path: str, count: int) -> bytes:
    with file_errors(path), open_file(path) as file:
        return bytes(file.read(count))


def is_folder(path: str) -> bool:
    """Whether it is one; over HTTP there are none."""
    if not is_url(path):
        return os.path.isdir(path)
    with file_errors(path):
        return not path.startswith("http") and bool(_file_system(path)[0].isdir(_file_system(path)[1]))


def holds(folder: str, name: str) -> bool:
    """Whether a folder holds something of this name."""
    if not is_url(folder):
        return os.path.exists(os.path.join(folder, name))
    fs, root = _file_system(folder)
    return bool(fs.exists(f"{root.rstrip('/')}/{name}"))


def stamp_of(path: str) -> Stamp | None:
    """What changes if a file on this machine does: its size and the time of its last change."""
    if is_url(path):
        return None
    status = check_regular(path)
    return status.st_size, status.st_mtime_ns


@contextmanager
def file_errors(path: str) -> Iterator[None]:
    """Turn what libraries raise on reading a file, which shares no type, into one line that names the file."""
    try:
        yield
    except InputError:
        raise
    except ImportError as error:
        raise input_error(path, f"a library is missing ({error})", "install it with pip") from error
    except Exception as error:
        if isinstance(error, OSError) and (isinstance(error, FileNotFoundError) or error.errno is not None):
            raise unreadable(path, error) from error
        if is_url(path):
            raise input_error(path, f"cannot be read ({error})", "check the address and the file") from error
        damage = "it claims more memory than there is" if isinstance(error, MemoryError) else error
        raise input_error(path, f"is truncated or damaged ({damage})", "copy or save the file again") from error


def changed(path: str) -> InputError:
    return input_error(path, "the file was changed after it was opened", "open it again when it is complete")


def _files_of(path: str, suffixes: Sequence[str]) -> list[str]:
    if glob.has_magic(path) and (is_url(path) or not os.path.exists(path)):
        return _matching(path)
    if not is_folder(path):
        return [path]
    visible = [name for name in _beneath(path) if not any(part[0] in "._" for part in _inner_parts(name, path))]
    found = [name for name in visible if os.path.splitext(name)[1].lower() in suffixes] or visible
    if not found:
        raise input_error(path, "the folder holds no files", f"put files into it that end in {' or '.join(suffixes)}")
    return found


def _inner_parts(name: str, folder: str) -> list[str]:
    """The parts of a path from a folder on."""
    depth = len(_parts(folder))
    return _parts(name)[depth:]


def _parts(path: str) -> list[str]:
    return [part for part in path.replace(os.sep, "/").split("/") if part]


def _matching(pattern: str) -> list[str]:
    if is_url(pattern):
        with file_errors(pattern):
            fs, name = _file_system(pattern)
            found = [str(fs.unstrip_protocol(match)) for match in fs.glob(name)]
    else:
        found = [match for match in glob.glob(pattern, recursive=True) if not os.path.isdir(match)]
    if not found:
        raise input_error(pattern, "no file matches this pattern", "check the path (files in folders match folder*/*)")
    return sorted(found)


def _beneath(folder: str) -> list[str]:
    """All files of a folder, at any depth."""
    if not is_url(folder):
        with file_errors(folder):
            return sorted(str(path) for path in Path(folder).rglob("*") if path.is_file())
    with file_errors(folder):
        fs, name = _file_system(folder)
        return sorted(str(fs.unstrip_protocol(file)) for file in fs.find(name))


def _file_system(url: str) -> tuple[Any, str]:
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise library_missing(url, "URLs", "fsspec", "parquet") from error
    fs, name = url_to_fs(url)
    return fs, str(name)


def choose_by_suffix(path: FilePath, choices: dict[str, Choice]) -> Choice:
    """Return the choice for the suffix of a path.

    Parameters
    ----------
    path
        A file name; the case of its suffix does not matter.
    choices
        What to choose from, by lower-case suffix with its dot.

    Returns
    -------
    object
        The value of `choices` for this suffix.

    Raises
    ------
    InputError
        If the path is a folder, or no choice has its suffix.
    """
    suffix = Path(file_name("path", path)).suffix.lower()
    if suffix in choices:
        return choices[suffix]
    if os.path.isdir(path):
        raise unreadable(path, IsADirectoryError())
    problem = f"unknown suffix {suffix!r}" if suffix else "the file name has no suffix"
    raise input_error(path, problem, f"use one of {', '.join(choices)}")
