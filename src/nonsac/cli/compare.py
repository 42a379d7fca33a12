"""Which method to take on one's own data."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from nonsac.calls.registry import CALLS
from nonsac.cli.inputs import bad, image_of
from nonsac.cli.messages import to_stderr, to_stdout, wrote
from nonsac.cli.options import (
    Camera1,
    Camera2,
    Columns,
    Dataset,
    OneCamera,
    Quiet,
    Seed,
    camera_of,
    columns_of,
    positive,
)
from nonsac.cli.outputs import Outputs
from nonsac.cli.planning import ProblemName
from nonsac.cli.session import session
from nonsac.method.settings import read_number, read_positive

if TYPE_CHECKING:
    from nonsac.calls.comparison import Comparison
    from nonsac.layouts import Layout

Value = TypeVar("Value")


def _list_of(read: Callable[[str], Value]) -> Callable[[str | None], str | None]:
    """Checks an option that is a list; it is used as `_listed`."""

    def check(text: str | None) -> str | None:
        if text is not None:
            _listed(text, read)
        return text

    return check


def _listed(text: str, read: Callable[[str], Value]) -> list[Value]:
    words = [word.strip() for word in text.split(",")]
    try:
        return [read(word) for word in words]
    except ValueError as error:
        raise typer.BadParameter(f"{error}; give them separated by commas") from None


def _word(text: str) -> str:
    if not text:
        raise ValueError("a name is missing")
    return text


def _simulation(text: str | None) -> str | None:
    """Checked here, used as `_simulated`."""
    if text is not None and len(_listed(text, float)) != 3:
        raise typer.BadParameter(f"{text!r} is not three numbers: rows, share of outliers, noise (20000,0.9,0.01)")
    return text


def _seconds(text: str) -> str:
    positive(text)
    return text


def compare(
    file: Annotated[
        str | None,
        typer.Argument(
            metavar="DATA",
            show_default=False,
            help="Matches of two images, image points matched to 3D points, or pairs of 3D points: whatever "
            "relative-pose, absolute-pose and register-pairs take.",
        ),
    ] = None,
    second: Annotated[
        Path | None,
        typer.Argument(metavar="SECOND", show_default=False, help="The matches of hloc, or the target of the pairs."),
    ] = None,
    problem: Annotated[
        ProblemName | None,
        typer.Option("--problem", show_default="by the columns", help="The command that the data are for."),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The true T: 4x4 text, or .json or .npz that holds it; DATA may do so."),
    ] = None,
    simulate: Annotated[
        str | None,
        typer.Option(
            metavar="ROWS,OUTLIERS,NOISE",
            callback=_simulation,
            help="Compare on simulated data of --problem, whose truth is known: 20000,0.9,0.01.",
        ),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES", callback=_list_of(_word), show_default="all", help="Core estimators: ransac,poselib."
        ),
    ] = None,
    uses: Annotated[
        str, typer.Option(metavar="NAMES", help="alone: on one sample, without NONSAC; core: as its core; or both.")
    ] = "alone,core",
    sizes: Annotated[
        str | None,
        typer.Option(
            metavar="INTEGERS",
            callback=_list_of(read_number(3)),
            show_default="2000 alone, auto as core",
            help="Rows in a sample: 500,2000.",
        ),
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="FLOATS",
            callback=_list_of(read_positive),
            show_default="measured",
            help="Standard deviations of a right match to compare: 0.5,1,2.",
        ),
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, max=1000, help="Runs of each, with different seeds.")] = 3,
    rules: Annotated[
        bool, typer.Option("--rules", help="Compare the paper's scoring rules, m and N instead of methods.")
    ] = False,
    samples: Annotated[
        str, typer.Option(metavar="INTEGERS", callback=_list_of(read_number(1)), help="With --rules: the paper's m.")
    ] = "10,20,30",
    time_limit: Annotated[
        str,
        typer.Option(
            metavar="SECONDS",
            callback=_seconds,
            help="For each run; a method that takes more is not run again on samples as large.",
        ),
    ] = "60",
    max_memory: Annotated[
        str, typer.Option(metavar="BYTES", help="Memory that a run may take beside what its process holds.")
    ] = "4 GB",
    workers: Annotated[
        int, typer.Option(min=1, max=256, help="Methods that run at once; times say most with one.")
    ] = 1,
    seed: Seed = 0,
    columns: Columns = None,
    dataset: Dataset = None,
    image1: Annotated[str | None, typer.Option(metavar="NAME", help="First image, of hloc or in a database.")] = None,
    image2: Annotated[str | None, typer.Option(metavar="NAME", help="Second image.")] = None,
    image: Annotated[str | None, typer.Option(metavar="NAME", help="Image of a COLMAP model.")] = None,
    camera1: Camera1 = None,
    camera2: Camera2 = None,
    camera: OneCamera = None,
    scale: Annotated[
        str | None,
        typer.Option(metavar="free|FLOAT", show_default="1", help="Of pairs: known, or 'free' to estimate it."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all numbers as JSON; '-' is stdout.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw accuracy (or held-out rows) against time (.png, .pdf or .svg)."),
    ] = None,
    listed: Annotated[
        bool, typer.Option("--list", help="Name all methods, say whether they are installed and how to get them.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Compare core estimators on data of your own, each in a process of its own, and say which one to take.

    Without --truth, methods are judged on rows that none of them saw. Methods that are too slow, too large or crash are
    told in the table.

    Exit 0: there is one to take. 1: none is to be trusted on these data.
    """
    if listed:
        to_stdout(_list(problem))
        return
    files = _Files(report, picture, quiet)
    inputs = _Inputs(file, second, problem, truth, simulate)
    files.check(inputs.paths())
    named = {
        "image1": None if image1 is None else image_of(image1),
        "image2": None if image2 is None else image_of(image2),
        "image": None if image is None else image_of(image),
        "camera1": None if camera1 is None else camera_of(camera1),
        "camera2": None if camera2 is None else camera_of(camera2),
        "camera": None if camera is None else camera_of(camera),
        "columns": columns_of(columns),
        "dataset": dataset,
    }
    settings = {name: value for name, value in named.items() if value is not None}
    if scale is not None:
        settings["scale"] = _scale(scale)
    with session(quiet, "runs") as progress:
        from nonsac.calls.compare import compare as run

        call, data, true_transform = inputs.opened(settings, seed)
        _check_methods(methods, call)
        comparison = run(
            call,
            *data,
            methods=None if methods is None else _listed(methods, _word),
            uses=_listed(uses, _word),
            sizes=None if sizes is None else _listed(sizes, int),
            noise=None if noise is None else _listed(noise, float),
            repeats=repeats,
            truth=true_transform,
            rules=rules,
            samples=_listed(samples, int),
            time_limit=float(time_limit),
            max_memory=max_memory,
            workers=workers,
            rng=seed,
            progress=progress,
            **settings,
        )
    files.deliver(comparison)
    raise typer.Exit(0 if comparison.best is not None else 1)


@dataclass(frozen=True)
class _Inputs:
    """The data, as they are named on the command line."""

    file: str | None
    second: Path | None
    problem: ProblemName | None
    truth: Path | None
    simulation: str | None

    def paths(self) -> Iterable[tuple[str, str | Path | None]]:
        return ("DATA", self.file), ("SECOND", self.second), ("--truth", self.truth)

    def opened(self, settings: dict[str, Any], seed: int) -> tuple[str, tuple[Any, ...], Any]:
        """The call, what it takes first, and the truth, if it is known."""
        if self.simulation is not None:
            return self._simulated(self.simulation, settings, seed)
        if self.file is None:
            raise bad("DATA", "name a file of matches, or give --simulate; --list names the methods")
        files = (self.file,) if self.second is None else (self.file, self.second)
        call = _fitting_call(files, settings) if self.problem is None else self.problem.name
        for name in settings:
            if name not in ("columns", "dataset", *CALLS[call].images, *CALLS[call].cameras, *CALLS[call].own):
                raise bad(f"--{name}", f"{CALLS[call].command} has no such option; leave it out")
        return call, files, self.truth

    def _simulated(self, text: str, settings: dict[str, Any], seed: int) -> tuple[str, tuple[Any, ...], Any]:
        from nonsac import simulate as generators

        for name, value in (("DATA", self.file), ("--truth", self.truth)):
            if value is not None:
                raise bad(name, "the data are simulated, and their truth is known; leave it out")
        for name in settings:
            if name != "scale":
                raise bad(f"--{name}", "the data are simulated, in normalised coordinates; leave it out")
        if self.problem is None:
            raise bad("--problem", "say what is to be simulated: relative-pose, absolute-pose or register-pairs")
        rows, outlier_ratio, noise = _listed(text, float)
        name = {"register_pairs": "registration"}.get(self.problem.name, self.problem.name)
        count = int(rows) if rows.is_integer() else rows
        try:
            made = getattr(generators, name)(count, outlier_ratio, noise, seed)
        except (TypeError, ValueError) as error:
            raise bad("--simulate", str(error)) from None
        first, second = list(vars(made).values())[:2]
        return self.problem.name, (first, second), made.T


def _fitting_call(files: tuple[str | Path, ...], settings: dict[str, Any]) -> str:
    """The call whose columns the files have."""
    from nonsac.io import open_matches

    fitting, errors = [], []
    for name in ProblemName.__members__:
        images = [settings.get(image) for image in CALLS[name].images]
        try:
            open_matches(_layout(name), files, images, settings.get("columns"), settings.get("dataset"))
            fitting.append(name)
        except (ValueError, OSError) as error:
            errors.append(error)
    if not fitting:
        raise (
            errors[0]
            if len(set(map(str, errors))) == 1
            else bad("--problem", f"{files[0]} fits no command by its columns; name one to learn why")
        )
    if len(fitting) > 1:
        fitting = _best_named(fitting, files[0]) or fitting
    if len(fitting) > 1:
        commands = " and ".join(CALLS[name].command for name in fitting)
        raise bad("--problem", f"{files[0]} fits {commands} by the number of its columns; name one")
    return fitting[0]


def _best_named(calls: list[str], file: str | Path) -> list[str]:
    """Of calls whose columns a file has, that which has most of them by name: x1, y1, x2 and y2 are in pairs, too."""
    from nonsac.files.arrays import open_npz
    from nonsac.sources.open import open_source

    try:
        if Path(file).suffix.lower() != ".npz":
            named = calls if open_source(file).about.names is not None else []
        else:
            with open_npz(file) as archive:
                held = set(archive.names)
            named = [name for name in calls if any(held.issuperset(keys) for keys in _layout(name).keys)]
    except (ValueError, OSError):
        return []
    return [max(named, key=lambda name: len(_layout(name).names))] if named else []


def _layout(call: str) -> Layout:
    layout = CALLS[call].layout
    assert layout is not None
    return layout


def _check_methods(methods: str | None, call: str) -> None:
    """Refuse methods that are not for these data, before the data are read."""
    from nonsac import problems
    from nonsac.estimators.named import estimators_for

    fitting = estimators_for(getattr(problems, CALLS[call].problem_name)())
    for name in [] if methods is None else _listed(methods, _word):
        if name not in fitting:
            raise bad("--methods", f"{name!r} is not one of {', '.join(fitting)} for {CALLS[call].command}")


def _scale(text: str) -> Any:
    try:
        return CALLS["register_pairs"].read("scale", text)
    except ValueError as error:
        raise bad("--scale", str(error)) from None


def _list(problem: ProblemName | None) -> str:
    """All methods, a line for each: what it is for, whether it is installed, and how to get it."""
    from nonsac import problems
    from nonsac.calls.compare import how_to_get
    from nonsac.estimators.named import ESTIMATORS, estimators_for

    chosen = list(ESTIMATORS)
    if problem is not None:
        chosen = estimators_for(getattr(problems, CALLS[problem.name].problem_name)())
    lines = []
    for name in chosen:
        named = ESTIMATORS[name]
        state = "installed" if named.is_installed else f"not installed: {how_to_get(name)}"
        fit = "any problem" if not named.problems else ", ".join(named.problems)
        lines.append((name, fit, state, named.about))
    widths = [max(len(line[column]) for line in lines) for column in range(3)]
    return "\n".join("  ".join([*map(str.ljust, line[:3], widths), line[3]]) for line in lines)


@dataclass(frozen=True)
class _Files:
    """Where a comparison goes: to the screen as a table, or as JSON to stdout; into files besides."""

    report: Path | None
    picture: Path | None
    quiet: bool

    @property
    def is_json(self) -> bool:
        return self.report == Path("-")

    def check(self, inputs: Iterable[tuple[str, str | Path | None]]) -> None:
        Outputs(picture=self.picture, report=None if self.is_json else self.report).check(inputs)

    def deliver(self, comparison: Comparison) -> None:
        silent = self.is_json or self.quiet
        if self.is_json:
            to_stdout(comparison.to_json(indent=1))
        elif sys.stdout.isatty():
            from rich.console import Console

            Console().print(comparison.table())
            to_stdout("\n".join([*(f"remark: {remark}" for remark in comparison.remarks), comparison.recommendation]))
        else:
            to_stdout(str(comparison))
        if self.report is not None and not self.is_json:
            comparison.save(self.report)
            wrote(self.report, "all numbers", silent)
        if self.picture is not None:
            if all(row.cpu_seconds is None for row in comparison.rows):
                to_stderr(f"{self.picture} is NOT WRITTEN: no method gave anything to draw")
                return
            comparison.draw(self.picture)
            wrote(self.picture, "the picture", silent)
