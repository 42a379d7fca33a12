"""Try many damaged files and odd arguments, and say what went wrong.

python tests/fuzz/run.py 100000                 # of all kinds together
python tests/fuzz/run.py 20000 --format ply     # of all kinds whose name begins so
python tests/fuzz/run.py --replay fuzz-failures/ply-ascii/123
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fuzz import cases, judge, pool
from fuzz.arguments import CALLS
from fuzz.formats import FORMATS

GROUPS = {"files": FORMATS, "calls": CALLS}
_SAVED = 3  # inputs of each kind of failure


def shared_out(total: int, kinds: list[str]) -> dict[str, int]:
    """How many inputs of each kind: the cheaper the more, and more of files than of arguments."""
    shares = {kind: (3 if kind in FORMATS else 1) * cases.KINDS[kind].cost ** -0.7 for kind in kinds}
    return {kind: max(1, round(total * share / sum(shares.values()))) for kind, share in shares.items()}


def chosen(prefix: str) -> list[str]:
    kinds = [kind for kind in cases.KINDS if kind.startswith(prefix)]
    if prefix in GROUPS:
        kinds = list(GROUPS[prefix])
    for kind in list(kinds):
        if cases.KINDS[kind].missing:
            print(f"{kind:18} left out: {', '.join(cases.KINDS[kind].missing)} is not installed")
            kinds.remove(kind)
    return kinds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", type=int, nargs="?", default=10_000, help="how many, of all kinds together")
    parser.add_argument("--format", default="", help="only kinds whose name begins so, or files, or calls")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first input of each kind")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)), help="processes")
    parser.add_argument("--save", type=Path, default=Path("fuzz-failures"), help="folder for inputs that fail")
    parser.add_argument("--replay", type=Path, metavar="FOLDER", help="try a saved input in this process")
    arguments = parser.parse_args()
    if arguments.replay:
        return replay(arguments.replay)
    kinds = chosen(arguments.format)
    if not kinds:
        parser.error(f"no kind begins with {arguments.format!r}; there are {', '.join(cases.KINDS)}")

    def tell(report: pool.Report, number: int, failure: judge.Failure) -> None:
        seen = len(report.failures[failure.signature])
        if seen == 1:
            print(f"{report.kind} #{number}: {failure.kind} at {failure.place}: {failure.detail}", flush=True)
        if seen <= _SAVED:
            save(arguments.save / report.kind / str(number), report.kind, arguments.seed, number, failure)

    counts = shared_out(arguments.inputs, kinds)
    reports = pool.fuzz(counts, arguments.seed, arguments.first, arguments.workers, tell)
    print()
    for report in reports.values():
        print(report)
        for signature, seen in report.failures.items():
            print(f"      {len(seen):6,} x #{seen[0][0]} {signature}")
    inputs, failures = sum(r.inputs for r in reports.values()), sum(r.failed for r in reports.values())
    print(f"{inputs:,} inputs, {failures:,} failures")
    return 1 if failures else 0


def save(folder: Path, kind: str, seed: int, number: int, failure: judge.Failure) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    cases.KINDS[kind].save(kind, seed, number, folder / "input")
    lines = [f"kind {kind}", f"seed {seed}", f"number {number}", f"{failure.kind} at {failure.place}: {failure.detail}"]
    (folder / "failure.txt").write_text("\n".join(lines) + "\n")


def replay(folder: Path) -> int:
    words = dict(line.split(" ", 1) for line in (folder / "failure.txt").read_text().splitlines()[:3])
    kind = cases.KINDS[words["kind"]]
    print((folder / "failure.txt").read_text())
    failure = kind.replayed(words["kind"], int(words["seed"]), int(words["number"]), folder / "input").run()
    print(f"now: {failure or 'no failure'}")
    return 1 if failure else 0


if __name__ == "__main__":
    sys.exit(main())
