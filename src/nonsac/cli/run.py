"""One flow for all calls: check, open, estimate, show, write."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nonsac.calls.registry import Call
from nonsac.cli.messages import to_stderr
from nonsac.cli.outputs import Draw, Outputs, exit_code, show
from nonsac.cli.session import session

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from nonsac.io import Opened
    from nonsac.layouts import Array
    from nonsac.result import Result

_DRAWN, _LOOKED_AT = (5000, 8), (1000, 1)  # rows, of so many blocks


@dataclass(frozen=True)
class Options:
    """What every command has: the settings of its call, and how it talks."""

    settings: dict[str, Any]
    outputs: Outputs
    as_json: bool
    quiet: bool

    @property
    def silent(self) -> bool:
        """Whether stdout is for the result alone, so that no file is mentioned there that was written."""
        return self.as_json or self.quiet


class Flow(ABC):
    """What a command does in its own way."""

    @abstractmethod
    def inputs(self) -> Iterable[tuple[str, str | Path | None]]:
        """The files that are read, and how they are called on the command line: none is to be overwritten."""

    @abstractmethod
    def open(self) -> tuple[Any, ...]:
        """What the call takes first."""

    @abstractmethod
    def described(self, result: Result) -> tuple[str, dict[str, Any]]:
        """What is printed of a result, and what its JSON holds besides."""

    def check(self) -> None:
        """Refuse what does not go together, before anything is read."""
        return None

    def drawing(self, result: Result) -> Draw | None:
        """What draws a result; None if there is nothing to draw."""
        return None

    def finish(self, result: Result) -> None:
        """Write what other commands do not write."""
        return None

    @contextmanager
    def estimating(self) -> Iterator[None]:
        """Around the call itself."""
        yield


def run(flow: Flow, call: Call, options: Options) -> None:
    """Run a command to its exit code."""
    options.outputs.check(flow.inputs())
    flow.check()
    with session(options.quiet, "samples") as progress:
        data = flow.open()
        with flow.estimating():
            result = call.function(*data, **options.settings, progress=progress)
    show(result, *flow.described(result), options.as_json)
    draw = None if options.outputs.picture is None else flow.drawing(result)
    options.outputs.write(result, draw, options.silent)
    flow.finish(result)
    raise exit_code(result)


class SomeRows:
    """The rows of a source that are drawn, if there is a picture, or looked at; all, if they are in memory or few."""

    def __init__(self, opened: Opened, picture: Path | None) -> None:
        from nonsac.calls.rows import spread_rows

        self.source, self.picture = opened.source, picture
        wanted = _LOOKED_AT if picture is None else _DRAWN
        if opened.source.about.in_memory or (picture is not None and opened.is_small):
            wanted = len(opened.source), len(opened.source)
        self.places: NDArray[np.int64] = spread_rows(opened.source, *wanted)
        self.rows: Array = opened.source.take(self.places)

    def seen(self, result: Result) -> Result:
        """The result, with residuals and inliers of these rows."""
        from nonsac.result import Evidence
        from nonsac.sources import ArraySource

        if result.evidence is None or result.evidence.source is None:
            return result
        rows = ArraySource(result.evidence.source.take(self.places))
        return replace(result, evidence=Evidence(result.evidence.problem, rows))

    def note_share(self, quiet: bool) -> None:
        """Say if a picture does not show all."""
        if self.picture is not None and len(self.source) > len(self.places) and not quiet:
            to_stderr(f"{self.picture} shows {len(self.places):,} of {len(self.source):,} rows")
