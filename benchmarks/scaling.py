"""Time and memory against the number of rows: files on disk, all pairs of two large clouds, and the rivals' limits.

    python benchmarks/scaling.py [--folder FOLDER] [--sizes 1e4 1e5 1e6 1e7 1e8] [--repeats 9] [--json FILE]

Files of simulated matches (float32) are written to the folder, read once so that they lie in the page cache, and
measured by processes of their own: one call that is not counted, which compiles and fills the caches, then the
median of the others. Memory is the peak of the process' own pages (RssAnon of Linux, looked at every two
milliseconds, compiled code included); pages of files are left out, as they can be dropped at any time. A rival is
not asked for more rows once it has failed or taken more than the limit.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scaling_methods
from common import RESULTS, say, write

import nonsac

SIZES = (10**4, 10**5, 10**6, 10**7, 10**8)
OUTLIERS = {"relative-pose": (0.85, 0.0025), "absolute-pose": (0.92, 0.01), "registration": (0.99, 0.01)}
POINTS = 10**6  # of each cloud of all pairs


@dataclass(frozen=True)
class Case:
    """What one process measures."""

    problem: str
    method: str
    path: str
    rows: int
    repeats: int


def main() -> None:
    options = parse()
    if options.one:
        print(json.dumps(measured(Case(**json.loads(options.one)))))
        return
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        results = [result for problem in options.problems for result in scaled(Path(folder), problem, options)]
        results += [result for problem in options.problems for result in all_pairs(Path(folder), problem, options)]
    settings = {"outliers": OUTLIERS, "repeats": options.repeats, "limit": options.limit, "points": POINTS}
    write(options.json, "scaling", settings=settings, results=results)


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="where the files are written: up to 5 GB at a time")
    parser.add_argument("--sizes", nargs="+", type=lambda text: int(float(text)), default=SIZES)
    parser.add_argument("--problems", nargs="+", choices=OUTLIERS, default=list(OUTLIERS))
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--limit", type=float, default=20.0, help="seconds after which one call of a rival is given up")
    parser.add_argument("--json", type=Path, default=RESULTS / "scaling.json")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    return parser.parse_args()


def scaled(folder: Path, problem: str, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """All methods on files of all sizes, once a process has compiled the kernels."""
    failed: set[str] = set()
    T = nonsac.simulate.to_file(folder / "first.npy", problem, 10**4, *OUTLIERS[problem], rng=0)
    for method in ("polish", "full"):
        run(Case(problem, method, str(folder / "first.npy"), 10**4, 1), T, 10.0 * options.limit)
    for rows in options.sizes:
        for suffix in ("npy", "parquet"):
            path = folder / f"rows.{suffix}"
            T = nonsac.simulate.to_file(path, problem, rows, *OUTLIERS[problem], rng=0, dtype="float32")
            read_whole(path)
            for method in scaling_methods.named(problem, suffix):
                if method in failed:
                    continue
                case = Case(problem, method, str(path), rows, options.repeats)
                result = {"problem": problem, "rows": rows, "format": suffix} | run(case, T, options.limit)
                if result.get("failed"):
                    failed.add(method)
                say(json.dumps(result))
                yield result
            path.unlink()


def all_pairs(folder: Path, problem: str, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """All pairs of few and of many points, which only `registration` has an answer for."""
    for points in (10**3, POINTS):
        T = scaling_methods.write_clouds(folder, problem, points)
        case = Case(problem, "all_pairs", str(folder), points**2, options.repeats)
        result = {"problem": problem, "rows": points**2, "format": "all pairs"} | run(case, T, options.limit)
        say(json.dumps(result))
        yield result


def read_whole(path: Path) -> None:
    """Into the page cache."""
    with path.open("rb") as file:
        while file.read(2**24):
            pass


def run(case: Case, T: np.ndarray, limit: float) -> dict[str, Any]:
    """A process of its own, with its peak memory; only a rival is given up."""
    command = [sys.executable, __file__, "--one", json.dumps(asdict(case))]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    peak = [0.0]
    watcher = threading.Thread(target=watch, args=(process, peak))
    watcher.start()
    try:
        output, _ = process.communicate(timeout=4.0 * limit)  # two calls of a rival at its limit, and the imports
    except subprocess.TimeoutExpired:
        process.kill()
        output = ""
    watcher.join()
    found = {"method": case.method, "peak_megabytes": round(peak[0], 1)}
    if process.returncode != 0 or not output:
        return found | {"failed": True}
    told = json.loads(output)
    degrees = nonsac.evaluation.rotation_error(np.array(told.pop("T"))[:3, :3], T[:3, :3])
    return found | told | {"degrees": float(degrees), "failed": told["seconds"] > limit}


def watch(process: subprocess.Popen[str], peak: list[float]) -> None:
    status = Path(f"/proc/{process.pid}/status")
    while process.poll() is None:
        try:
            lines = status.read_text().splitlines()
        except OSError:
            return
        peak[0] = max(peak[0], *(int(line.split()[1]) / 1024 for line in lines if line.startswith("RssAnon:")), 0.0)
        time.sleep(0.002)


def measured(case: Case) -> dict[str, Any]:
    """In the process itself."""
    call: Callable[[int], tuple[Any, str | None]] = partial(
        scaling_methods.call, case.method, case.problem, case.path, OUTLIERS[case.problem][1]
    )
    T, status = call(0)
    seconds = []
    for seed in range(case.repeats):
        start = time.perf_counter()
        T, status = call(seed)
        seconds.append(time.perf_counter() - start)
        if sum(seconds) > 8.0:
            break
    return {"seconds": float(np.median(seconds)), "calls": len(seconds), "status": status, "T": T.tolist()}


if __name__ == "__main__":
    main()
