"""Where many images were taken, in a model."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nonsac.cli.inputs import bad
from nonsac.cli.messages import to_stderr, to_stdout, wrote
from nonsac.cli.options import AsJson, Quiet, takes_settings
from nonsac.cli.outputs import check_report, tell_of_rest
from nonsac.cli.session import session

if TYPE_CHECKING:
    from nonsac.calls.localization import Localization

_HELPS = {
    "noise": "Standard deviation of an image point, in pixels; without it the first images measure it for all.",
    "estimator": "Finds a model in one sample: ransac.",
    "workers": "Number of processes, or the address of a Dask scheduler (tcp://host:8786).",
    "time_limit": "For each image: begin no further sample after this time.",
}


@takes_settings("absolute_pose", before="report", helps=_HELPS)
def localize(
    model: Annotated[
        Path,
        typer.Argument(
            metavar="MODEL",
            help="A model of COLMAP (sparse/0); or a folder of tables of image points and their 3D points, one for "
            "each image.",
        ),
    ],
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FILES",
            show_default=False,
            help="The features and the matches of hloc, or the database of COLMAP that holds the images, too.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|FOLDER",
            show_default=False,
            help="Write 'name qw qx qy qz tx ty tz' in each line (.txt), or a model of COLMAP (a new folder).",
        ),
    ] = None,
    pairs: Annotated[
        Path | None,
        typer.Option(
            metavar="LIST",
            show_default="all of the database",
            help="Names of two images in each line, one of the model and one that is to be found.",
        ),
    ] = None,
    cameras: Annotated[
        str | None,
        typer.Option(
            metavar="LIST|CAMERA",
            show_default="those of the files",
            help="Of the images: a name and a camera in each line ('a.jpg PINHOLE 1600 1200 1100 1100 800 600'), or "
            "one camera for all.",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a line of JSON for each image (.jsonl).")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on where a run of the same was stopped.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a file that is there.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
    **settings: Any,
) -> None:
    """Find where many images were taken, from their matches with the images of a model (PnP).

    Only poses that are to be trusted are written. What is done is kept in FILE.partial; FILE appears when all is done.
    """
    if output is None:
        raise bad("--output", "give a file that ends in .txt, or the name of a new folder")
    check_report(report, (model, *(files or ()), pairs, output))
    start = time.perf_counter()
    with session(quiet, "images") as progress:
        from nonsac.calls.localize import localize as localized

        try:
            found = localized(
                model,
                *(files or ()),
                output=output,
                pairs=pairs,
                cameras=cameras,
                resume=resume,
                overwrite=overwrite,
                progress=progress,
                **settings,
            )
        except BaseException:
            tell_of_rest(output)
            raise
    _show(found, time.perf_counter() - start, as_json)
    localized_count = found.statuses["ok"]
    wrote(output, f"the poses of {localized_count:,} images", as_json or quiet)
    if report is not None:
        found.write(report)
        wrote(report, "a line for each image", as_json or quiet)
    raise typer.Exit(0 if localized_count == len(found.images) else 1)


def _show(found: Localization, seconds: float, as_json: bool) -> None:
    for image in found.images:
        if image.error is not None:
            to_stderr(f"{image.name}: failed: {image.error}")
    rate = f"{seconds:.1f} s, {len(found.images) / seconds:,.1f} images/s"
    to_stdout(json.dumps(found.to_dict()) if as_json else f"{found}\n{rate}")
