"""What is made of verdict.json: rates and intervals, the block of docs/verdict.md, and the reliability diagram."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import renewed
from reproduction import markdown, paragraph
from scipy.special import betaincinv

from nonsac.plot.figures import BLUE, INK, ORANGE, new_figure, write_text
from nonsac.plot.figures import write as write_figure
from nonsac.plot.studies import Colour, reliability
from nonsac.reproduce.experiments import EXPERIMENTS

DOCS = Path(__file__).parents[1] / "docs"
PAGE, PICTURE = DOCS / "verdict.md", DOCS / "images" / "verdict_reliability.png"
BEGIN, END = "<!-- verdict study -->", "<!-- end -->"

# Of the confidence: finer where a verdict turns and where most answers are.
EDGES = (0.0, 0.1, 0.3, 0.4, 0.45, 0.5, 0.55, 0.6, 0.7, 0.9, 0.99, 0.999, 1.0)
CELLS = ("trusted_right", "trusted_wrong", "untrusted_right", "untrusted_wrong")
TITLES = {name: experiment.title for name, experiment in EXPERIMENTS.items()} | {"clouds": "Raw clouds"}
KINDS = {
    "outliers": "pure outliers",
    "shuffled": "real matches, shuffled",
    "grid": "the paper's grid",
    "limit": "beyond the grid",
    "unrelated": "unrelated clouds",
    "scans": "overlapping scans",
}
WITHOUT_TRUTH = ("outliers", "shuffled", "unrelated")
COLOURS: dict[str, Colour] = dict(zip(TITLES, (BLUE, "#cc79a7", "#009e73", ORANGE), strict=True))

Report = dict[str, Any]

TEXT = """{intro}

{counts}

{confidences}

{figures}

![How often answers are right, by their confidence](images/verdict_reliability.png)

{caption}

### The wrong answers that are trusted

{mistakes}

<sub>{origin}</sub>"""


# --- rates -------------------------------------------------------------


def wilson(count: int, trials: int) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927)."""
    z = 1.959964
    share, weight = count / trials, 1.0 + z**2 / trials
    centre = (share + z**2 / (2 * trials)) / weight
    reach = z * np.sqrt(share * (1 - share) / trials + z**2 / (4 * trials**2)) / weight
    return max(0.0, float(centre - reach)), min(1.0, float(centre + reach))


def upper_bound(count: int, trials: int) -> float | None:
    """What a rate is below with 95 % certainty: exact (Clopper and Pearson), the rule of three where none is seen."""
    if not trials:
        return None
    if not count:
        return min(1.0, 3.0 / trials)
    return 1.0 if count == trials else float(betaincinv(count + 1, trials - count, 0.95))


def rate(count: int, trials: int) -> Report:
    """Ready for JSON."""
    return {"count": count, "trials": trials, "upper": upper_bound(count, trials)}


def calibration(results: Sequence[Report]) -> Report:
    """For each problem the bins over all kinds, and the figures made of them."""
    return {name: calibrated([row for row in results if row["problem"] == name]) for name in TITLES}


def calibrated(rows: Sequence[Report]) -> Report:
    """The reliability of one problem's confidences."""
    bins = pooled(rows)
    with_truth = [row for row in rows if row["kind"] not in WITHOUT_TRUTH]
    return {
        "bins": bins,
        "expected_calibration_error": expected_error(bins),
        "expected_calibration_error_with_truth": expected_error(pooled(with_truth)),
        "false_success": false_success([row for row in rows if row["kind"] in WITHOUT_TRUTH]),
        "false_success_with_truth": false_success(with_truth),
        "false_failure": rate(total(rows, "untrusted_right"), total(rows, "untrusted_right", "trusted_right")),
    }


def false_success(rows: Sequence[Report]) -> Report:
    """How many of the wrong answers are trusted."""
    return rate(total(rows, "trusted_wrong"), total(rows, "trusted_wrong", "untrusted_wrong"))


def total(rows: Sequence[Report], *cells: str) -> int:
    """Answers in these cells of the tables."""
    return sum(row["table"][name]["count"] for row in rows for name in cells)


def pooled(rows: Sequence[Report]) -> list[Report]:
    """The bins of several kinds together."""
    return [one_bin(*(sum(part[key] for part in parts) for key in ("count", "right", "confidence")))
            for parts in zip(*(row["bins"] for row in rows), strict=True)]  # fmt: skip


def one_bin(count: int, right: int, confidence: float) -> Report:
    """From sums to shares."""
    if not count:
        return {"count": 0, "right": 0}
    low, high = wilson(right, count)
    shares = {"confidence": confidence / count, "share": right / count, "low": low, "high": high}
    return {"count": count, "right": right} | shares


def expected_error(bins: Sequence[Report]) -> float | None:
    """The mean distance between the confidence and the share of right answers, bin by bin."""
    filled = [part for part in bins if part["count"]]
    if not filled:
        return None
    distances = [part["count"] * abs(part["share"] - part["confidence"]) for part in filled]
    return sum(distances) / sum(part["count"] for part in filled)


# --- the page ----------------------------------------------------------


def write(path: Path) -> None:
    """Write the block of the page, and the picture."""
    report = json.loads(path.read_text())
    PAGE.write_text(fresh_page(report))
    write_picture(report)


def difference(path: Path) -> str | None:
    """What is wrong with the page, if anything is."""
    if not path.exists():
        return f"{path.name} is not there yet: run python benchmarks/verdict.py"
    if fresh_page(json.loads(path.read_text())) != PAGE.read_text():
        return f"{PAGE.name} does not agree with {path.name}: run python benchmarks/verdict.py --page"
    return None


def fresh_page(report: Report) -> str:
    """The page with the block between the markers made anew."""
    return renewed(PAGE.read_text(), BEGIN, END, block(report))


def block(report: Report) -> str:
    """All between the markers."""
    return TEXT.format(
        intro=intro(report),
        counts=counts(report["results"]),
        confidences=confidences(report["results"]),
        figures=figures(report["calibration"]),
        caption=paragraph("""
            Dots are shares of right answers with their 95 % intervals (Wilson), over all data above; grey lines are
            the mean confidences, where the dots of a calibrated one would be; numbers are answers. All bins are drawn
            equally wide. Right of 0.5 an answer may be trusted, left of it none is.
        """),
        mistakes=mistakes(report),
        origin=origin(report),
    )


def intro(report: Report) -> str:
    """What was run."""
    settings = report["settings"]
    return "\n\n".join(
        [
            paragraph(f"""
                Written by `benchmarks/verdict.py` from `benchmarks/results/verdict.json`; no result here is typed by
                hand. Defaults throughout, with {settings["samples"]} samples and the N of the
                [experiments](reproduction.md). Wrong is a rotation that is off by {settings["wrong_degrees"]:g} degrees
                or more, or no answer; for raw clouds also a centroid that is off by more than
                {100 * settings["wrong_shift"]:g} % of the diagonal. Where the data have no right answer, every one is
                wrong.
            """),
            "\n".join(item(f"**{KINDS[kind]}**: {text}") for kind, text in described(settings).items()),
        ]
    )


def described(settings: Report) -> dict[str, str]:
    """Each kind of data in words."""
    limits = "; ".join(
        f"{TITLES[name]} {100 * min(ratios):g} to {100 * max(ratios):g} %"
        for name, ratios in settings["limits"].items()
    )
    return {
        "outliers": "simulated as in the experiments, with no right row.",
        "shuffled": """Strecha's images and FPFH matches of real scans; the second halves are permuted anew in each
            trial. Many trials share one file, so they are not as independent as their number says.""",
        "grid": "all outlier ratios and noises of Table 2 in turn.",
        "limit": f"the same noises with more outliers, to where no answer is right any more ({limits}).",
        "unrelated": """two clouds of different scenes (bunny, kitchen, car, street, Lucy, elephant), brought to one
            size within a factor of two; every fourth trial has a ball, a blob, a sphere or a wavy sheet as its
            target.""",
        "scans": f"""range scans, indoor fragments and car scans that overlap, turned at random. For these and the
            unrelated ones: {"; ".join(settings["conditions"])}.""",
    }


def item(text: str) -> str:
    """Of a list."""
    return paragraph(f"- {text}", "  ")


def counts(results: Sequence[Report]) -> str:
    """Right and wrong against trusted and not, and what the share of trusted ones among the wrong ones is below."""
    header = [
        "",
        "different data",
        "trials",
        *(name.replace("_", ", ") for name in CELLS),
        "trusted of the wrong, below",
    ]
    return markdown(header, map(count_line, results))


def count_line(row: Report) -> Iterable[str]:
    """One problem and kind."""
    found = [row["table"][name]["count"] for name in CELLS]
    return [name_of(row), f"{row['cases']}", f"{row['trials']:,}", *(f"{count:,}" for count in found),
            percent(upper_bound(found[1], found[1] + found[3]))]  # fmt: skip


def confidences(results: Sequence[Report]) -> str:
    """The least, the median and the largest in each cell."""
    header = ["confidence: least, median, largest", *(name.replace("_", ", ") for name in CELLS)]
    return markdown(header, ([name_of(row), *(range_of(row["table"][name]) for name in CELLS)] for row in results))


def range_of(cell: Report) -> str:
    """Three numbers, or none."""
    return ", ".join(rounded(cell[name]) for name in ("least", "median", "largest")) if cell["count"] else ""


def rounded(confidence: float) -> str:
    """Three digits, and how much is missing to 1 where they would hide it."""
    if 0.9995 <= confidence < 1.0 - 1e-12:
        return f"1 - {1.0 - confidence:.0e}"
    return f"{confidence:.3g}"


def figures(calibration: Report) -> str:
    """Rates of false successes and failures, and the calibration error."""
    rows = (
        [
            TITLES[name],
            of_rate(found["false_success"]),
            of_rate(found["false_success_with_truth"]),
            of_rate(found["false_failure"]),
            number(found["expected_calibration_error"]),
            number(found["expected_calibration_error_with_truth"]),
        ]
        for name, found in calibration.items()
    )
    header = [
        "",
        "trusted of wrong answers, data without a right one",
        "the same, data with one",
        "untrusted of right answers",
        "expected calibration error",
        "the same, data with a right answer",
    ]
    note = paragraph("""
        In brackets what the rate is below with 95 % certainty: 3 / n where none was seen, else exact (Clopper and
        Pearson). The expected calibration error depends on the mix of the data as well as on the confidence, and so do
        the dots below.
    """)
    return f"{markdown(header, rows)}\n\n{note}"


def of_rate(found: Report) -> str:
    """In words."""
    return f"{found['count']:,} of {found['trials']:,} (< {percent(found['upper'])})" if found["trials"] else ""


def percent(share: float | None) -> str:
    """Of a rate, two digits."""
    return "" if share is None else f"{100 * share:.2g} %" if share < 0.995 else "100 %"


def number(value: float | None) -> str:
    """Three decimals, or nothing."""
    return "" if value is None else f"{value:.3f}"


def mistakes(report: Report) -> str:
    """The wrong answers that are trusted, by problem and kind."""
    found = sorted(report["false_successes"], key=lambda mistake: -mistake["confidence"])
    groups = (
        (row, [mistake for mistake in found if all(mistake[key] == row[key] for key in ("problem", "kind"))])
        for row in report["results"]
    )
    return "\n".join(item(mistakes_text(row, group)) for row, group in groups if group) or "There is none."


def mistakes_text(row: Report, group: Sequence[Report], most: int = 5) -> str:
    """How far off they are, and the most confident ones."""
    errors = [mistake["degrees"] for mistake in group if mistake["degrees"] is not None]
    shares = ", ".join(f"{sum(error < bound for error in errors)} below {bound} degrees" for bound in (15, 30, 90))
    named = "; ".join(f"{mistake['case']} ({measures(mistake)})" for mistake in group[:most])
    return f"{name_of(row)}, {len(group):,}{f' ({shares})' if errors else ''}. Most confident: {named}."


def measures(mistake: Report) -> str:
    """Of a wrong answer: the error, where there is a truth, and the confidence."""
    error = "" if mistake["degrees"] is None else f"{mistake['degrees']:.3g} degrees, "
    return f"{error}confidence {rounded(mistake['confidence'])}"


def name_of(row: Report) -> str:
    """Problem and data."""
    return f"{TITLES[row['problem']]}, {KINDS[row['kind']]}"


def origin(report: Report) -> str:
    """Where the figures come from."""
    machine, versions = report["machine"], report["versions"]
    names = ", ".join(f"{name} {versions[name]}" for name in ("python", "nonsac", "numpy", "scipy", "numba"))
    where = f"{report['date']}; {machine['processor']}, {machine['cores']} cores; {names}"
    return f"{where}; commit {report['commit']}; `{report['command']}`"


# --- the picture -------------------------------------------------------


def write_picture(report: Report, path: Path = PICTURE) -> None:
    """Reliability diagrams, one for each problem."""
    figure = new_figure(13.0, 9.0)
    panels = figure.subplots(2, 2).ravel()
    for axes, (name, found) in zip(panels, report["calibration"].items(), strict=True):
        reliability(axes, EDGES, [point(part) for part in found["bins"]], COLOURS[name])
        axes.axvline(EDGES.index(0.5) - 0.5, color=INK, linewidth=0.9, linestyle=":", zorder=1)
        axes.set_title(TITLES[name], loc="left", fontsize=12, color=INK, pad=24)
        axes.set_xlabel("confidence", fontsize=10, color=INK)
        axes.set_ylabel("share of right answers", fontsize=10, color=INK)
    legend = "dots: share of right answers, with 95 % interval   grey: mean confidence   numbers: answers   dotted: 0.5"
    write_text(figure, 0.5, 0.975, legend, 10)
    figure.subplots_adjust(0.06, 0.07, 0.985, 0.88, 0.14, 0.42)
    write_figure(path, figure, path.suffix)


def point(part: Report) -> tuple[int, float, float, float, float]:
    """A bin as it is drawn."""
    if not part["count"]:
        return 0, 0.0, 0.0, 0.0, 0.0
    return part["count"], part["confidence"], part["share"], part["low"], part["high"]
