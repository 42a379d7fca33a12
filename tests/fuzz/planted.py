"""Kinds of input that fail on purpose, each in its own way: what the fuzzer has to see."""

from __future__ import annotations

import os
import threading
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import nonsac
from fuzz.formats import Format

_NUMBER = 3  # of the input that fails; the others are read
_kept: list[Any] = []


def _format(fail: Any) -> Format:
    def read(folder: Path) -> None:
        if (folder / "a.txt").read_bytes() == b"3":
            fail(folder / "a.txt")

    return _Numbered(lambda: [{"a.txt": b"whole"}], [read])


class _Numbered(Format):
    def files(self, name: str, seed: int, number: int) -> dict[str, bytes]:
        return {"a.txt": str(number).encode()}


def _raise(error: BaseException) -> None:
    raise error


def _taken_for_damage(path: Path) -> None:
    try:
        np.empty(10**15)
    except MemoryError:
        raise nonsac.InputError(f"{path}: is damaged; copy it again") from None


def _unclean(path: Path) -> None:
    error = nonsac.InputError("")
    error.args = (f"{path}: \x1b[2J",)  # which its own constructor would have escaped
    raise error


def _warned(path: Path) -> None:
    warnings.warn("overflow", RuntimeWarning, stacklevel=2)


def _ignored_in_a_destructor(path: Path) -> None:
    class Late:
        def __del__(self) -> None:
            raise OSError("late")

    Late()


PLANTED: dict[str, Format] = {
    "good": _format(lambda path: _raise(nonsac.InputError(f"{path}: is damaged; copy it again"))),
    "undocumented": _format(lambda path: _raise(KeyError(str(path)))),
    "panic": _format(lambda path: _raise(BaseException(str(path)))),
    "nameless": _format(lambda path: _raise(nonsac.InputError("is damaged"))),
    "control": _format(_unclean),
    "wrong": _format(lambda path: _raise(AssertionError("take and chunks differ"))),
    "warning": _format(_warned),
    "late": _format(_ignored_in_a_destructor),
    "refused-memory": _format(_taken_for_damage),
    "memory": _format(lambda path: np.ones(60 * 2**20).sum()),
    "hang": _format(lambda path: threading.Event().wait()),
    "busy": _format(lambda path: sum(1 for _ in iter(int, 1))),
    "death": _format(lambda path: os.abort()),
}
