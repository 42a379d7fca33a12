"""The error that users see when an input file cannot be used."""

import os
from collections.abc import Sequence
from os import PathLike

from nonsac.values.numeric import printable

FilePath = str | PathLike[str]
_NAMES_SHOWN = 4
_LETTERS_SHOWN = 300


class InputError(ValueError):
    """An input file, or the place to write to, cannot be used; the message is one line naming the fix."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def input_error(path: FilePath, problem: str, fix: str) -> InputError:
    """Build the one-line error ``path: problem; fix``.

    Parameters
    ----------
    path
        The file at fault.
    problem
        What is wrong with it.
    fix
        What the user most likely has to do.

    Returns
    -------
    InputError
        The error, for the caller to raise.
    """
    name = os.fspath(path).replace("\0", "\\0")
    if len(name) > _LETTERS_SHOWN:
        name = f"{name[: _LETTERS_SHOWN // 2]}...{name[-_LETTERS_SHOWN // 2 :]}"
    return InputError(f"{name}: {problem}; {fix}")


def library_missing(path: FilePath, files: str, library: str, extra: str) -> InputError:
    """Say which library the reading of such files needs, and how to install it."""
    return input_error(path, f"reading {files} needs {library}", f'pip install "nonsac[{extra}]"')


def not_held(path: FilePath, wanted: str, names: Sequence[str], shown: int = _NAMES_SHOWN) -> InputError:
    """Say that a file does not hold what was asked for by name, and name a few that it holds.

    Parameters
    ----------
    path
        The file.
    wanted
        What was asked for, such as ``image 'a.jpg'``.
    names
        What it holds instead, in the order of the file.
    shown
        How many of these the message lists.

    Returns
    -------
    InputError
        The error, for the caller to raise.
    """
    held = ", ".join(names[:shown]) or "none"
    if len(names) > shown:
        held += f" and {len(names) - shown} more"
    return input_error(path, f"holds no {wanted} (it holds {held})", "check the name")


def in_one_line(error: Exception) -> str:
    """What an exception says, for a record; its kind, too, if it is not about input."""
    told = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    return " ".join(told.split())
