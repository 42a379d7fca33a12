"""Finished trials on disk, one line each, so that a run that was stopped can go on from there."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TextIO

from nonsac.reproduce.cells import Trial

__all__ = ["Journal"]


class Journal:
    """What is done of a run; a context manager that closes the file.

    Parameters
    ----------
    path : path-like or None
        Of the file, which may exist from a run that was stopped; None keeps nothing.
    settings : dict
        What the trials depend on, ready for JSON; must be the same when a run goes on.
    resume : bool
        Whether to go on where the file ends. Without it, a file that is there is refused rather than lost.

    Raises
    ------
    ValueError
        If the file is there and `resume` is not set, or it comes from other settings.
    """

    def __init__(self, path: str | os.PathLike[str] | None, settings: Mapping[str, Any], resume: bool = False) -> None:
        self.trials: dict[int, Trial] = {}
        self._path = None if path is None else Path(path)
        self._file: TextIO | None = None
        if self._path is None:
            return
        header = (json.dumps({"settings": settings}) + "\n").encode()
        content = self._path.read_bytes() if self._path.exists() else b""
        if header.startswith(content):  # nothing there, or killed while it wrote the first line
            self._file = self._path.open("w", encoding="utf-8", newline="\n")
            self._file.write(header.decode())
            self._file.flush()
            return
        whole = content[: content.rfind(b"\n") + 1]  # the last line is torn where the run was killed
        before, trials = _parsed(self._path, whole)
        if not resume:
            raise ValueError(
                f"{self._path} is left from a run that was stopped, with {len(trials)} trials done; "
                "go on there with resume (--resume), or remove it"
            )
        _check_settings(self._path, before, json.loads(header)["settings"])
        self.trials = trials
        os.truncate(self._path, len(whole))
        self._file = self._path.open("a", encoding="utf-8", newline="\n")

    def add(self, position: int, trial: Trial) -> None:
        """Keep a finished trial."""
        self.trials[position] = trial
        if self._file is not None:
            self._file.write(_line(position, trial))
            self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()


def _line(position: int, trial: Trial) -> str:
    return json.dumps([position, trial.errors, trial.seconds, trial.claimed]) + "\n"


def _parsed(path: Path, content: bytes) -> tuple[Mapping[str, Any], dict[int, Trial]]:
    """The settings and the finished trials of a journal."""
    try:
        header, *lines = content.decode().splitlines()
        settings = json.loads(header)["settings"]
        if not isinstance(settings, dict):
            raise TypeError("settings")
        return settings, dict(map(_read, lines))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"{path} is not a record of a run; remove it, or choose another name") from error


def _read(line: str) -> tuple[int, Trial]:
    position, *parts = json.loads(line)
    trial = Trial(*({int(m): value for m, value in part.items()} for part in parts))
    errors = [error for by_rule in trial.errors.values() for error in by_rule.values()]
    if not isinstance(position, int) or not all(isinstance(error, float) for error in errors):
        raise TypeError("a trial")
    return position, trial


def _check_settings(path: Path, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    for key in {**before, **now}:
        if before.get(key) != now.get(key):
            raise ValueError(
                f"{path} is of a run with {key} {before.get(key)!r}, not {now.get(key)!r}; "
                "resume with the settings of that run, or remove the file"
            )
