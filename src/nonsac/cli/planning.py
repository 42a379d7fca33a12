"""What a run would cost."""

from __future__ import annotations

import json
from enum import StrEnum
from typing import Annotated

import typer

from nonsac.calls.registry import CALLS
from nonsac.cli.messages import to_stdout
from nonsac.cli.options import Columns, Dataset, columns_of
from nonsac.method.settings import Draw, descriptions

ProblemName = StrEnum("ProblemName", {c.name: c.command for c in CALLS.values() if c.layout_name})  # type: ignore[misc]


class DrawName(StrEnum):
    rows = "rows"
    blocks = "blocks"


def plan(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="A table of rows: Parquet or Arrow (files, a folder, a pattern, a URL), .npy, HDF5, Zarr, ...",
        ),
    ],
    problem: Annotated[
        ProblemName | None,
        typer.Option("--problem", show_default=False, help="Pick and check the columns of this command."),
    ] = None,
    columns: Columns = None,
    dataset: Dataset = None,
    samples: Annotated[int, typer.Option(min=1, help="Number of samples.")] = 10,
    sample_size: Annotated[int, typer.Option(min=1, help="Rows in each.")] = 2000,
    draw: Annotated[DrawName, typer.Option(help=descriptions()["draw"].help)] = DrawName.rows,
    as_json: Annotated[bool, typer.Option("--json", help="Write the plan as JSON.")] = False,
) -> None:
    """Tell what a run would read, hold and take, before any work: estimates, from the description of the data alone."""
    from nonsac.method import planning
    from nonsac.sources.open import open_source

    layout = None if problem is None else CALLS[problem.name].layout
    source = open_source(file, layout=layout, columns=columns_of(columns), dataset=dataset)
    name: Draw = "blocks" if draw is DrawName.blocks else "rows"
    planned = planning.plan(source, samples=samples, sample_size=sample_size, draw=name)
    to_stdout(json.dumps(planned.to_dict(), indent=1) if as_json else str(planned))
