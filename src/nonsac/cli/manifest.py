"""What `nonsac batch` reads: a row for each pair, whose columns are named as the arguments and options are."""

from __future__ import annotations

import csv
import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from nonsac.calls.registry import CALLS, Call
from nonsac.cli.inputs import image_of
from nonsac.cli.options import camera_of
from nonsac.files.content import check_regular
from nonsac.values.numeric import printable

if TYPE_CHECKING:
    from nonsac.calls.jobs import Job

_SUFFIXES = (".csv", ".jsonl")
_ONE_OBJECT = "write one object of names, and strings or numbers, in a line"


def columns_of(call: Call) -> tuple[str, ...]:
    """The columns that rows of a call may have."""
    return (*call.files, *call.more_files, *call.images, *call.cameras, *(n for n in call.texts if n not in _SET_HERE))


_SET_HERE = ("workers",)
_BY_COMMAND = {call.command: call for call in CALLS.values()}
_COLUMNS = ("name", "call", "scene", *dict.fromkeys(column for call in CALLS.values() for column in columns_of(call)))


@dataclass(frozen=True)
class Manifest:
    """Jobs in a file: CSV with a header, or JSON lines.

    Every row is checked when this is made, and read again as its job is needed. `scenes` are those of rows that name
    one, and no noise, by their numbers.
    """

    path: Path
    call: str | None
    count: int
    digest: str
    calls: frozenset[str]
    scenes: dict[int, str]

    @classmethod
    def read(cls, path: Path, call: str | None) -> Manifest:
        """Check all rows; a ValueError names the line that is wrong, and how."""
        scenes, calls, count = {}, set(), 0
        for number, (job, scene) in enumerate(_jobs(path, call)):
            calls.add(job.call.replace("_", "-"))
            count += 1
            if scene and "noise" not in job.settings:
                scenes[number] = scene
        if not count:
            raise ValueError(f"{path}: holds no pairs; write one in each line")
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        return cls(path, call, count, digest, frozenset(calls), scenes)

    def jobs(self) -> Iterator[Job]:
        return (job for job, _ in _jobs(self.path, self.call))


def _jobs(path: Path, call: str | None) -> Iterator[tuple[Job, str]]:
    """The job of each row, and its scene, if it names one."""
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise ValueError(f"{path}: a manifest is {' or '.join(_SUFFIXES)}; end the name in one of these")
    check_regular(path)
    rows = _csv_rows(path) if suffix == ".csv" else _json_rows(path)
    for number, (line, row) in enumerate(rows, 1):
        try:
            yield _job(row, path.parent, call, str(number))
        except (ValueError, typer.BadParameter) as error:
            raise ValueError(printable(f"{path}, line {line}: {error}")) from error


def _csv_rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = csv.DictReader(file, restval="")
        try:
            names = [name.strip().replace("-", "_") for name in rows.fieldnames or ()]
            if twice := [name for name in names if names.count(name) > 1]:
                raise ValueError(f"{path}, line 1: names the column {twice[0]!r} twice; keep one of them")
            for row in rows:
                if None in row:
                    raise ValueError(f"{path}, line {rows.line_num}: has more cells than the header has names")
                yield rows.line_num, row
        except (csv.Error, UnicodeDecodeError) as error:
            raise ValueError(f"{path}, line {rows.line_num}: is no CSV ({error})") from error


def _json_rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    with path.open("rb") as file:
        for line, text in enumerate(file, 1):
            if not text.strip():
                continue
            try:
                row = json.loads(text)
            except RecursionError:
                raise ValueError(f"{path}, line {line}: is nested too deeply; {_ONE_OBJECT}") from None
            except ValueError as error:
                raise ValueError(f"{path}, line {line}: is no JSON ({error})") from error
            if not isinstance(row, dict) or any(isinstance(cell, (dict, list, bool)) for cell in row.values()):
                raise ValueError(f"{path}, line {line}: {_ONE_OBJECT}")
            yield line, {name: "" if cell is None else str(cell) for name, cell in row.items()}


def _job(row: dict[str, str], folder: Path, default: str | None, number: str) -> tuple[Job, str]:
    from nonsac.calls.jobs import Job

    cells = {name.strip().replace("-", "_"): cell.strip() for name, cell in row.items()}
    if unknown := [name for name in cells if name not in _COLUMNS]:
        raise ValueError(f"there is no column {unknown[0]!r}; the columns are {', '.join(_COLUMNS)}")
    given = {name: cell for name, cell in cells.items() if cell}
    name, call = given.pop("name", number), given.pop("call", default or "").replace("_", "-")
    scene = given.pop("scene", "")
    if call not in _BY_COMMAND:
        needs = (
            f"the call {call!r} is none of"
            if call
            else "names no call: fill the column 'call', or give --call, with one of"
        )
        raise ValueError(f"{needs} {', '.join(_BY_COMMAND)}")
    chosen = _BY_COMMAND[call]
    if scene and "noise" not in chosen.settings:
        raise ValueError(f"{call} is given no noise, so that there is none to share: leave its 'scene' empty")
    if missing := [file for file in chosen.files if file not in given]:
        raise ValueError(f"{call} needs a file in the column {missing[0]!r}")
    if wrong := [column for column in given if column not in columns_of(chosen)]:
        raise ValueError(f"{call} has no {wrong[0]!r}; it has {', '.join(columns_of(chosen))}")
    files = [str(folder / given.pop(file)) for file in (*chosen.files, *chosen.more_files) if file in given]
    settings = {chosen.texts.get(column, column): _cell(chosen, column, text, folder) for column, text in given.items()}
    return Job(chosen.name, *files, name=name, **settings), scene


def _cell(call: Call, column: str, text: str, folder: Path) -> Any:
    try:
        if column in call.images:
            return image_of(text)
        return _camera(text, folder) if column in call.cameras else call.read(call.texts[column], text)
    except (ValueError, typer.BadParameter) as error:
        raise ValueError(f"{column}: {str(error).removeprefix(f'{column} ')}") from error


@lru_cache(256)
def _camera(text: str, folder: Path) -> Any:
    """Many pairs share one."""
    file = folder / text
    return camera_of(str(file) if os.path.isfile(file) else text)
