"""Writes the tables of docs/benchmarks.md from the JSON files in benchmarks/results/.

    python benchmarks/report.py [--check]

Only the part between the two markers is replaced; with --check nothing is written, and the exit code is 1 where the
page does not agree with the files.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import cloud_methods
import numpy as np
import pairs
import pose_methods
import work
from common import RESULTS

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"
BEGIN, END = "<!-- results: written by benchmarks/report.py -->", "<!-- end of results -->"

Row = dict[str, Any]

FOLDERS = {
    "bunny_scans": "Range scans of the Stanford bunny",
    "redkitchen": "Indoor RGB-D fragments (7-scenes, redkitchen)",
    "car_lidar": "Car LiDAR",
}
CONDITIONS = {
    "clean": "clean",
    "noise": "1 % noise",
    "points": "1,000 points",
    "clutter": "100 % clutter",
}
BASIN = 15.0  # degrees
OURS = "nonsac"
NONE = "–"  # noqa: RUF001


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    page = PAGE.read_text()
    head, rest = page.split(BEGIN)
    tail = rest.split(END)[1]
    fresh = f"{head}{BEGIN}\n\n{body()}\n{END}{tail}"
    if check and fresh != page:
        sys.exit(f"{PAGE.name} does not agree with benchmarks/results: run python benchmarks/report.py")
    if not check:
        PAGE.write_text(fresh)


def body() -> str:
    writers: dict[str, Callable[[Row], str]] = {
        "clouds": clouds,
        "pairs": pairs_section,
        "poses": poses,
        "work": work_section,
        "grid": grid_section,
        "kernels": kernels,
        "throughput": throughput,
        "verify": verification,
    }
    files = [json.loads(path.read_text()) for path in sorted(RESULTS.glob("*.json"))]
    return "\n".join(write(file) for name, write in writers.items() for file in files if file.get("benchmark") == name)


def clouds(file: Row) -> str:
    parts = []
    for folder in unique(row["folder"] for row in file["results"]):
        rows = [row for row in file["results"] if row["folder"] == folder]
        header = ["condition", "method", "right", f"within {BASIN:g}°", "false claims", "silent", "time", "error"]
        lines = [cloud_line(row) for row in rows]
        title = f"## Raw clouds: {FOLDERS.get(folder, folder)}\n"
        parts.append("\n".join([title, table(header, lines), losses(rows, "condition", CONDITIONS), origin(file)]))
    return "\n".join(parts)


def cloud_line(row: Row) -> list[str]:
    near = sum(o["degrees"] is not None and o["degrees"] <= BASIN for o in row["outcomes"])
    return [
        CONDITIONS[row["condition"]],
        cloud_methods.METHODS[row["method"]][0],
        share(row),
        str(near),
        str(row["false_claims"]),
        str(row["silent"]),
        seconds(row["median_seconds"]),
        degrees(row["median_degrees_of_right"]),
    ]


def pairs_section(file: Row) -> str:
    settings = file["settings"]
    rows = file["results"]
    header = ["outliers", "method", "mAA(1..10)", "right", "false claims", "silent", "time", "memory"]
    intro = (
        f"## Given pairs\n\n{settings['rows']:,} pairs in a unit cube, standard deviation {settings['noise']:g}; right "
        f"is within {settings['right_degrees']:g}°.\n"
    )
    lines = [pair_line(row) for row in rows]
    ratios = {row["outlier_ratio"]: f"{row['outlier_ratio']:.1%}" for row in rows}
    return "\n".join([intro, table(header, lines), losses(rows, "outlier_ratio", ratios), origin(file)])


def pair_line(row: Row) -> list[str]:
    return [
        f"{row['outlier_ratio']:.1%}",
        pairs.METHODS[row["method"]][0],
        f"{row['mean_average_accuracy']:.3f}",
        share(row),
        NONE if row["false_claims"] is None else str(row["false_claims"]),
        NONE if row["silent"] is None else str(row["silent"]),
        seconds(milliseconds_of(row) / 1000.0),
        f"{row['peak_megabytes']:.0f} MB",
    ]


def poses(file: Row) -> str:
    parts = ["## Camera poses\n"]
    for name, write in POSE_TABLES.items():
        if name in file["results"]:
            parts.append(write(file["results"][name]))
    return "\n".join([*parts, origin(file)])


def pose_name(row: Row) -> str:
    return pose_methods.METHODS[row["method"]][0]


def solver_table(rows: Sequence[Row]) -> str:
    lines = [
        [row["solver"], pose_name(row), f"{row['microseconds']:.2f} µs", f"{row['solutions']:.2f}"] for row in rows
    ]
    title = "Minimal solvers, a sample of wrong matches; PoseLib's by a call from Python for each sample.\n"
    return f"{title}\n{table(['solver', 'of', 'time a sample', 'poses found'], lines)}"


def throughput_table(rows: Sequence[Row]) -> str:
    lines = [
        [row["problem"], pose_name(row), f"{row['microseconds']:.2f} µs", f"{row['times_ours']:.2f}"] for row in rows
    ]
    title = "RANSAC on 1,000 rows, 85 % outliers, equal iterations, refinement included, one thread.\n"
    return f"{title}\n{table(['problem', 'method', 'time an iteration', 'times ours'], lines)}"


def scaling_table(rows: Sequence[Row]) -> str:
    lines = [[row["problem"], seconds(row["one"]), seconds(row["two"]), f"{row['speedup']:.2f}"] for row in rows]
    header = ["problem", "one core", "two cores", "times as fast"]
    title = "30 samples of 1,000 rows, 20,000 iterations in each, refinement and verdict included.\n"
    return f"{title}\n{table(header, lines)}"


def real_table(rows: Sequence[Row]) -> str:
    """One line for each pair, and the medians."""
    methods = unique(row["method"] for row in rows)
    header = ["pair", *(f"{pose_methods.METHODS[name][0]} {what}" for name in methods for what in ("error", "time"))]
    lines = []
    for pair in unique(row["pair"] for row in rows):
        found = {row["method"]: row for row in rows if row["pair"] == pair}
        lines.append([pair])
        for name in methods:
            lines[-1] += [f"{found[name]['degrees']:.3f}°", f"{found[name]['milliseconds']:.1f} ms"]
    title = "Real images (Strecha: `rel` two views, `pnp` resection), all cores a library uses, default bounds.\n"
    return f"{title}\n{table(header, lines)}"


def large_table(rows: Sequence[Row]) -> str:
    lines = [
        [pose_name(row), *[NONE] * 3, f"given up after {row['given_up_after']:g} s", NONE]
        if row["given_up_after"]
        else [
            pose_name(row),
            f"{row['within_0.2_deg']}/{row['trials']}",
            f"{row['median_degrees']:.3f}°",
            f"{row['worst_degrees']:.2f}°",
            seconds(row["median_seconds"]),
            f"{row['peak_megabytes']:.0f} MB",
        ]
        for row in rows
    ]
    title = "Relative pose from a million matches, 85 % wrong, standard deviation 0.005.\n"
    header = ["method", "within 0.2°", "median error", "worst", "time", "memory above the data"]
    return f"{title}\n{table(header, lines)}"


def outlier_table(rows: Sequence[Row]) -> str:
    statuses = unique(key for row in rows for key in row if key not in ("problem", "trials"))
    lines = [[row["problem"], *(str(row.get(status, 0)) for status in statuses)] for row in rows]
    return (
        f"Outliers alone, 1,000 rows: how often each status comes out of 100.\n\n{table(['problem', *statuses], lines)}"
    )


POSE_TABLES: dict[str, Callable[[Sequence[Row]], str]] = {
    "solvers": solver_table,
    "throughput": throughput_table,
    "scaling": scaling_table,
    "real": real_table,
    "large": large_table,
    "outliers": outlier_table,
}


def work_section(file: Row) -> str:
    header = [
        "problem",
        "outliers",
        "method",
        "mAA(1..10)",
        "median error",
        "false claims",
        "silent",
        "samples",
        "time",
    ]
    lines = [
        [
            row["problem"],
            f"{row['outlier_ratio']:.1%}",
            work.METHODS[row["method"]][0],
            f"{row['mean_average_accuracy']:.3f}",
            f"{row['median_degrees']:.3f}°",
            NONE if row["false_claims"] is None else str(row["false_claims"]),
            NONE if row["silent"] is None else str(row["silent"]),
            f"{row['mean_samples']:.1f}",
            f"{row['median_milliseconds']:.0f} ms",
        ]
        for row in file["results"]
    ]
    trials = file["results"][0]["trials"]
    intro = (
        f"## As many samples as it takes\n\nSimulated as in the paper, {trials} trials each: 10,000 matches with a "
        "standard deviation of 0.0025 (relative pose) and 0.01 (PnP), 20,000 pairs with 0.01.\n"
    )
    return "\n".join([intro, table(header, lines), origin(file)])


def grid_section(file: Row) -> str:
    header = ["problem", "mAA(1..10)", "with 30", "false claims", "silent", "samples", "mean time", "with 30", "error"]
    lines = [
        [
            row["problem"],
            f"{row['mean_average_accuracy']:.3f}",
            f"{row['mean_average_accuracy_given']:.3f}",
            str(row["false_claims"]),
            str(row["silent"]),
            f"{row['mean_samples']:.1f}",
            f"{row['mean_milliseconds']:.0f} ms",
            f"{row['mean_milliseconds_given']:.0f} ms",
            f"{row['median_ratio_to_least_squares']:.3f}",
        ]
        for row in file["results"]
    ]
    trials = file["results"][0]["trials"]
    intro = (
        f"## The grid of Table 2 with up to 300 samples\n\n{trials} trials a problem, over all 18 cells, against 30 "
        "given samples of the same data. The error is the median, over right answers, of its ratio to that of least "
        "squares on the true inliers of the same rows.\n"
    )
    return "\n".join([intro, table(header, lines), origin(file)])


def kernels(file: Row) -> str:
    results = file["results"]
    lines = [
        ["distance consistency, a pair of rows", f"{results['consistency_ns_per_pair']:.2f} ns"],
        ["a moved point looked up in the grid of nearest points", f"{results['score_models_ns_per_lookup']:.2f} ns"],
        [
            "motions made, scored and ranked in one sample",
            f"{results['motions_per_second'] / 1e6:.2f} million a second",
        ],
    ]
    return "\n".join(["## Kernels, one thread\n", table(["work", "throughput"], lines), origin(file)])


def verification(file: Row) -> str:
    """Medians over the databases; what is kept is summed up."""
    settings, results = file["settings"], file["results"]
    header = ["method", "pairs/s", "processor time a pair", "kept: 30 % wrong", "80 % wrong", "all wrong"]
    header += ["cameras", "position error", "largest", "rotation error"]
    lines = []
    for method in ("nonsac", "pycolmap"):
        rows = [row for row in results if row["method"] == method]
        kept = [f"{sum(r['kept'][s] for r in rows)} of {sum(r['of'][s] for r in rows)}" for s in ("0.3", "0.8", "1.0")]
        lines.append(
            [
                method,
                f"{_median(row['pairs'] / row['wall_s'] for row in rows):.1f}",
                f"{1e3 * _median(row['cpu_s'] / row['pairs'] for row in rows):.0f} ms",
                *kept,
                f"{min(row['registered'] for row in rows)} of {settings['photos']}",
                f"{_median(row['position'] for row in rows):.5f}",
                f"{_median(row['worst_position'] for row in rows):.5f}",
                f"{_median(row['rotation'] for row in rows):.4f}°",
            ]
        )
    databases = len(unique(row["seed"] for row in results))
    intro = (
        f"## Databases of COLMAP\n\n{databases} databases of {results[0]['pairs']} pairs of {settings['photos']} "
        f"simulated photos, keypoints with a noise of {settings['noise']} pixels: `nonsac verify` beside COLMAP's own "
        f"geometric verification, {settings['workers']} workers each, which start within the time, and pycolmap's "
        "incremental mapper on what they give. Medians over the databases; errors of the cameras after alignment, the "
        "scene is 2 wide.\n"
    )
    return "\n".join([intro, table(header, lines), origin(file)])


def throughput(file: Row) -> str:
    header = ["call", "pairs", "workers", "in the calls", "beside them, workers", "this process", "share in the calls"]
    lines = [
        [
            row["call"],
            f"{row['pairs']:,}",
            str(row["workers"]),
            f"{row['calls_s']:.1f} s",
            f"{row['workers_s'] - row['calls_s']:.1f} s",
            f"{row['parent_s']:.1f} s",
            f"{100 * row['share']:.1f} %",
        ]
        for row in file["rows"]
    ]
    intro = (
        f"## Many small pairs\n\nProcessor time of `nonsac batch` with {file['rows_per_pair']} matches in each pair. "
        "What the workers do beside the calls is starting, most of all.\n"
    )
    return "\n".join([intro, table(header, lines), origin(file)])


def _median(values: Iterable[float]) -> float:
    return float(np.median(list(values)))


def losses(rows: Sequence[Row], key: str, names: dict[Any, str]) -> str:
    """In words, where a rival does better than we do."""
    found = []
    for value in unique(row[key] for row in rows):
        group = {row["method"]: row for row in rows if row[key] == value}
        ours = group.pop(OURS, None)
        for row in group.values() if ours else ():
            better = list(advantages(row, ours))
            if better:
                found.append(f"- {names[value]}: {name_of(row)} {' and '.join(better)}.")
    if not found:
        return "Nowhere here does a rival do better.\n"
    return "\n".join(["Where rivals do better:\n", *found, ""])


def advantages(row: Row, ours: Row) -> Iterable[str]:
    if row["right"] / row["trials"] > ours["right"] / ours["trials"]:
        yield f"is right more often ({share(row)} against {share(ours)})"
    if not row["right"]:
        return  # being fast, or accurate, counts only for one that is sometimes right
    if (row["false_claims"] or 0) < (ours["false_claims"] or 0) and row["false_claims"] is not None:
        yield f"makes fewer false claims ({row['false_claims']} against {ours['false_claims']})"
    if milliseconds_of(row) < milliseconds_of(ours):
        yield f"is faster ({seconds(milliseconds_of(row) / 1e3)} against {seconds(milliseconds_of(ours) / 1e3)})"
    error, our_error = (r.get("median_degrees_of_right") for r in (row, ours))
    if error is not None and our_error is not None and error < our_error and degrees(error) != degrees(our_error):
        yield f"has a smaller median error where it is right ({degrees(error)} against {degrees(our_error)})"


def milliseconds_of(row: Row) -> float:
    if "median_milliseconds" in row:
        return float("inf") if row["median_milliseconds"] is None else row["median_milliseconds"]
    return float("inf") if row["median_seconds"] is None else 1000.0 * row["median_seconds"]


def name_of(row: Row) -> str:
    methods = cloud_methods.METHODS if "folder" in row else pairs.METHODS
    return methods[row["method"]][0]


def origin(file: Row) -> str:
    """One line that says where the figures come from."""
    machine = file["machine"]
    versions = ", ".join(f"{name} {number}" for name, number in file["versions"].items() if number)
    return (
        f"<sub>{file['date']}; {machine['processor']}, {machine['cores']} cores, {machine['memory_gb']} GB, "
        f"{machine['system']}; {versions}; commit {file['commit']}; `{file['command']}`</sub>\n"
    )


def table(header: list[str], lines: list[list[str]]) -> str:
    rows = [header, ["---"] * len(header), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


def share(row: Row) -> str:
    return f"{row['right']}/{row['trials']}" + (" (given up)" if row["given_up"] else "")


def seconds(value: float | None) -> str:
    if value is None or value == float("inf"):
        return NONE
    return f"{1000.0 * value:.0f} ms" if value < 1.0 else f"{value:.1f} s"


def degrees(value: float | None) -> str:
    return NONE if value is None else f"{value:.2f}°"


def unique(values: Iterable[Any]) -> list[Any]:
    return list(dict.fromkeys(values))


if __name__ == "__main__":
    main()
