"""All kinds of inputs, files and arguments alike: how input number n is made, and tried."""

from __future__ import annotations

import importlib.util
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fuzz import arguments, judge
from fuzz.folders import remove_files, write_files
from fuzz.formats import FORMATS, Format


class FileCase:
    """Files in a folder of their own, to be read."""

    def __init__(self, format: Format, folder: Path, files: dict[str, bytes]) -> None:
        self.format, self.folder, self.files = format, folder, files

    def run(self) -> judge.Failure | None:
        for read in self.format.reads:
            try:
                read(self.folder)
            except BaseException as error:
                failure = judge.judged(error, self.format.documented(), self._names(), hostile=True)
                if failure is not None:
                    return failure
        return None

    def _names(self) -> set[str]:
        return {str(self.folder), *(Path(name).parts[0] for name in self.files)}


class FileKind:
    """A kind of file."""

    def __init__(self, format: Format) -> None:
        self.format = format
        self.cost = format.cost
        self.missing = [library for library in format.needs if importlib.util.find_spec(library) is None]
        self.folder: Path | None = None

    def warm_up(self) -> None:
        """Read the whole files, which must succeed."""
        for files in self.format.seeds():
            for _ in range(2):
                with self._written(files) as case:
                    failure = case.run()
                if failure is not None:
                    raise RuntimeError(f"a whole file is not read: {failure}")

    @contextmanager
    def case(self, name: str, seed: int, number: int) -> Iterator[FileCase]:
        with self._written(self.format.files(name, seed, number)) as case:
            yield case

    @contextmanager
    def _written(self, files: dict[str, bytes]) -> Iterator[FileCase]:
        if self.folder is None:
            self.folder = Path(tempfile.mkdtemp())
        write_files(self.folder, files)
        try:
            yield FileCase(self.format, self.folder, files)
        finally:
            remove_files(self.folder)

    def may_warn(self, warning: warnings.WarningMessage) -> bool:
        return False

    def save(self, name: str, seed: int, number: int, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        write_files(folder, self.format.files(name, seed, number))

    def replayed(self, name: str, seed: int, number: int, folder: Path) -> FileCase:
        files = {str(path.relative_to(folder)): b"" for path in folder.rglob("*") if path.is_file()}
        return FileCase(self.format, folder, files)


KINDS: dict[str, Any] = {name: FileKind(format) for name, format in FORMATS.items()}
KINDS.update({name: arguments.CallKind(call) for name, call in arguments.CALLS.items()})


def kind_of(name: str) -> Any:
    """One of these kinds, or one that fails on purpose."""
    if name in KINDS:
        return KINDS[name]
    from fuzz.planted import PLANTED

    KINDS_ON_PURPOSE.setdefault(name, FileKind(PLANTED[name]))
    return KINDS_ON_PURPOSE[name]


KINDS_ON_PURPOSE: dict[str, Any] = {}
