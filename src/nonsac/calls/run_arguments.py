"""What `verify` and `localize` have in common: where they write, and how they run."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nonsac.files.errors import FilePath, input_error
from nonsac.files.identity import identity_of
from nonsac.method.settings import Settings
from nonsac.running.executors import Workers, parsed
from nonsac.seeds import canonical_seed
from nonsac.values.checks import file_name, flag
from nonsac.values.numeric import shown

Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class RunArguments:
    """Checked when this is made; a ValueError or TypeError names what is wrong."""

    output: FilePath
    pairs: FilePath | None
    workers: Workers
    resume: bool
    overwrite: bool
    progress: Progress | None

    def __post_init__(self) -> None:
        file_name("output", self.output)
        if self.pairs is not None:
            file_name("pairs", self.pairs)
        flag("resume", self.resume)
        flag("overwrite", self.overwrite)
        parsed(self.workers)
        if self.progress is not None and not callable(self.progress):
            raise TypeError(f"progress must be a function of (done, total), or None, got {shown(self.progress)}")

    @property
    def journal(self) -> Path:
        """What is done is kept there."""
        return Path(f"{self.output}.partial")

    def tell(self, done: int, total: int) -> None:
        """Tell how far the run is."""
        if self.progress is not None:
            self.progress(done, total)


def settings_of_each(call: str, settings: dict[str, Any], noise: float | None) -> dict[str, Any]:
    """The settings of each pair or image, checked; without a noise, unless one is given."""
    Settings.of(call, settings | {"noise": noise})
    own = settings | {"rng": canonical_seed(settings.get("rng", 0))}
    return own if noise is None else own | {"noise": noise}


def check_no_input(output: FilePath, inputs: Iterable[object]) -> None:
    """Raise InputError if the output would replace a file that is read; what is no path is passed over."""
    target = identity_of(output)
    for path in inputs:
        if isinstance(path, (str, os.PathLike)) and identity_of(path) == target:
            raise input_error(output, "is read by this run, and would be replaced", "give the output another name")


def digest_of(*facts: object) -> str:
    """A short text that differs if any of these do."""
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:16]


def versions_of(paths: Iterable[FilePath]) -> list[tuple[str, int, int]]:
    """Name, size and time of change of files, and of those in folders."""
    files = [file for path in map(Path, paths) for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
    return [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files]
