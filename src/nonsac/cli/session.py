"""While a command runs: warnings, a note on compiling, and a progress bar, all on stderr."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from nonsac.cli.messages import to_stderr

Progress = Callable[[int, int], None]


@contextmanager
def session(quiet: bool, unit: str) -> Iterator[Progress]:
    """Tell of warnings, compiling and progress on stderr."""
    with warnings.catch_warnings(), compiling_noted(quiet), progress_bar(quiet, unit) as progress:
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = lambda message, *_: to_stderr(f"warning: {message}")
        yield progress


@contextmanager
def compiling_noted(quiet: bool) -> Iterator[None]:
    """Say once that kernels are compiled, if any is: one that numba finds in its cache is not."""
    from numba.core import event

    class Listener(event.Listener):
        told = quiet

        def on_start(self, event: object) -> None:
            if not self.told:
                self.told = True
                to_stderr("compiling kernels (first run only) ...")

        def on_end(self, event: object) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield


@contextmanager
def progress_bar(quiet: bool, unit: str) -> Iterator[Progress]:
    if quiet or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich import progress as parts
    from rich.console import Console

    numbers = parts.MofNCompleteColumn(), parts.TimeElapsedColumn()
    columns = parts.TextColumn(unit), parts.BarColumn(), *numbers, parts.TimeRemainingColumn(), parts.TextColumn("left")
    with parts.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(unit, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
