"""The error that users see when an input file cannot be used."""

from os import PathLike

FilePath = str | PathLike[str]


class InputError(ValueError):
    """An input file, or the place to write to, cannot be used; the message is one line naming the fix."""


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
    return InputError(" ".join(f"{path}: {problem}; {fix}".split()))
