"""Options of the commands: those that settings are made into, those that several commands share, and their checks."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

import typer

from nonsac.calls.registry import CALLS, Call
from nonsac.method.settings import default_of, read_positive

if TYPE_CHECKING:
    from nonsac.cameras.camera import Camera
    from nonsac.layouts import Array

Command = TypeVar("Command", bound=Callable[..., Any])


def takes_settings(
    name: str, before: str, helps: Mapping[str, str] | None = None, initial: Mapping[str, str] | None = None
) -> Callable[[Command], Command]:
    """Gives a command an option for each setting of a call; it gets their values as keyword arguments.

    Parameters
    ----------
    name : str
        Of the call.
    before : str
        The parameter of the command that the options are shown before.
    helps : dict, optional
        What some options do, if it is to be said in another way than by the setting.
    initial : dict, optional
        What some are if they are not given, as text, if it differs from the call's.
    """
    call = CALLS[name]

    def decorated(command: Command) -> Command:
        hints = get_type_hints(command, include_extras=True)
        own = [p for p in inspect.signature(command).parameters.values() if p.kind is not p.VAR_KEYWORD]
        own = [p.replace(annotation=hints[p.name], kind=p.KEYWORD_ONLY) for p in own]
        place = [p.name for p in own].index(before)
        options = [_option(call, setting, helps or {}, initial or {}) for setting in call.texts.values()]
        signature = inspect.Signature([*own[:place], *options, *own[place:]])
        command.__signature__ = signature  # type: ignore[attr-defined]
        return command

    return decorated


def _option(call: Call, setting: str, helps: Mapping[str, str], initial: Mapping[str, str]) -> inspect.Parameter:
    """The option of a setting: text, which is checked and read as the call's own manifest would be."""
    description, default = call.settings[setting], initial.get(setting, initial_of(call, setting))
    option = typer.Option(
        "--" + (description.option or setting).replace("_", "-"),
        callback=lambda text: None if text is None else _read(call, setting, text),
        metavar=description.form,
        help=helps.get(setting, description.help),
        show_default=description.default if default is None else True,
    )
    kind: Any = str if default is not None else str | None
    return inspect.Parameter(
        setting, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, option]
    )


def initial_of(call: Call, setting: str) -> str | None:
    """What a setting is on the command line if it is not given, as text."""
    if setting in call.initial:
        return call.initial[setting]
    default = default_of(setting)
    return None if default is None else str(default)


def _read(call: Call, setting: str, text: str) -> Any:
    try:
        return call.read(setting, text)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def positive(text: str) -> float:
    """Reads a number that an option holds."""
    try:
        return read_positive(text)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


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


def columns_of(text: str | None) -> list[str | int] | None:
    """Names and positions, separated by commas."""
    if text is None:
        return None
    words = [word.strip() for word in text.split(",")]
    if not all(words):
        raise typer.BadParameter(
            f"{text!r} is no list of columns such as x1,y1,x2,y2 or 0,1,2,3", param_hint="'--columns'"
        )
    return [int(word) if word.isdecimal() else word for word in words]


_CAMERA = f"As in COLMAP's cameras.txt ('{_A_CAMERA}'), or fx,fy,cx,cy, or a file of K (three lines of three numbers)"
POSE_HELPS = {
    "noise": "Standard deviation of a right match, in pixels; without a camera in normalised coordinates.",
    "estimator": "Finds a model in one sample, by name: ransac, magsac, poselib, ...; nonsac compare can list all.",
}

Seed = Annotated[int, typer.Option(min=0, help="Same seed, same answer.")]
Workers = Annotated[int | None, typer.Option(min=1, show_default="all cores", help="Number of threads.")]
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
Hypotheses = Annotated[
    Path | None,
    typer.Option(
        "--picture-hypotheses",
        metavar="FILE",
        help="Draw what came of each sample: scores, inliers, which was selected, the answer (.png, .pdf or .svg).",
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
