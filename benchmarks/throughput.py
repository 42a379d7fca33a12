"""How much of the time of many small pairs in `nonsac batch` is spent in the calls themselves.

    python benchmarks/throughput.py [--pairs 10000] [--workers 2]

Writes benchmarks/results/throughput.json; `python benchmarks/report.py` writes the block of docs/benchmarks.md from it.
All is processor time, of the process and its workers, from the start of the interpreters: the rest is reading the
manifest, pickling, the journal, and starting processes.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from common import RESULTS, say, write

from nonsac import cli, simulate
from nonsac.calls import pooling
from nonsac.cli import batch_run

_ROWS, _FILES, _NOISE = 200, 100, 0.002
_CALLS = {"relative-pose": "matches", "register-pairs": "pairs"}


class Timed(batch_run.Summarise):
    """Also says how much processor time the call took: reading the file, and estimating."""

    def __call__(self, item):
        run, spent = pooling.PooledRun.__call__, []

        def timed(task, job):
            start = time.process_time()
            result = run(task, job)
            spent.append(time.process_time() - start)
            return result

        pooling.PooledRun.__call__ = timed
        try:
            return super().__call__(item) | {"cpu": sum(spent)}
        finally:
            pooling.PooledRun.__call__ = run


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--pairs", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    batch_run.Summarise = Timed
    rows = [measured(call, arguments.pairs, arguments.workers) for call in _CALLS]
    write(RESULTS / "throughput.json", "throughput", rows_per_pair=_ROWS, rows=rows)


def measured(call: str, pairs: int, workers: int) -> dict[str, object]:
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        write_pairs(call, pairs)
        own, start, wall = processor_time(resource.RUSAGE_CHILDREN), time.process_time(), time.perf_counter()
        command = ["batch", "pairs.csv", "--call", call, "--output", "out.jsonl", "--workers", str(workers), "--quiet"]
        code = cli.main(command)
        parent = time.process_time() - start
        children = processor_time(resource.RUSAGE_CHILDREN) - own
        seconds = time.perf_counter() - wall
        calls = sum(json.loads(line)["cpu"] for line in Path("out.jsonl").read_text().splitlines())
    facts = {"call": call, "pairs": pairs, "workers": workers, "code": code, "calls_s": calls, "parent_s": parent}
    facts |= {"workers_s": children, "wall_s": seconds, "share": calls / (parent + children)}
    say(json.dumps(facts))
    return facts


def write_pairs(call: str, pairs: int) -> None:
    """So many rows of a manifest, of a hundred files."""
    for number in range(_FILES):
        if call == "relative-pose":
            found = simulate.relative_pose(_ROWS, 0.5, _NOISE, number)
            np.save(f"{number}.npy", np.hstack([found.points1, found.points2]))
        else:
            found = simulate.registration(_ROWS, 0.5, _NOISE, number)
            np.save(f"{number}.npy", np.hstack([found.source, found.target]))
    lines = [f"{k % _FILES}.npy,{_NOISE}" for k in range(pairs)]
    Path("pairs.csv").write_text("\n".join([f"{_CALLS[call]},noise", *lines]) + "\n")


def processor_time(of: int) -> float:
    used = resource.getrusage(of)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    sys.exit(main())
