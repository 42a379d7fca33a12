"""What is made of verdict_structured.json: a block of docs/verdict.md."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from common import renewed
from reproduction import markdown, paragraph
from verdict_page import CELLS, PAGE, Report, item, origin

BEGIN, END = "<!-- structured study -->", "<!-- end of structured study -->"
HALVES = {"noise_given": "noise given", "noise_left_out": "left out"}

TEXT = """{intro}

{kinds}

{counts}

{caption}

{bounds}

<sub>{origin}</sub>"""


def write(path: Path) -> None:
    """Write the block of the page."""
    PAGE.write_text(fresh_page(path))


def difference(path: Path) -> str | None:
    """What is wrong with the page, if anything is."""
    if not path.exists():
        return f"{path.name} is not there yet: run python benchmarks/verdict.py --structured"
    if fresh_page(path) != PAGE.read_text():
        return f"{PAGE.name} does not agree with {path.name}: run python benchmarks/verdict.py --page"
    return None


def fresh_page(path: Path) -> str:
    """The page with the block between the markers made anew."""
    return renewed(PAGE.read_text(), BEGIN, END, block(json.loads(path.read_text())))


def block(report: Report) -> str:
    """All between the markers."""
    return TEXT.format(
        intro=intro(report["settings"]),
        kinds="\n".join(item(text) for text in KINDS),
        counts=counts(report["results"]),
        caption=CAPTION,
        bounds=bounds(report["results"]),
        origin=origin(report),
    )


def intro(settings: Report) -> str:
    """What was run, and what counts as right."""
    return paragraph(f"""
        Written by `benchmarks/verdict.py --structured` from `benchmarks/results/verdict_structured.json`. Defaults
        throughout, each set of data with the noise given and with it left out. Right is a rotation within
        {settings["right_rotation"]:g} degrees and, for two images, a direction of t within
        {settings["right_direction"]:g} ({settings["right_narrow_direction"]:g} for narrow views). Where there is no
        truth, every answer is wrong; of a camera that only turns there is none of t. Images have a focal length of
        1,000 pixels.
    """)


KINDS = (
    "**blobs**: few facts, each repeated many times; nothing relates the two sides.",
    """**statue**: a figure on a round base that turns with it, but whose matches say that it turned less; noise of 1 %
    of the base's radius.""",
    """**periodic wall**: two thirds of 600 points, of which the share named matches the wrong period; the other points,
    before and behind it, are right.""",
    "**camera that turns**: 600 matches without a baseline, many displaced at random by some pixels, as by a tracker.",
    "**moving object**: 800 matches, of which some are on a compact object that moved on its own.",
    "**two planes**: 200 points of two walls that meet in a corner, seen once.",
    """**degrees of view**: an object on a turntable through a long lens, 30 % of the matches wrong, noise of 0.15 % of
    half the image's width.""",
    "**honest**: data as in the experiments, which must be trusted.",
    """**real**: each file once. FPFH matches of scans and of statues, whose noise is a fifth of the bound of the
    inliers; SIFT matches of a toy through a long lens (noise of 0.5 pixels) and of Strecha's buildings. Where lines
    differ in the noise alone, the halves without it are the same trials.""",
)


def counts(results: Sequence[Report]) -> str:
    """Right and wrong against trusted and not, and the time it took."""
    cells = [cell.replace("_", ", ") for cell in CELLS]
    header = ["", "trials", *(f"{half}: {cell}" for half in HALVES.values() for cell in cells),
              *(f"{half}: CPU ms" for half in HALVES.values()), "ratio"]  # fmt: skip
    return markdown(header, map(count_line, results))


def count_line(row: Report) -> Iterable[str]:
    """One kind of data."""
    return [row["kind"], f"{row['trials']:,}", *(f"{row[half][cell]:,}" for half in HALVES for cell in CELLS),
            *(milliseconds(row[half]["cpu_ms"]) for half in HALVES), f"{row['cpu_ratio']:.2f}"]  # fmt: skip


def milliseconds(value: float) -> str:
    """Three digits."""
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


CAPTION = paragraph("""
    CPU ms is the median CPU time of a call, with one worker; the ratio is that without the noise to that with it.
    Below, how often the true errors are within `Result.uncertainty`, which 95 % should be, over all answers that state
    a finite one, and over the trusted ones among them. Wrong answers are included.
""")


def bounds(results: Sequence[Report]) -> str:
    """Whether errors are as large as they are said to be."""
    header = ["error within the stated uncertainty"]
    header += [f"{which}: {what}" for which in ("all", "trusted") for what in ("answers", "rotation", "t")]
    lines = (
        [f"{row['kind']}, {said}", *bound_cells(row[half]["bounds"]), *bound_cells(row[half]["bounds_of_trusted"])]
        for row in results
        if row["narrow"]
        for half, said in zip(HALVES, ("noise given", "noise left out"), strict=True)
    )
    return markdown(header, lines)


def bound_cells(found: Report) -> list[str]:
    """The number of answers, and the shares that are within."""
    answers = found["answers"]
    within = (found["rotation_within"], found["direction_within"])
    return [f"{answers:,}", *(f"{100 * count / answers:.0f} %" if answers else "" for count in within)]
