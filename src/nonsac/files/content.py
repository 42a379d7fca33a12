"""Read the bytes of a file and check them against what its suffix promises."""

import errno
import os
import re
import stat
from pathlib import Path

from nonsac.files.errors import FilePath, InputError, input_error

UTF16 = "UTF-16 text"
_HDF5 = b"\x89HDF\r\n\x1a\n"
_AFTER_USER_BLOCK = (512, 1024, 2048)  # as MATLAB has it, say
_MARKS = {
    b"\x93NUMPY": "NumPy array",
    b"PK\x03\x04": "NumPy archive",
    b"PK\x05\x06": "NumPy archive",
    b"LASF": "LAS file",
    b"PAR1": "Parquet file",
    b"ARROW1": "Arrow file",
    _HDF5: "HDF5 file",
    b"SQLite format 3\x00": "SQLite database",
    b"PIEH": "Middlebury flow file",
    b"\x89PNG": "PNG image",
    b"\xff\xd8\xff": "JPEG image",
    b"%PDF": "PDF document",
    b"\x1f\x8b": "gzip archive",
    b"\xff\xfe": UTF16,
    b"\xfe\xff": UTF16,
}
_READ_BY_LIBRARIES = ("LAS file", "Parquet file", "Arrow file", "HDF5 file")
_USUAL_SUFFIX = {
    "NumPy array": ".npy",
    "NumPy archive": ".npz",
    "LAS file": ".las",
    "PLY file": ".ply",
    "PCD file": ".pcd",
    "text table": ".xyz",
    "Parquet file": ".parquet",
    "Arrow file": ".arrow",
    "HDF5 file": ".h5",
    "SQLite database": ".db",
    "Middlebury flow file": ".flo",
}
_PLY_START = re.compile(rb"ply[ \t]*\r?\n")
_PCD_START = re.compile(rb"#[ \t]*\.PCD|(?:#[^\n]*\n|\s)*(?:VERSION\s+[.\d]+|FIELDS|COLUMNS)\s")
# Without a mark at its beginning: every second byte of plain letters is zero.
_UTF16_TEXT = re.compile(rb"(?:[\t\n\r -~]\x00){4}|(?:\x00[\t\n\r -~]){4}")
_NEVER_IN_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1f]")
_HEAD_LENGTH = 4096


def read_content(path: FilePath, kind: str) -> bytes:
    """Read a whole file that has to be of the given kind.

    Parameters
    ----------
    path
        The file to read.
    kind
        The kind its suffix promises: "PLY file", "PCD file", "NumPy array", "NumPy archive", "LAS file",
        "Parquet file", "HDF5 file", "SQLite database" or "text table".

    Returns
    -------
    bytes
        The content.

    Raises
    ------
    InputError
        If the file cannot be read, is empty or is of another kind.
    """
    check_kind(path, kind)
    return read_bytes(path, kind)


def read_bytes(path: FilePath, kind: str = "file") -> bytes:
    """Read a whole file, of which the kind is known or does not matter.

    Raises
    ------
    InputError
        If the file cannot be read, is empty or larger than the memory.
    """
    check_regular(path)
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    except MemoryError:
        fix = "save it as Parquet or .npy, which are read in pieces" if kind == "text table" else "give a smaller one"
        raise input_error(path, "is larger than the memory there is", fix) from None
    return _not_empty(path, content)


def check_kind(path: FilePath, kind: str) -> bytes:
    """Check a file that a library then reads piece by piece, as `read_content` does, and return its first bytes.

    Raises
    ------
    InputError
        If the file cannot be read, is empty or is of another kind.
    """
    check_regular(path)
    try:
        with Path(path).open("rb") as file:
            head = file.read(_HEAD_LENGTH)
    except OSError as error:
        raise unreadable(path, error) from error
    check_head(path, _not_empty(path, head), kind)
    return head


def check_regular(path: FilePath) -> os.stat_result:
    """Refuse what is no regular file: a pipe may wait for ever, and a device has no end.

    Raises
    ------
    InputError
        If there is no such file, it is none, or its name cannot be one.
    """
    status = status_of(path)
    if stat.S_ISDIR(status.st_mode):
        raise unreadable(path, IsADirectoryError())
    if not stat.S_ISREG(status.st_mode):
        raise not_regular(path, status)
    return status


def status_of(path: FilePath) -> os.stat_result:
    """What the system knows of a file, or the error that says why it knows nothing."""
    try:
        return os.stat(path)
    except ValueError:
        check_name(path)
        raise
    except OSError as error:
        raise unreadable(path, error) from error


def check_name(path: FilePath) -> None:
    """Refuse what no file can be called, be there one or not."""
    try:
        os.stat(path)
    except ValueError as error:  # a NUL character, or one that the file system cannot spell
        raise input_error(path, f"cannot be the name of a file ({error})", "correct the path") from error
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise unreadable(path, error) from error


def not_regular(path: FilePath, status: os.stat_result) -> InputError:
    """Say that something is no regular file, and what to do about it."""
    fix = "copy what it gives to a file on disk"
    if stat.S_ISFIFO(status.st_mode):
        fix += " (a pipe is read as text only: as -, or under a name that ends in .csv)"
    return input_error(path, "is no regular file", fix)


def may_end_process(path: FilePath) -> bool:
    """Whether a library reads the file that, if its bytes are damaged, may end the process instead of raising."""
    try:
        if not Path(path).is_file():
            return Path(path).is_dir()
        with Path(path).open("rb") as file:
            return content_kind(file.read(_HEAD_LENGTH)) in _READ_BY_LIBRARIES
    except (OSError, ValueError):
        return False


def unreadable(path: FilePath, error: OSError) -> InputError:
    """Say why the system did not let a file be read."""
    if isinstance(error, FileNotFoundError):
        return input_error(path, "no such file", "check the path")
    if error.errno == errno.ENAMETOOLONG:
        return input_error(path, "the name is too long for the system", "shorten it")
    if os.path.isdir(path):
        return input_error(path, "is a folder, not a file", "give the name of a file")
    if isinstance(error, PermissionError):
        return input_error(path, "permission denied", "make the file readable for you")
    return input_error(path, f"cannot be read ({error.strerror or error})", "check the file and its disk")


def content_kind(content: bytes) -> str:
    """Name the kind of a file by its first bytes."""
    if _PLY_START.match(content):
        return "PLY file"
    if _PCD_START.match(content[:_HEAD_LENGTH]):
        return "PCD file"
    for mark, kind in _MARKS.items():
        if content.startswith(mark):
            return kind
    if any(content.startswith(_HDF5, start) for start in _AFTER_USER_BLOCK):
        return "HDF5 file"
    if _UTF16_TEXT.match(content):
        return UTF16
    return "unknown binary file" if _NEVER_IN_TEXT.search(content[:_HEAD_LENGTH]) else "text table"


def _not_empty(path: FilePath, content: bytes) -> bytes:
    if not content:
        raise input_error(path, "the file is empty", "write or copy it again")
    return content


def check_head(path: FilePath, head: bytes, kind: str) -> None:
    """Refuse a file whose first bytes are not those of its kind."""
    found = content_kind(head)
    if found != kind:
        problem = f"is not {with_article(kind)}, it looks like {with_article(found)}"
        raise input_error(path, problem, _fix_for(found))


def with_article(kind: str) -> str:
    """The name of a kind with its indefinite article."""
    return f"an {kind}" if kind.startswith(("u", "Arrow", "HDF5", "SQLite")) else f"a {kind}"


def _fix_for(kind: str) -> str:
    if kind in _USUAL_SUFFIX:
        return f"if it is one, rename it to end in {_USUAL_SUFFIX[kind]}"
    return "save it as UTF-8 text" if kind == UTF16 else "give a point cloud file"
