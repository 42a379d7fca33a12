"""What `verify` and `localize` have in common: where they write, and how they run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nonsac.files.errors import FilePath
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
