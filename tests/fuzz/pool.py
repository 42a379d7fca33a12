"""Tries inputs in worker processes, and watches them: one that hangs or dies is reported, and the next takes over."""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import queue
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fuzz import cases, judge
from fuzz.worker import STATE

_BLOCK = 2.0  # seconds of a block of inputs, about
_PATIENCE = 300.0  # seconds for a worker to begin: kernels may have to be compiled
_MOST_DEATHS = 25  # of workers, by inputs of one kind; then this kind ends


@dataclass
class Report:
    """What was seen of one kind of input."""

    kind: str
    inputs: int = 0
    failures: dict[str, list[tuple[int, judge.Failure]]] = field(default_factory=dict)
    slowest: tuple[float, int] = (0.0, -1)
    largest: tuple[int, int] = (0, -1)
    deaths: int = 0
    seconds: float = 0.0

    def add(self, figures: tuple[int, float, int, int, int]) -> None:
        inputs, slowest, slowest_number, largest, largest_number = figures
        self.inputs += inputs
        self.slowest = max(self.slowest, (slowest, slowest_number))
        self.largest = max(self.largest, (largest, largest_number))

    def fail(self, number: int, failure: judge.Failure) -> None:
        self.failures.setdefault(failure.signature, []).append((number, failure))

    @property
    def failed(self) -> int:
        return sum(map(len, self.failures.values()))

    def __str__(self) -> str:
        seconds, slowest = self.slowest
        size, largest = self.largest
        figures = [
            f"{self.kind:32} {self.inputs:9,} inputs {self.failed:6,} failures",
            f"slowest {seconds:5.2f} s (#{slowest})",
            f"largest {size / 2**20:4.0f} MB (#{largest})",
            f"{self.seconds / max(1, self.inputs) * 1e3:6.2f} ms each",
        ]
        line = "  ".join(figures)
        return line + ("  ENDED EARLY" if self.deaths >= _MOST_DEATHS else "")


def fuzz(
    counts: Mapping[str, int],
    seed: int = 0,
    first: int = 0,
    workers: int = 2,
    tell: Callable[[Report, int, judge.Failure], object] = lambda report, number, failure: None,
) -> dict[str, Report]:
    """Try inputs `first` to `first + count - 1` of each kind; `tell` is called with every failure."""
    reports = {kind: Report(kind) for kind in counts}
    jobs: queue.SimpleQueue[tuple[str, int, int]] = queue.SimpleQueue()
    for kind, count in counts.items():
        block = max(1, min(4000, int(_BLOCK * 1000 / cases.kind_of(kind).cost)))
        for start in range(first, first + count, block):
            jobs.put((kind, start, min(start + block, first + count)))
    lock, errors = threading.Lock(), []

    def drive() -> None:
        try:
            with _Process() as process:
                while not errors:
                    kind, start, stop = jobs.get_nowait()
                    _run(process, reports[kind], seed, start, stop, lock, tell)
        except queue.Empty:
            pass
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=drive) for _ in range(workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]
    return reports


def _run(
    process: _Process,
    report: Report,
    seed: int,
    start: int,
    stop: int,
    lock: threading.Lock,
    tell: Callable[[Report, int, judge.Failure], object],
) -> None:
    def failed(number: int, failure: judge.Failure) -> None:
        with lock:
            report.fail(number, failure)
            tell(report, number, failure)

    began = time.monotonic()
    while start < stop and report.deaths < _MOST_DEATHS:
        figures, end = process.run(report.kind, seed, start, stop, failed)
        with lock:
            report.add(figures)
        if end is None:
            break
        number, failure = end
        if failure.kind == "hang" and not process.hangs(report.kind, seed, number):
            failure = None  # the machine was busy
        with lock:
            report.deaths += 1
        if failure is not None:
            failed(number, failure)
        start = number + 1
    with lock:
        report.seconds += time.monotonic() - began


class _Process:
    """A worker, started anew whenever it died."""

    def __init__(self) -> None:
        memory = Path("/dev/shm")
        self.parent = memory if memory.is_dir() and os.access(memory, os.W_OK) else Path(tempfile.gettempdir())
        self.process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> _Process:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def hangs(self, kind: str, seed: int, number: int) -> bool:
        """Whether an input takes too long a second time."""
        _, end = self.run(kind, seed, number, number + 1, lambda *_: None)
        return end is not None and end[1].kind == "hang"

    def run(
        self, kind: str, seed: int, start: int, stop: int, failed: Callable[[int, judge.Failure], object]
    ) -> tuple[tuple[int, float, int, int, int], tuple[int, judge.Failure] | None]:
        """The figures and, if the worker died, by which input, and how."""
        process = self._started()
        assert process.stdin is not None
        STATE.pack_into(self.state, 0, start, 0.0, 0, 0.0, -1, 0, -1)
        job = {"kind": kind, "seed": seed, "start": start, "stop": stop}
        process.stdin.write(json.dumps(job).encode() + b"\n")
        process.stdin.flush()
        begun, last = False, time.monotonic()
        while True:
            for event in self._events():
                last = time.monotonic()
                if event["event"] == "begin":
                    begun = True
                elif event["event"] == "failure":
                    failed(event["number"], judge.Failure(**event["failure"]))
                else:
                    return tuple(event["figures"]), None
            number, began, *figures = STATE.unpack_from(self.state)
            if process.poll() is not None:
                if not begun:
                    raise RuntimeError(f"no worker for {kind}: {self._said()}")
                figures[0] += 1
                return tuple(figures), (number, judge.Failure("crash", self._where(), self._how(process.returncode)))
            now = time.monotonic()
            if begun and began and now - began > judge.SECONDS + 0.5:
                process.send_signal(signal.SIGUSR1)  # it says where it is
                time.sleep(0.3)
                where = self._where()
                self._end()
                figures[0] += 1
                return tuple(figures), (number, judge.Failure("hang", where, f"more than {judge.SECONDS} s"))
            if not begun and now - last > _PATIENCE:
                raise RuntimeError(f"no worker for {kind}: it does not begin, {self._said()}")

    def _started(self) -> subprocess.Popen[bytes]:
        if self.process is not None and self.process.poll() is None:
            return self.process
        self._end()
        self.folder = Path(tempfile.mkdtemp(prefix="nonsac-fuzz-", dir=self.parent))
        with open(self.folder / "state", "w+b") as file:
            file.truncate(STATE.size)
            self.state = mmap.mmap(file.fileno(), STATE.size)
        self.stderr = open(self.folder / "stderr", "w+b")  # noqa: SIM115 (the worker writes to it)
        command = [sys.executable, str(Path(__file__).with_name("worker.py")), str(self.folder)]
        environment = os.environ | {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        environment |= {"MALLOC_ARENA_MAX": "2", "RUST_BACKTRACE": "0", "MPLBACKEND": "agg"}
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.stderr, env=environment
        )
        self.rest = b""
        return self.process

    def _events(self) -> list[dict]:
        assert self.process is not None
        assert self.process.stdout is not None
        if not select.select([self.process.stdout], [], [], 0.1)[0]:
            return []
        self.rest += os.read(self.process.stdout.fileno(), 2**20)
        *lines, self.rest = self.rest.split(b"\n")
        return [json.loads(line) for line in lines]

    def _said(self) -> str:
        self.stderr.seek(0)
        return self.stderr.read()[-3000:].decode(errors="replace")

    def _where(self) -> str:
        """The last line of the package in the trace that the worker left."""
        said = self._said()
        trace = said[max(said.rfind("most recent call first"), 0) :]
        lines = [line.strip() for line in trace.splitlines() if "nonsac/" in line and "/fuzz/" not in line]
        return lines[0].replace('File "', "").replace('"', "").rpartition("nonsac/")[2] if lines else ""

    def _how(self, code: int) -> str:
        said = [
            line for line in self._said().splitlines() if line.strip() and not line.startswith(("  File", "Extension"))
        ]
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return f"{name}: {' | '.join(said[-4:])[:300]}"

    def _end(self) -> None:
        if self.process is None:
            return
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError):  # what was not written to it is lost
                pipe.close()
        self.stderr.close()
        self.state.close()
        shutil.rmtree(self.folder, ignore_errors=True)
        self.process = None
