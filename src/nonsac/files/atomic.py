"""Write files so that a reader sees either the old content or the whole new one."""

import os
import secrets
from collections.abc import Callable
from pathlib import Path

from nonsac.files.content import check_name
from nonsac.files.errors import FilePath, input_error


def write_atomically(path: FilePath, writer: Callable[[Path], object]) -> None:
    """Write a file through a temporary file in the same folder.

    Parameters
    ----------
    path
        The file to write. A symbolic link is followed.
    writer
        Called with the path of the temporary file, which has the suffix of `path`; it must write that file.

    Raises
    ------
    InputError
        If the folder is missing, the target is not a regular file, or the system refuses to write.
    """
    check_target(path)
    target = Path(os.path.realpath(path))
    # Not from tempfile: it would give the final file the mode 0600 instead of the user's umask.
    temporary = target.with_name(f".nonsac-{secrets.token_hex(8)}{target.suffix}")
    try:
        writer(temporary)
        _flush_to_disk(temporary)
        os.replace(temporary, target)
    except OSError as error:
        problem = f"cannot be written ({error.strerror or error})"
        raise input_error(path, problem, "check the folder and its free space") from error
    finally:
        temporary.unlink(missing_ok=True)


def check_target(path: FilePath) -> None:
    """Check that a file can be written, before the work whose result it is to hold.

    Raises
    ------
    InputError
        If the folder is missing or write-protected, the target is not a regular file, or its name cannot be one.
    """
    check_name(path)
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise input_error(path, f"the folder {target.parent} does not exist", "create it first")
    if target.exists() and not target.is_file():
        raise input_error(path, "is a folder or a device, not a file", "give the name of a file")
    if not os.access(target.parent, os.W_OK):
        raise input_error(path, f"the folder {target.parent} is write-protected", "choose another one")


def _flush_to_disk(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())
