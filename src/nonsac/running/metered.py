"""What a piece of work takes: seconds, seconds of processors, and memory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass
class Used:
    """What was taken.

    Attributes
    ----------
    seconds, cpu_seconds : float
        By the clock, and by all threads of the process together.
    memory : int or None
        Bytes that were held at the peak, beside what was held before; None if the system does not tell.
    """

    seconds: float = 0.0
    cpu_seconds: float = 0.0
    memory: int | None = None


@contextmanager
def metered() -> Iterator[Used]:
    """Measure what is done within."""
    used, before = Used(), _restarted_peak()
    start, cpu_start = time.perf_counter(), time.process_time()
    try:
        yield used
    finally:
        used.seconds, used.cpu_seconds = time.perf_counter() - start, time.process_time() - cpu_start
        peak = process_memory("VmHWM")
        used.memory = None if before is None or peak is None else max(peak - before, 0)


def process_memory(field: str) -> int | None:
    """Bytes that Linux has for this process under a name of /proc/self/status; None on other systems."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith(field + ":")), None)


def _restarted_peak() -> int | None:
    """Bytes held now, at which the peak starts anew."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return None
    return process_memory("VmRSS")
