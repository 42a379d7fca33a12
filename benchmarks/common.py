"""What the benchmarks share: calls with a time limit, the machine they ran on, their JSON files and pages."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

RESULTS = Path(__file__).parent / "results"

_PACKAGES = (
    "nonsac",
    "numpy",
    "scipy",
    "numba",
    "open3d",
    "kiss_matcher",
    "small_gicp",
    "poselib",
    "pycolmap",
    "opencv-python-headless",
)


@dataclass(frozen=True)
class Call:
    """What came of a call: its value, or why there is none.

    `megabytes` is the peak of the process' memory during the call above its level before; NaN where the system does
    not tell.
    """

    value: Any
    seconds: float
    megabytes: float
    error: str = ""


class Worker:
    """Calls functions in a process of its own: it can be stopped, and its memory and threads disturb nobody else.

    The warm-up, a first call that is not reported, runs whenever the process starts.
    """

    def __init__(self, warm_up: Callable[[], object], limit: float) -> None:
        self._warm_up = warm_up
        self._limit = limit
        self._start()

    def call(self, function: Callable[..., Any], *arguments: Any) -> Call | None:
        """The call, or None where it took longer than the limit."""
        self._connection.send((function, arguments))
        if not self._connection.poll(self._limit):
            self.close()
            self._start()
            return None
        return self._connection.recv()

    def close(self) -> None:
        self._process.kill()
        self._process.join()

    def _start(self) -> None:
        context = get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, self._warm_up), daemon=True)
        self._process.start()
        other.close()
        self._connection.recv()  # the warm-up has ended


def _serve(connection: Connection, warm_up: Callable[[], object]) -> None:
    warm_up()
    connection.send(None)
    while True:
        try:
            function, arguments = connection.recv()
        except EOFError:
            return
        connection.send(_timed(function, arguments))


def _timed(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Call:
    before = _restart_peak()
    value, error = None, ""
    start = time.perf_counter()
    try:
        value = function(*arguments)
    except Exception as problem:  # a method that crashes has failed at this trial, not ended the benchmark
        error = f"{type(problem).__name__}: {problem}"
    seconds = time.perf_counter() - start
    return Call(value, seconds, _memory("VmHWM") - before, error)


def _restart_peak() -> float:
    """Reset the process' peak memory (Linux) and return what it holds now, in MB."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return float("nan")
    return _memory("VmRSS")


def _memory(field: str) -> float:
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return float("nan")
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(field + ":"))


def installed(module: str) -> bool:
    return find_spec(module) is not None


def median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None


def say(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


def write(path: Path, benchmark: str, **content: Any) -> None:
    """Write one benchmark's JSON: what was run, where, with which versions, and what came out."""
    head = {
        "benchmark": benchmark,
        "command": " ".join(["python", f"benchmarks/{Path(sys.argv[0]).name}", *map(_without_folders, sys.argv[1:])]),
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "commit": _COMMIT,
        "machine": machine(),
        "versions": {"python": platform.python_version()} | {name: _version(name) for name in _PACKAGES},
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(head | content, indent=1) + "\n")
    say(f"wrote {path.name}")


def renewed(page: str, begin: str, end: str, block: str) -> str:
    """A page with another block between the two markers."""
    head, rest = page.split(begin)
    return f"{head}{begin}\n\n{block}\n\n{end}{rest.split(end, 1)[1]}"


def commit() -> str:
    """The commit that was measured, with a plus where the sources differed from it."""
    return _git("rev-parse", "--short", "HEAD") + ("+" if _git("status", "--porcelain", "src") else "")


def _git(*arguments: str) -> str:
    found = subprocess.run(["git", *arguments], cwd=RESULTS.parents[1], capture_output=True, text=True, check=False)
    return found.stdout.strip()


# Asked at the start: the sources may be edited while a long benchmark runs.
_COMMIT = commit()


def machine() -> dict[str, Any]:
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_gb": _total_memory(),
        "system": platform.system(),
    }


def _without_folders(argument: str) -> str:
    """An argument without the place where this machine keeps its files."""
    return Path(argument).name if Path(argument).is_absolute() else argument


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def _total_memory() -> int | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30)
    except (AttributeError, ValueError, OSError):
        return None
