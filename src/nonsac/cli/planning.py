"""What a run would cost."""

from __future__ import annotations

import json
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from nonsac.cli.messages import tell
from nonsac.cli.options import Columns, Dataset
from nonsac.cli.rows import open_rows

if TYPE_CHECKING:
    from nonsac.layouts import Columns as Layout


class ProblemName(StrEnum):
    """Choices of --problem."""

    relative_pose = "relative-pose"
    absolute_pose = "absolute-pose"
    register_pairs = "register-pairs"


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
    as_json: Annotated[bool, typer.Option("--json", help="Write the plan as JSON.")] = False,
) -> None:
    """Tell what a run would read, hold and take, before any work: estimates, from the description of the data alone."""
    from nonsac.method import planning

    planned = planning.plan(
        open_rows(file, _layout(problem), columns, dataset), samples=samples, sample_size=sample_size
    )
    tell(json.dumps(planned.to_dict(), indent=1) if as_json else str(planned))


def _layout(problem: ProblemName | None) -> Layout | None:
    from nonsac import layouts as known

    layouts = {
        ProblemName.relative_pose: known.MATCHES,
        ProblemName.absolute_pose: known.POINTS,
        ProblemName.register_pairs: known.PAIRS,
    }
    return None if problem is None else layouts[problem]
