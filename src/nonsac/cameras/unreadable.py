"""Cameras of files that cannot be read: no harm is done as long as another one takes their place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from nonsac.files.errors import InputError


@dataclass(frozen=True, eq=False)
class UnreadableCamera:
    """Stands for a camera that cannot be read; `nonsac.Camera.parse` raises its error."""

    error: InputError


def camera_or_error(read: Callable[[], Any]) -> Any:
    """What a reader returns, or an `UnreadableCamera` if it refuses the file."""
    try:
        return read()
    except InputError as error:
        return UnreadableCamera(error)


def check_readable(*cameras: object) -> None:
    """Raise the error of the first camera that cannot be read."""
    for camera in cameras:
        if isinstance(camera, UnreadableCamera):
            raise camera.error


def chosen_cameras(given: Sequence[Any], in_file: Sequence[Any]) -> list[Any]:
    """The cameras that the user gives, else those of the file.

    If images share a camera that cannot be read, the one that is given for the first image is that of the others, too.
    """
    chosen = []
    for mine, theirs in zip_longest(given, in_file):
        shared = isinstance(theirs, UnreadableCamera) and theirs is in_file[0]
        chosen.append(mine if mine is not None else given[0] if shared and given[0] is not None else theirs)
    return chosen
