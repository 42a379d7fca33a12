"""Options that several commands share, and their checks."""

from __future__ import annotations

import os
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from nonsac.cameras.camera import Camera
    from nonsac.result import Array


class LastFit(StrEnum):
    """Choices of --refine."""

    union = "union"
    polish = "polish"
    full = "full"
    none = "none"


def positive(value: float | None) -> float | None:
    if value is not None and not 0 < value < float("inf"):
        raise typer.BadParameter(f"{value:g} is not a positive number")
    return value


def count_from(least: int) -> Callable[[str], str]:
    """A check of what is used as `count_of`: typer knows no type `int | "auto"`."""

    def check(text: str) -> str:
        if text != "auto" and not (text.isdecimal() and int(text) >= least):
            raise typer.BadParameter(f"{text!r} is neither a number of at least {least} nor 'auto'")
        return text

    return check


def count_of(text: str) -> int | Literal["auto"]:
    return "auto" if text == "auto" else int(text)


def workers(text: str | None) -> str | None:
    """Checked here, used as `workers_of`."""
    if text is not None and "://" not in text and not (text.isdecimal() and int(text) >= 1):
        raise typer.BadParameter(f"{text!r} is neither a number of at least 1 nor an address (tcp://host:8786)")
    return text


def workers_of(text: str | None) -> int | str | None:
    return int(text) if text is not None and text.isdecimal() else text


def memory(text: str | None) -> str | None:
    """Checked here, used as it is."""
    if text is not None:
        from nonsac.running.memory import bytes_of

        try:
            bytes_of(text)
        except ValueError:
            raise typer.BadParameter(f"{text!r} is no number of bytes, such as 500000000 or '500 MB'") from None
    return text


def scale(text: str) -> str:
    """Checked here, used as `scale_of`: typer knows no type `float | "free"`."""
    if text != "free":
        try:
            positive(float(text))
        except ValueError:
            raise typer.BadParameter(f"{text!r} is neither a positive number nor 'free'") from None
    return text


def scale_of(text: str) -> float | None:
    return None if text == "free" else float(text)


def camera(text: str | None) -> str | None:
    """Checked here, used as `camera_of`: a type of the package itself would have to be imported for `--help`."""
    if text is not None:
        camera_of(text)
    return text


def camera_of(text: str) -> Camera:
    """A line of COLMAP's cameras.txt, four numbers, or the file of a matrix K."""
    from nonsac.cameras.camera import Camera

    words = text.replace(",", " ").split()
    try:
        if os.path.isfile(text):
            return Camera.parse(_read_matrix(Path(text)), text)
        if words and _are_numbers(words):
            return Camera("PINHOLE", tuple(map(float, words)))
        if len(words) > 1:
            return Camera.parse(text, "camera")
    except ValueError as error:
        raise typer.BadParameter(str(error).removeprefix("camera: ")) from None
    raise typer.BadParameter(f"{text!r} is neither a file nor a camera such as '{_A_CAMERA}' or 1000,1000,800,600")


_A_CAMERA = "PINHOLE 1600 1200 1000 1000 800 600"


def _read_matrix(path: Path) -> Array:
    from nonsac.files.errors import input_error
    from nonsac.files.text import read_table

    table = read_table(path)
    shape = (sum(1 for _ in table.rows()), len(table.first_row()))
    if shape != (3, 3):
        raise input_error(
            path, f"holds {shape[0]} rows of {shape[1]} columns", "write K as three lines of three numbers"
        )
    return table.numbers(range(3))


def _are_numbers(words: list[str]) -> bool:
    from nonsac.files.text import is_number

    return all(map(is_number, words))


_SAMPLE_SIZE = "Rows in each; with 'auto' more where inliers are few."
_COUNT = "auto|INTEGER"
_CAMERA = f"As in COLMAP's cameras.txt ('{_A_CAMERA}'), or fx,fy,cx,cy, or a file of K (three lines of three numbers)"

Samples = Annotated[
    str,
    typer.Option(callback=count_from(1), metavar=_COUNT, help="Number of samples; with 'auto' as many as it takes."),
]
SampleSizeOf3 = Annotated[str, typer.Option("--sample-size", callback=count_from(3), metavar=_COUNT, help=_SAMPLE_SIZE)]
SampleSizeOf5 = Annotated[str, typer.Option("--sample-size", callback=count_from(5), metavar=_COUNT, help=_SAMPLE_SIZE)]
MaxSamples = Annotated[int, typer.Option(min=1, help="Where --samples auto gives up.")]
TimeLimit = Annotated[
    float | None,
    typer.Option(callback=positive, metavar="SECONDS", help="Begin no further sample after this time."),
]
Seed = Annotated[int, typer.Option(min=0, help="Same seed, same answer.")]
Workers = Annotated[int | None, typer.Option(min=1, show_default="all cores", help="Number of threads.")]
AnyWorkers = Annotated[
    str | None,
    typer.Option(
        "--workers",
        callback=workers,
        metavar="INTEGER|ADDRESS",
        show_default="all cores",
        help="Number of threads, or the address of a Dask scheduler (tcp://host:8786).",
    ),
]
MaxMemory = Annotated[
    str | None,
    typer.Option(
        callback=memory,
        metavar="BYTES",
        help="Memory for the sampled rows, as '500 MB': bounds the samples, and the rows of the last fit.",
    ),
]
Refine = Annotated[
    LastFit,
    typer.Option(help="The last fit: to the sampled rows, to 100,000, to all rows (in passes over them), or none."),
]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress bar and no notes; warnings and errors remain.")]
AsJson = Annotated[bool, typer.Option("--json", help="Write the result to stdout as JSON, and nothing else there.")]
Transform = Annotated[Path | None, typer.Option("--output", metavar="FILE", help="Write T as 4x4 text with 17 digits.")]
Inliers = Annotated[
    Path | None,
    typer.Option(
        "--save-inliers",
        metavar="FILE",
        help="Write which rows are inliers: bool (.npy), or 0 or 1 a line (.txt, .csv).",
    ),
]
PoseNoise = Annotated[
    float | None,
    typer.Option(
        callback=positive,
        show_default="measured",
        help="Standard deviation of a right match, in pixels; without a camera in normalised coordinates.",
    ),
]
Camera1 = Annotated[
    str | None,
    typer.Option(
        callback=camera,
        metavar="CAMERA",
        show_default="that of the file",
        help=f"Camera of the first image. {_CAMERA}.",
    ),
]
Camera2 = Annotated[
    str | None,
    typer.Option(
        callback=camera,
        metavar="CAMERA",
        show_default="that of the file, else of the first image",
        help="Camera of the second image, likewise.",
    ),
]
OneCamera = Annotated[
    str | None,
    typer.Option("--camera", callback=camera, metavar="CAMERA", show_default="that of the file", help=f"{_CAMERA}."),
]
Columns = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        show_default="by name",
        help="Columns of the rows, in order: names or positions from 0, separated by commas (x1,y1,x2,y2).",
    ),
]
Dataset = Annotated[
    str | None,
    typer.Option(metavar="NAME", show_default="the only one", help="Array of an HDF5 file, a Zarr group or an .npz."),
]
Photo = Annotated[
    Path | None, typer.Option(metavar="FILE", help="The image, to be drawn behind the points of --picture.")
]
