"""The geometric verification of whole databases."""

from __future__ import annotations

import json
import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nonsac.cli.inputs import bad
from nonsac.cli.messages import to_stderr, to_stdout, wrote
from nonsac.cli.options import AsJson, Quiet, takes_settings
from nonsac.cli.outputs import check_report, tell_of_rest
from nonsac.cli.session import session
from nonsac.files.identity import identity_of

if TYPE_CHECKING:
    from nonsac.calls.verification import Verification

Fallback = StrEnum("Fallback", {"SKIP": "skip", "PYCOLMAP": "pycolmap"})

_HELPS = {
    "noise": "Standard deviation of a right match, in pixels; without it the first pairs measure it for all.",
    "estimator": "Finds a model in one sample: ransac.",
    "workers": "Number of processes, or the address of a Dask scheduler (tcp://host:8786).",
    "time_limit": "For each pair: begin no further sample after this time.",
}


@takes_settings("relative_pose", before="report", helps=_HELPS, initial={"max_samples": "2"})
def verify(
    database: Annotated[
        Path,
        typer.Argument(
            metavar="DATABASE", help="Of COLMAP, with keypoints and matches; or the features of hloc (.h5)."
        ),
    ],
    second: Annotated[
        Path | None, typer.Argument(metavar="SECOND", show_default=False, help="The matches of hloc (.h5).")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a copy of the database with its geometries of two views."),
    ] = None,
    in_place: Annotated[
        bool, typer.Option("--in-place", help="Write them into the database itself, in one transaction.")
    ] = False,
    pairs: Annotated[
        Path | None,
        typer.Option(metavar="LIST", show_default="all", help="Only these pairs: names of two images in each line."),
    ] = None,
    cameras: Annotated[
        str | None,
        typer.Option(
            metavar="LIST|CAMERA",
            show_default="those of the database",
            help="Of hloc's images: a name and a camera in each line ('a.jpg PINHOLE 1600 1200 1100 1100 800 600'), or "
            "one camera for all.",
        ),
    ] = None,
    trust_focal_lengths: Annotated[
        bool,
        typer.Option("--trust-focal-lengths", help="Rely also on focal lengths that COLMAP has guessed."),
    ] = False,
    fallback: Annotated[
        Fallback,
        typer.Option(help="Pairs whose focal lengths are guesses: leave their rows as they are, or let COLMAP verify."),
    ] = Fallback.SKIP,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a line of JSON for each pair (.jsonl).")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw which images are matched with which (.png, .pdf or .svg)."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on where a run of the same was stopped.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an output that is there.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
    **settings: Any,
) -> None:
    """Verify all matched pairs of a COLMAP database, and write their geometries of two views for its mappers.

    What is done is kept in FILE.partial; FILE appears when all is done.

    A run that was stopped goes on with --resume, and ends with the same geometries as one that was not.
    """
    if (output is None) != in_place:
        raise bad("--output", "give the name of a copy, or --in-place, and not both")
    if second is not None and (output is None or pairs is None or cameras is None):
        raise bad("SECOND", "files of hloc need --output, --pairs and --cameras")
    if output is not None and identity_of(output) == identity_of(database) and second is None:
        raise bad("--output", "is the database itself: give another name, or --in-place instead")
    target = database if output is None else output
    check_report(report, (database, second, pairs, target), plot)
    start = time.perf_counter()
    with session(quiet, "pairs") as progress:
        from nonsac.calls.verify import verify as verified

        try:
            found = verified(
                database if second is None else (database, second),
                target,
                pairs=pairs,
                cameras=cameras,
                trust_focal_lengths=trust_focal_lengths,
                fallback=str(fallback),
                resume=resume,
                overwrite=overwrite,
                progress=progress,
                **settings,
            )
        except BaseException:
            tell_of_rest(target)
            raise
    _show(found, time.perf_counter() - start, as_json)
    silent = as_json or quiet
    written = sum(pair.status not in ("skipped", "failed") for pair in found.pairs)
    wrote(target, f"the geometries of {written:,} pairs", silent)
    if report is not None:
        found.write(report)
        wrote(report, "a line for each pair", silent)
    if plot is not None:
        _draw(plot, found)
        wrote(plot, "the graph of matches", silent)
    raise typer.Exit(0 if found.kept and not found.left_out["failed"] else 1)


def _show(found: Verification, seconds: float, as_json: bool) -> None:
    for pair in found.pairs:
        if pair.error is not None:
            to_stderr(f"{pair.image1} and {pair.image2}: failed: {pair.error}")
    rate = f"{seconds:.1f} s, {len(found.pairs) / seconds:,.1f} pairs/s"
    to_stdout(json.dumps(found.to_dict()) if as_json else f"{found}\n{rate}")


def _draw(path: Path, found: Verification) -> None:
    from nonsac.plot import match_graph

    first, second = [pair.image1 for pair in found.pairs], [pair.image2 for pair in found.pairs]
    match_graph(path, first, second, [pair.num_inliers if pair.kept else 0 for pair in found.pairs])
