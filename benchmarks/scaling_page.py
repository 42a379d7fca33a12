"""The picture and the block of docs/large-data.md, made of scaling.json and full_fit.json.

    python benchmarks/scaling_page.py [--check]

With --check nothing is written, and the exit code is 1 where the page does not agree with the files.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from common import RESULTS
from reproduction import markdown
from scaling_methods import METHODS

from nonsac.plot.figures import BLUE, INK, ORANGE, new_figure
from nonsac.plot.figures import write as write_figure

DOCS = Path(__file__).parents[1] / "docs"
PAGE, PICTURE = DOCS / "large-data.md", DOCS / "images" / "scaling.png"
BEGIN, END = "<!-- scaling -->", "<!-- end -->"
TITLES = {"relative-pose": "Relative pose", "absolute-pose": "PnP", "registration": "Registration of pairs"}
COLOURS = {
    "union": BLUE,
    "polish": "#56b4e9",
    "full": "#009e73",
    "poselib": ORANGE,
    "poselib_refit": "#cc79a7",
    "opencv": INK,
    "kiss": "#d55e00",
}
NONE = "–"  # noqa: RUF001
WRONG = 3.0  # degrees

Row = dict[str, Any]


def main() -> None:
    scaling, fits = (json.loads((RESULTS / name).read_text()) for name in ("scaling.json", "full_fit.json"))
    page = PAGE.read_text()
    head, rest = page.split(BEGIN)
    fresh = f"{head}{BEGIN}\n\n{body(scaling, fits)}\n\n{END}{rest.split(END)[1]}"
    if "--check" in sys.argv[1:]:
        sys.exit(0 if fresh == page else f"{PAGE.name} does not agree with benchmarks/results")
    PAGE.write_text(fresh)
    draw(scaling["results"])


def body(scaling: Row, fits: Row) -> str:
    rows, settings = scaling["results"], scaling["settings"]
    shares = ", ".join(
        f"{TITLES[name].lower()} {100 * outliers:g} % and {noise:g}"
        for name, (outliers, noise) in settings["outliers"].items()
    ).replace("pnp", "PnP")
    return "\n\n".join(
        [
            "![Time and memory against the number of rows](images/scaling.png)",
            f"Rows on disk (.npy, float32, in the page cache; outliers and noise: {shares}), each measurement in a "
            f"process of its own, medians of up to {settings['repeats']} warm calls; the rivals read the file and go "
            f"as far as they get (†: more than {WRONG:g} degrees off). Memory is the peak of the process' own pages.",
            markdown(["", *sizes(rows), "time at 10^8 / 10^5", "most memory"], list(files(rows, "npy"))),
            "The same from Parquet, row groups of a million rows:",
            markdown(["", *sizes(rows), "time at 10^8 / 10^5", "most memory"], list(files(rows, "parquet"))),
            "All pairs of two clouds on disk, ten samples. Only for registration do they hold an answer (1.3 % of the "
            "pairs are near matches); its error is beside the time. The paired views show the work alone. All pairs "
            "are their own chance level, so no answer is trusted: `register_clouds` compares surfaces instead.",
            markdown(["", "10^6 pairs", "10^12 pairs", "most memory"], list(pairs(rows))),
            "### The last fit to all rows",
            poses(fits),
            passes(fits),
            cluster(fits),
            f"<sub>{origin(scaling)}; {origin(fits)}</sub>",
        ]
    )


def sizes(rows: Iterable[Row]) -> list[str]:
    return [power(size) for size in sorted({row["rows"] for row in rows if row["format"] == "npy"})]


def power(size: int) -> str:
    return f"10^{len(str(size)) - 1}"


def files(rows: list[Row], kind: str) -> Iterator[list[str]]:
    """A line for each problem and method."""
    for problem, title in TITLES.items():
        for method, (name, _) in METHODS.items():
            found = {
                row["rows"]: row
                for row in rows
                if (row["problem"], row["method"], row["format"]) == (problem, method, kind)
            }
            if found:
                cells = [seconds(found.get(size)) for size in sorted({r["rows"] for r in rows if r["format"] == "npy"})]
                yield [f"{title}: {name}", *cells, ratio(found), memory(found.values())]


def seconds(row: Row | None) -> str:
    if row is None or row["failed"]:
        return NONE
    wrong = "†" if row["degrees"] > WRONG and row["format"] != "all pairs" else ""
    return f"{row['seconds']:.2f} s{wrong}"


def ratio(found: dict[int, Row]) -> str:
    ends = [found.get(size) for size in (10**5, 10**8)]
    if any(row is None or row["failed"] for row in ends):
        return NONE
    return f"{ends[1]['seconds'] / ends[0]['seconds']:.2f}"  # type: ignore[index]


def memory(rows: Iterable[Row]) -> str:
    return f"{max(row['peak_megabytes'] for row in rows):.0f} MB"


def pairs(rows: list[Row]) -> Iterator[list[str]]:
    for problem, title in TITLES.items():
        found = sorted(
            (row for row in rows if (row["problem"], row["format"]) == (problem, "all pairs")),
            key=lambda row: row["rows"],
        )
        right = [f", {row['degrees']:.1f}°" if problem == "registration" else "" for row in found]
        yield [title, *(seconds(row) + degrees for row, degrees in zip(found, right, strict=True)), memory(found)]


def poses(fits: Row) -> str:
    settings = fits["settings"]
    lines = [
        [power(row["rows"]), METHODS[row["method"]][0], f"{row['seconds']:.2f} s", f"{row['median_degrees']:.4f}°",
         f"{row['rms_degrees']:.4f}°"]
        for row in fits["results"]["poses"]
    ]  # fmt: skip
    return (
        f"Relative pose, rows in memory, {100 * settings['outlier_ratio']:g} % outliers, noise {settings['noise']:g}, "
        f"all cores, {settings['seeds']} data sets that all methods see in turn:\n\n"
    ) + markdown(["rows", "", "time", "median error", "root mean square"], lines)


def passes(fits: Row) -> str:
    lines = [
        [f"{100 * row['outlier_ratio']:g} %", f"{row['rows_per_second'] / 1e6:.0f} million",
         f"{row['difference_to_least_squares']:.0e}"]
        for row in fits["results"]["passes"]
    ]  # fmt: skip
    return "One pass over registration rows in memory, on one core:\n\n" + markdown(
        ["outliers", "rows per second", "difference to least squares of all rows at once"], lines
    )


def cluster(fits: Row) -> str:
    lines = [
        [f'refine="{row["refine"]}"', f"{row['seconds_one']:.2f} s", f"{row['seconds_two']:.2f} s",
         f"{row['ratio']:.2f}", "yes" if row["same_bits"] else "NO"]
        for row in fits["results"].get("cluster", ())
    ]  # fmt: skip
    return (
        "60 samples of relative pose at 90 % outliers on a Dask cluster of processes, the whole call; what comes after "
        "the samples is done by the caller alone:\n\n"
    ) + markdown(["", "one worker", "two", "times as fast", "the bits of one thread"], lines)


def origin(report: Row) -> str:
    machine = report["machine"]
    return f"{report['command']}, {report['date']}, commit {report['commit']}, {machine['processor']}"


def draw(rows: list[Row]) -> None:
    """Time above, memory below, a column for each problem."""
    figure = new_figure(11.0, 6.2)
    axes = figure.subplots(2, 3, sharex=True, sharey="row")
    for column, (problem, title) in enumerate(TITLES.items()):
        for method, colour in COLOURS.items():
            name = METHODS[method][0]
            found = [
                row
                for row in rows
                if (row["problem"], row["method"], row["format"]) == (problem, method, "npy") and not row["failed"]
            ]
            sizes = [row["rows"] for row in found]
            style = {"color": colour, "marker": "o", "markersize": 4, "label": name.replace("`", "")}
            axes[0, column].loglog(sizes, [row["seconds"] for row in found], **style)
            axes[1, column].loglog(sizes, [row["peak_megabytes"] for row in found], **style)
        axes[0, column].set_title(title)
        axes[1, column].set_xlabel("rows")
    axes[0, 0].set_ylabel("seconds")
    axes[1, 0].set_ylabel("memory, MB")
    handles = {line.get_label(): line for axis in axes[0] for line in axis.get_lines() if len(line.get_xdata())}
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=3, frameon=False)
    figure.subplots_adjust(bottom=0.22, top=0.93, left=0.07, right=0.98)
    write_figure(PICTURE, figure, ".png")


if __name__ == "__main__":
    main()
