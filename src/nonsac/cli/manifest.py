"""What `nonsac batch` reads: a row for each pair, whose columns are named as the arguments and options are."""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from nonsac.cli.inputs import image_of
from nonsac.cli.options import LastFit, camera_of, count_from, count_of, memory, positive, scale, scale_of

if TYPE_CHECKING:
    from nonsac.calls.jobs import Job

Cell = Callable[[str], Any]
_SUFFIXES = (".csv", ".jsonl")


def _number(least: int) -> Cell:
    def read(text: str) -> int:
        if not (text.isdecimal() and int(text) >= least):
            raise ValueError(f"{text!r} is not a whole number of at least {least}")
        return int(text)

    return read


def _positive(text: str) -> float | None:
    try:
        return positive(float(text))
    except ValueError:
        raise ValueError(f"{text!r} is not a positive number") from None


def _count(least: int) -> Cell:
    return lambda text: count_of(count_from(least)(text))


def _last_fit(text: str) -> str:
    try:
        return LastFit(text).value
    except ValueError:
        raise ValueError(f"{text!r} is not one of {', '.join(LastFit)}") from None


_SEARCH: dict[str, Cell | None] = {
    "max_samples": _number(1),
    "time_limit": _positive,
    "max_memory": memory,
    "refine": _last_fit,
    "seed": _number(0),
}
_PAIR = {"image1": image_of, "image2": image_of, "camera1": None, "camera2": None}


@dataclass(frozen=True)
class Call:
    """The files that a call needs, those that it may have, and what may be set; each in a column of this name."""

    files: tuple[str, ...]
    more_files: tuple[str, ...]
    settings: dict[str, Cell | None]  # None: a camera

    @property
    def columns(self) -> tuple[str, ...]:
        return (*self.files, *self.more_files, *self.settings)


CALLS = {
    "relative-pose": Call(
        ("matches",),
        ("second",),
        {**_PAIR, "noise": _positive, "samples": _count(1), "sample_size": _count(5), **_SEARCH},
    ),
    "absolute-pose": Call(
        ("points",),
        (),
        {
            "image": image_of,
            "camera": None,
            "noise": _positive,
            "samples": _count(1),
            "sample_size": _count(3),
            **_SEARCH,
        },
    ),
    "register-pairs": Call(
        ("pairs",),
        ("second",),
        {
            "noise": _positive,
            "scale": lambda text: scale_of(scale(text)),
            "samples": _count(1),
            "sample_size": _count(3),
            **_SEARCH,
        },
    ),
    "register-clouds": Call(
        ("source", "target"),
        (),
        {"samples": _number(1), "sample_size": _number(3), "seed": _number(0)},
    ),
}
_COLUMNS = ("name", "call", *dict.fromkeys(column for call in CALLS.values() for column in call.columns))


@dataclass(frozen=True)
class Manifest:
    """Jobs in a file: CSV with a header, or JSON lines.

    Every row is checked when this is made, and read again as its job is needed.
    """

    path: Path
    call: str | None
    count: int
    digest: str
    calls: frozenset[str]

    @classmethod
    def read(cls, path: Path, call: str | None) -> Manifest:
        """Check all rows; a ValueError names the line that is wrong, and how."""
        jobs = list(map(_call_of, _jobs(path, call)))
        if not jobs:
            raise ValueError(f"{path}: holds no pairs; write one in each line")
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        return cls(path, call, len(jobs), digest, frozenset(jobs))

    def jobs(self) -> Iterator[Job]:
        return _jobs(self.path, self.call)


def _call_of(job: Job) -> str:
    return job.call.replace("_", "-")


def _jobs(path: Path, call: str | None) -> Iterator[Job]:
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise ValueError(f"{path}: a manifest is {' or '.join(_SUFFIXES)}; end the name in one of these")
    rows = _csv_rows(path) if suffix == ".csv" else _json_rows(path)
    for number, (line, row) in enumerate(rows, 1):
        try:
            yield _job(row, path.parent, call, str(number))
        except (ValueError, typer.BadParameter) as error:
            raise ValueError(f"{path}, line {line}: {error}") from error


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
            except ValueError as error:
                raise ValueError(f"{path}, line {line}: is no JSON ({error})") from error
            if not isinstance(row, dict) or any(isinstance(cell, (dict, list, bool)) for cell in row.values()):
                raise ValueError(f"{path}, line {line}: write one object of names, and strings or numbers, in a line")
            yield line, {name: "" if cell is None else str(cell) for name, cell in row.items()}


def _job(row: dict[str, str], folder: Path, default: str | None, number: str) -> Job:
    from nonsac.calls.jobs import Job

    cells = {name.strip().replace("-", "_"): cell.strip() for name, cell in row.items()}
    if unknown := [name for name in cells if name not in _COLUMNS]:
        raise ValueError(f"there is no column {unknown[0]!r}; the columns are {', '.join(_COLUMNS)}")
    given = {name: cell for name, cell in cells.items() if cell}
    name, call = given.pop("name", number), given.pop("call", default or "").replace("_", "-")
    if call not in CALLS:
        needs = (
            f"the call {call!r} is none of"
            if call
            else "names no call: fill the column 'call', or give --call, with one of"
        )
        raise ValueError(f"{needs} {', '.join(CALLS)}")
    chosen = CALLS[call]
    if missing := [file for file in chosen.files if file not in given]:
        raise ValueError(f"{call} needs a file in the column {missing[0]!r}")
    if wrong := [column for column in given if column not in chosen.columns]:
        raise ValueError(f"{call} has no {wrong[0]!r}; it has {', '.join(chosen.columns)}")
    files = [str(folder / given.pop(file)) for file in (*chosen.files, *chosen.more_files) if file in given]
    settings = {column: _cell(column, text, chosen.settings[column], folder) for column, text in given.items()}
    if "seed" in settings:
        settings["rng"] = settings.pop("seed")
    return Job(call.replace("-", "_"), *files, name=name, **settings)


def _cell(column: str, text: str, read: Cell | None, folder: Path) -> Any:
    try:
        return _camera(text, folder) if read is None else read(text)
    except (ValueError, typer.BadParameter) as error:
        raise ValueError(f"{column}: {error}") from error


@lru_cache(256)
def _camera(text: str, folder: Path) -> Any:
    """Many pairs share one."""
    file = folder / text
    return camera_of(str(file) if file.is_file() else text)
