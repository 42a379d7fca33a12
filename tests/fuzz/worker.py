"""A process that tries inputs, one after the other; it may be killed by one of them, and leaves word which it was."""

from __future__ import annotations

import faulthandler
import gc
import json
import mmap
import os
import re
import resource
import shutil
import struct
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fuzz import cases, judge

# Number of the input; when it began, 0 between inputs; how many were tried; the slowest and the largest, with numbers.
STATE = struct.Struct("<qdqdqqq")
_SLACK = 768 * 2**20  # of addresses, which threads and allocators reserve without using them
_PAGE = resource.getpagesize()
_HIGH_WATER = re.compile(rb"VmHWM:\s+(\d+)")


class Worker:
    def __init__(self, state: mmap.mmap, answers: Any) -> None:
        self.state, self.answers = state, answers
        self.warnings: list[warnings.WarningMessage] = []
        self.unraised: list[BaseException] = []
        self.ready: set[str] = set()
        self.last_reset = 0
        warnings.simplefilter("always")
        warnings.showwarning = self._note
        sys.unraisablehook = lambda seen: self.unraised.append(seen.exc_value or seen.exc_type())

    def _note(self, message: Any, category: Any, filename: str, lineno: int, *rest: Any) -> None:
        self.warnings.append(warnings.WarningMessage(message, category, filename, lineno))

    def run(self, name: str, seed: int, start: int, stop: int) -> None:
        """Try inputs `start` to `stop - 1` of a kind."""
        kind = cases.kind_of(name)
        if name not in self.ready:
            _limit(None)
            kind.warm_up()
            self.ready.add(name)
        _limit(_addresses() + _SLACK)
        self._tell(event="begin")
        tried, slowest, slowest_number, largest, largest_number = 0, 0.0, -1, 0, -1
        for number in range(start, stop):
            with kind.case(name, seed, number) as case:
                self.warnings.clear()  # of the making
                before = self._memory()
                began = time.monotonic()
                STATE.pack_into(self.state, 0, number, began, tried, slowest, slowest_number, largest, largest_number)
                failure = case.run()
                seconds = time.monotonic() - began
                STATE.pack_into(self.state, 0, number, 0.0, tried, slowest, slowest_number, largest, largest_number)
                grown = max(0, self._peak() - before)
            tried += 1
            if seconds > slowest:
                slowest, slowest_number = seconds, number
            if grown > largest:
                largest, largest_number = grown, number
            failure = failure or self._quiet(kind)
            if failure is None and grown > judge.BYTES:
                failure = judge.Failure("memory", "", f"{grown // 2**20} MB")
            if failure is None and seconds > judge.SECONDS:
                failure = judge.Failure("slow", "", f"{seconds:.1f} s")
            if failure is not None:
                self._tell(event="failure", number=number, failure=vars(failure))
            self.unraised.clear()
        figures = (tried, slowest, slowest_number, largest, largest_number)
        self._tell(event="end", figures=figures)

    def _quiet(self, kind: Any) -> judge.Failure | None:
        """None if nothing was said beside the answer."""
        for warning in self.warnings:
            if not kind.may_warn(warning):
                return judge.warned(warning)
        for error in self.unraised:
            return judge.Failure("error", "", f"ignored on the way: {type(error).__name__}: {error}"[:300])
        return None

    def _memory(self) -> int:
        """Bytes in use; afterwards `_peak` tells the most since this."""
        peak = self._peak()
        if peak - self.last_reset > 2**20:
            try:
                with open("/proc/self/clear_refs", "w") as file:
                    file.write("5")
            except OSError:  # no Linux, or not allowed: only a new record is seen
                pass
            self.last_reset = peak = self._peak()
        return peak

    def _peak(self) -> int:
        if sys.platform == "linux":  # what getrusage tells begins with the memory of the process that started this one
            with open("/proc/self/status", "rb") as file:
                return int(_HIGH_WATER.search(file.read())[1]) * 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)

    def _tell(self, **event: Any) -> None:
        self.answers.write(json.dumps(event) + "\n")
        self.answers.flush()


def _addresses() -> int:
    with open("/proc/self/statm") as file:
        return int(file.read().split()[0]) * _PAGE


def _limit(addresses: int | None) -> None:
    if sys.platform != "linux":
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (hard if addresses is None else addresses, hard))


def main() -> None:
    folder, answers = Path(sys.argv[1]), os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print is no answer
    faulthandler.enable(sys.stderr)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import signal

    faulthandler.register(signal.SIGUSR1, sys.stderr, all_threads=False)
    with open(folder / "state", "r+b") as file, mmap.mmap(file.fileno(), STATE.size) as state:
        tempfile.tempdir = str(folder)
        worker = Worker(state, answers)
        os.chdir(folder)
        for line in sys.stdin:
            job = json.loads(line)
            worker.run(job["kind"], job["seed"], job["start"], job["stop"])
            gc.collect()
    shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
