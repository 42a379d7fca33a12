"""All kinds of inputs, files and arguments alike: how input number n is made, and tried."""

from __future__ import annotations

import importlib.util
import os
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fuzz import arguments, judge
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
                failure = judge.judged(error, self.format.documented(), (*self._names(), str(self.folder)))
                if failure is not None:
                    return failure
        return None

    def _names(self) -> set[str]:
        return {Path(name).parts[0] for name in self.files}


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


def write_files(folder: Path, files: dict[str, bytes]) -> None:
    root, made = str(folder), set()
    for name, content in files.items():
        parent = os.path.dirname(name)
        if parent and parent not in made:
            os.makedirs(os.path.join(root, parent), exist_ok=True)
            made.add(parent)
        with open(os.path.join(root, name), "wb", buffering=0) as file:
            file.write(content)


def remove_files(folder: Path) -> None:
    for entry in os.scandir(folder):
        if entry.is_dir(follow_symlinks=False):
            remove_files(Path(entry.path))
            os.rmdir(entry.path)
        else:
            os.unlink(entry.path)


KINDS: dict[str, Any] = {name: FileKind(format) for name, format in FORMATS.items()}
KINDS.update({name: arguments.CallKind(call) for name, call in arguments.CALLS.items()})
