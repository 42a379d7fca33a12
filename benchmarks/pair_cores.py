"""One sample of matched 3D points: accuracy and processor time of each named core for registration.

    python benchmarks/pair_cores.py [--seeds 20] [--rows 1000] [--cores teaser mac] [--json FILE]
    python benchmarks/pair_cores.py --page

The data are the paper's (Sec. 4.3, `nonsac.simulate.registration`), the same for all. The second command writes the
table in docs/registration-cores.md from the JSON of the first.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from common import RESULTS, installed, median, renewed, say, write
from numpy.typing import NDArray
from pairs import kiss_solve
from reproduction import markdown, paragraph
from verdict_page import origin

from nonsac import Registration
from nonsac.estimators.named import ESTIMATORS
from nonsac.evaluation import mean_average_accuracy, rotation_error
from nonsac.layouts import Rows
from nonsac.problems import Noise
from nonsac.simulate import registration

PAGE = Path(__file__).resolve().parents[1] / "docs" / "registration-cores.md"
BEGIN, END = "<!-- measured -->", "<!-- end of measured -->"
RATIOS = (0.5, 0.9, 0.95, 0.99)
SOLVED = 5.0  # degrees
PEER = "KISS-Matcher `solve`"
Find = Callable[[Rows, float, int], NDArray[np.float64]]


def main() -> None:
    arguments = parse()
    if arguments.page:
        PAGE.write_text(fresh_page(json.loads(arguments.json.read_text())))
        return
    results = []
    for name in arguments.cores:
        find = function_of(name)
        timed(find, data(300, 0.5, arguments.noise, 0), arguments.noise, 0)
        for ratio in RATIOS:
            calls = [
                timed(find, data(arguments.rows, ratio, arguments.noise, seed), arguments.noise, seed)
                for seed in range(arguments.seeds)
            ]
            results.append({"core": name, "outlier_ratio": ratio} | summary(calls))
            say(json.dumps(results[-1]))
    settings = {"rows": arguments.rows, "noise": arguments.noise, "seeds": arguments.seeds, "solved_degrees": SOLVED}
    write(arguments.json, "pair_cores", settings=settings, results=results)


def parse() -> argparse.Namespace:
    own = [name for name, named in ESTIMATORS.items() if named.fits(Registration()) and named.needs is None]
    peers = [PEER] if installed("kiss_matcher") else []
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rows", type=int, default=1000)
    parser.add_argument("--noise", type=float, default=0.01)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--cores", nargs="+", choices=own + peers, default=own + peers)
    parser.add_argument("--json", type=Path, default=RESULTS / "pair_cores.json")
    parser.add_argument("--page", action="store_true", help="write the table from the JSON, and run nothing")
    return parser.parse_args()


def function_of(name: str) -> Find:
    if name == PEER:
        return lambda rows, noise, seed: kiss_solve(rows.values[:, :3], rows.values[:, 3:], noise, seed)[0]
    problem = Registration()
    core = ESTIMATORS[name].made_for(problem)
    return lambda rows, noise, seed: core.estimate(problem, rows, Noise.given(noise), np.random.default_rng(seed)).model


def data(rows: int, ratio: float, noise: float, seed: int) -> tuple[Rows, NDArray[np.float64]]:
    pairs = registration(rows, ratio, noise, rng=1000 + seed)
    return Rows(np.ascontiguousarray(np.hstack([pairs.source, pairs.target]))), pairs.T


def timed(find: Find, sample: tuple[Rows, NDArray[np.float64]], noise: float, seed: int) -> tuple[float, float]:
    """The error in degrees, NaN if there is no motion, and the milliseconds of the processor."""
    rows, truth = sample
    start = time.process_time()
    found = find(rows, noise, seed)[:3, :3]
    milliseconds = 1000.0 * (time.process_time() - start)
    is_motion = np.isfinite(found).all() and abs(np.linalg.det(found) - 1.0) < 1e-3
    return float(rotation_error(found, truth[:3, :3])) if is_motion else np.nan, milliseconds


def summary(calls: list[tuple[float, float]]) -> dict[str, Any]:
    errors = np.array([error for error, _ in calls])
    return {
        "mean_average_accuracy": round(mean_average_accuracy(errors), 4),
        "solved": int((errors < SOLVED).sum()),
        "median_milliseconds": round(median([ms for _, ms in calls]) or 0.0, 2),
        "degrees": [None if np.isnan(error) else round(float(error), 4) for error in errors],
    }


def fresh_page(report: dict[str, Any]) -> str:
    """The page with the table between the markers made anew."""
    settings = report["settings"]
    intro = paragraph(f"""
        {settings["seeds"]} samples of {settings["rows"]:,} rows at each share of wrong rows, noise
        {settings["noise"]:g} in a unit cube: mAA(10) and the median of the processor time. Solved are errors below
        {settings["solved_degrees"]:g} degrees; where fewer than all are, their number is in brackets.
    """)
    cells = {(each["core"], each["outlier_ratio"]): each for each in report["results"]}
    names = list(dict.fromkeys(core for core, _ in cells))
    header = ["core", *(f"{100 * ratio:g} %" for ratio in RATIOS)]
    lines = [[shown(name), *(cell(cells[name, ratio], settings["seeds"]) for ratio in RATIOS)] for name in names]
    block = f"{intro}\n\n{markdown(header, lines)}\n\n<sub>{origin(report)}</sub>"
    return renewed(PAGE.read_text(), BEGIN, END, block)


def shown(name: str) -> str:
    return name if name == PEER else f"`{name}`"


def cell(found: dict[str, Any], seeds: int) -> str:
    solved = "" if found["solved"] == seeds else f" ({found['solved']})"
    milliseconds = found["median_milliseconds"]
    return f"{found['mean_average_accuracy']:.3f}{solved}, {milliseconds:,.{0 if milliseconds >= 10 else 1}f} ms"


if __name__ == "__main__":
    main()
