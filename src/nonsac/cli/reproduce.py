"""Run the paper's experiments."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from nonsac.cli.messages import tell, wrote
from nonsac.cli.options import Quiet, Seed, Workers
from nonsac.cli.outputs import Outputs
from nonsac.cli.session import session


def table4(
    cloud: Annotated[Path, typer.Option(metavar="FILE", help="The bunny (bun_zipper.ply), or another cloud.")],
    trials: Annotated[int, typer.Option(min=1, help="The paper has 100.")] = 100,
    seed: Seed = 0,
    workers: Workers = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all numbers as JSON; '-' is stdout.")
    ] = None,
    picture: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw Fig. 2 (.png, .pdf or .svg).")] = None,
    quiet: Quiet = False,
) -> None:
    """Registration without correspondences: the paper's rules, and our own pipeline, on 250,000 hypothesised pairs."""
    to_stdout = json_file == Path("-")
    outputs = Outputs(picture=picture, report=None if to_stdout else json_file)
    outputs.check([("--cloud", cloud)])
    with session(quiet, "trials") as progress:
        from nonsac.reproduce import table4 as experiment

        report = experiment.run(cloud, trials, seed, workers, progress)
    text = json.dumps(report, indent=1, allow_nan=False)
    if to_stdout:
        tell(text)
    else:
        import rich

        rich.print(experiment.table(report))
    if outputs.report is not None:
        from nonsac.io import write_atomically

        write_atomically(outputs.report, lambda temporary: temporary.write_text(text + "\n", encoding="utf-8"))
        wrote(outputs.report, "all numbers", to_stdout)
    if picture is not None:
        experiment.picture(picture, report)
        wrote(picture, "the picture", to_stdout)
