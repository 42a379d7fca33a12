"""Which file a path stands for, whatever it is called: links of both kinds lead to the same one."""

from __future__ import annotations

import os

from nonsac.files.errors import FilePath


def identity_of(path: FilePath) -> object:
    """Equal for two paths if and only if they stand for one file; for a file that is not there yet, its real path."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):  # not there, or no possible name
        return os.path.realpath(os.fspath(path).replace("\0", ""))
    return status.st_dev, status.st_ino
