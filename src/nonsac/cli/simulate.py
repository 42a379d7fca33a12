"""Simulated matches in files."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nonsac.cli.messages import to_stdout
from nonsac.cli.options import Quiet, Seed
from nonsac.cli.session import session
from nonsac.files.identity import identity_of

if TYPE_CHECKING:
    from nonsac.layouts import Array


class SimulatedProblem(StrEnum):
    """Choices of PROBLEM."""

    relative_pose = "relative-pose"
    absolute_pose = "absolute-pose"
    registration = "registration"


class Precision(StrEnum):
    """Choices of --dtype."""

    float32 = "float32"
    float64 = "float64"


def _number(text: str) -> str:
    """Checked here, used as `int(float(...))`: 1e8 is easier to get right than 100000000."""
    try:
        whole = float(text).is_integer() and float(text) >= 1
    except ValueError:
        whole = False
    if not whole:
        raise typer.BadParameter(f"{text!r} is not a whole number of at least 1, such as 1e8")
    return text


def simulate(
    problem: Annotated[SimulatedProblem, typer.Argument(metavar="PROBLEM", help="What the matches are for.")],
    n: Annotated[str, typer.Option("-n", callback=_number, metavar="INTEGER", help="Number of rows, such as 1e8.")],
    outlier_ratio: Annotated[float, typer.Option(min=0.0, max=1.0, help="Share of wrong matches.")],
    noise: Annotated[
        float, typer.Option(min=0.0, help="Standard deviation of a right match: in normalised coordinates, or lengths.")
    ],
    output: Annotated[
        Path, typer.Option(metavar="FILE", help="Where to write the rows (.npy, or .parquet with named columns).")
    ],
    seed: Seed = 0,
    dtype: Annotated[Precision, typer.Option(help="Type of the numbers in the file.")] = Precision.float64,
    row_group: Annotated[int, typer.Option(min=1, help="Rows in each row group of a Parquet file.")] = 1_000_000,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the true T as 4x4 text, or what is printed (.json)."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Write simulated matches to a file of any size, and print the true T as JSON.

    Columns: x1 y1 x2 y2 (relative-pose), u v X Y Z (absolute-pose), x1 y1 z1 x2 y2 z2 (registration).

    Image points are in normalised coordinates.
    """
    _check_truth(truth, output)
    rows = int(n) if n.isdecimal() else int(float(n))
    with session(quiet, "rows") as progress:
        from nonsac.simulate import to_file

        T = to_file(
            output,
            problem.value,
            rows,
            outlier_ratio,
            noise,
            seed,
            dtype=dtype.value,
            row_group=row_group,
            progress=progress,
        )
    facts = {
        "problem": problem.value,
        "output": str(output),
        "rows": rows,
        "outliers": round(outlier_ratio * rows),
        "noise": noise,
        "seed": seed,
        "T": T.tolist(),
    }
    text = json.dumps(facts, indent=1)
    to_stdout(text)
    if truth is not None:
        _write_truth(truth, T, text)


def _check_truth(truth: Path | None, output: Path) -> None:
    from nonsac.files.atomic import check_target

    if truth is None:
        return
    try:
        check_target(truth)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="'--truth'") from error
    if truth.suffix.lower() in (".npy", ".parquet"):
        problem = f"{truth}: T is written as text; end the name in .txt or .json"
        raise typer.BadParameter(problem, param_hint="'--truth'")
    if identity_of(truth) == identity_of(output):
        raise typer.BadParameter(f"{truth} is already used for --output", param_hint="'--truth'")


def _write_truth(path: Path, T: Array, text: str) -> None:
    from nonsac.files.atomic import write_atomically
    from nonsac.io import write_transform

    if path.suffix.lower() == ".json":
        write_atomically(path, lambda temporary: temporary.write_text(text + "\n", encoding="utf-8"))
    else:
        write_transform(path, T)
