"""Finished trials on disk, so that a run that was stopped can go on from there."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

from nonsac.reproduce.cells import Trial
from nonsac.running import journal

__all__ = ["Journal"]


class Journal:
    """What is done of a run; a context manager that closes the file.

    Parameters
    ----------
    path : path-like or None
        As in `nonsac.running.journal.Journal`; None keeps nothing.
    settings, resume
        As there.

    Raises
    ------
    ValueError
        As there.
    """

    def __init__(self, path: str | os.PathLike[str] | None, settings: Mapping[str, Any], resume: bool = False) -> None:
        self.trials: dict[int, Trial] = {}
        self._journal: journal.Journal | None = None
        if path is not None:
            self._journal = journal.Journal(path, settings, resume, "trials", self._remember)

    def add(self, position: int, trial: Trial) -> None:
        """Keep a finished trial."""
        self.trials[position] = trial
        if self._journal is not None:
            self._journal.add(position, [trial.errors, trial.seconds, trial.claimed])

    def _remember(self, position: int, record: Any) -> None:
        trial = Trial(*({int(m): value for m, value in part.items()} for part in record))
        errors = [error for by_rule in trial.errors.values() for error in by_rule.values()]
        if not all(isinstance(error, float) for error in errors):
            raise TypeError("a trial")
        self.trials[position] = trial

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._journal is not None:
            self._journal.__exit__(kind, error, trace)
