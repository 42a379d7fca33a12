"""The command line. Results go to stdout, everything else to stderr; exit 0 trusted, 1 not trusted, 2 bad input."""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

# The rest of nonsac is imported where it is needed: `--help` and a mistyped option answer at once.
if TYPE_CHECKING:
    from nonsac.result import Array, Result
    from nonsac.simulate import CloudPair

Progress = Callable[[int, int], None]

# Click's own type, which newer versions of typer carry inside themselves.
_UsageError: Any = typer.BadParameter.__bases__[0]

_INTERRUPTED = 130

_SETTINGS: dict[str, Any] = {"add_completion": False, "pretty_exceptions_enable": False}
app = typer.Typer(help="Robust geometric estimation from data too large or too dirty for anything else.", **_SETTINGS)
reproduce = typer.Typer(help="Run the paper's experiments.", **_SETTINGS)
app.add_typer(reproduce, name="reproduce")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        What follows `nonsac`; by default that of the process.

    Returns
    -------
    int
        The exit code: 0 trusted, 1 not trusted, 2 bad usage or input, 130 interrupted.
    """
    try:
        code = int(app(arguments, prog_name="nonsac", standalone_mode=False) or 0)
    except (KeyboardInterrupt, typer.Abort):
        code = _INTERRUPTED
    except _UsageError as error:
        _say(error.format_message())
        return 2
    except OSError as error:
        _say(f"{error.filename}: {error.strerror}" if error.filename else str(error))
        return 2
    except ValueError as error:
        _say(str(error))
        return 2
    if code == _INTERRUPTED:  # some versions of typer raise, others return it
        _say("interrupted")
    return code


# --- options -----------------------------------------------------------


def _positive(value: float) -> float:
    if not 0 < value < float("inf"):
        raise typer.BadParameter(f"{value:g} is not a positive number")
    return value


def _scale(text: str) -> str:
    """Checked here, used as `_scale_of`: typer knows no type `float | "free"`."""
    if text != "free":
        try:
            _positive(float(text))
        except ValueError:
            raise typer.BadParameter(f"{text!r} is neither a positive number nor 'free'") from None
    return text


def _scale_of(text: str) -> float | None:
    return None if text == "free" else float(text)


Samples = Annotated[int, typer.Option(min=1, help="Draw at most this many samples.")]
SampleSize = Annotated[int, typer.Option(min=3, help="Rows in each sample.")]
Seed = Annotated[int, typer.Option(min=0, help="Same seed, same answer.")]
Workers = Annotated[int | None, typer.Option(min=1, show_default="all cores", help="Number of threads.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress bar and no notes; warnings and errors remain.")]
AsJson = Annotated[bool, typer.Option("--json", help="Write the result to stdout as JSON, and nothing else there.")]
Transform = Annotated[
    Path | None,
    typer.Option("--output", metavar="FILE", help="Write T, which maps source to target, as 4x4 text with 17 digits."),
]
Aligned = Annotated[
    Path | None,
    typer.Option(
        "--save-aligned", metavar="FILE", help="Write the source's points moved by T (.ply, .npy, .xyz, ...)."
    ),
]
Picture = Annotated[
    Path | None,
    typer.Option("--picture", metavar="FILE", help="Draw both clouds before and after (.png, .pdf or .svg)."),
]


# --- commands ----------------------------------------------------------


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"nonsac {version('nonsac')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _nonsac(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    _help_without_command(context)


@reproduce.callback(invoke_without_command=True)
def _reproduce(context: typer.Context) -> None:
    _help_without_command(context)


def _help_without_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def register_clouds(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="Cloud to move (.ply, .pcd, .xyz, .npy, .las, ...).")
    ],
    target: Annotated[Path, typer.Argument(metavar="TARGET", help="Cloud that stays.")],
    samples: Samples = 40,
    sample_size: SampleSize = 2000,
    seed: Seed = 0,
    workers: Workers = None,
    output: Transform = None,
    save_aligned: Aligned = None,
    picture: Picture = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Register two raw point clouds: no matches, no descriptors, no initial guess."""
    outputs = Outputs(output, save_aligned, picture)
    outputs.check({"SOURCE": source, "TARGET": target})
    with _session(quiet, "samples") as progress:
        from nonsac import api
        from nonsac.io import read_cloud

        clouds = read_cloud(source), read_cloud(target)
        result = api.register_clouds(
            *clouds, samples=samples, sample_size=sample_size, workers=workers, rng=seed, progress=progress
        )
    _finish(result, clouds, (source.name, target.name), outputs, as_json)


@app.command()
def register_pairs(
    pairs: Annotated[
        Path,
        typer.Argument(metavar="PAIRS", help="Matched points, six numbers a row; or the source, if SECOND is given."),
    ],
    noise: Annotated[
        float, typer.Option(callback=_positive, help="Standard deviation of a right match, in the unit of the data.")
    ],
    second: Annotated[
        Path | None, typer.Argument(metavar="SECOND", show_default=False, help="The target, matched row by row.")
    ] = None,
    scale: Annotated[
        str, typer.Option(callback=_scale, metavar="free|FLOAT", help="Scale of T: known, or 'free' to estimate it.")
    ] = "1",
    samples: Samples = 10,
    sample_size: SampleSize = 2000,
    seed: Seed = 0,
    workers: Workers = None,
    output: Transform = None,
    save_aligned: Aligned = None,
    picture: Picture = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Register matched points, most of which may be matched wrongly."""
    outputs = Outputs(output, save_aligned, picture)
    outputs.check({"PAIRS": pairs} | ({"SECOND": second} if second else {}))
    with _session(quiet, "samples") as progress:
        from nonsac import api
        from nonsac.io import read_pairs

        points = read_pairs(pairs, second)
        result = api.register_pairs(
            *points,
            noise=noise,
            scale=_scale_of(scale),
            samples=samples,
            sample_size=sample_size,
            workers=workers,
            rng=seed,
            progress=progress,
        )
    names = (pairs.name, second.name) if second else ("source", "target")
    _finish(result, points, names, outputs, as_json)


@app.command()
def demo(
    picture: Annotated[
        Path, typer.Option("--picture", metavar="FILE", help="Where to draw the scans before and after.")
    ] = Path("demo.png"),
    seed: Seed = 0,
    workers: Workers = None,
    save_scans: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Write the scans and the true transform to this folder, made if missing."),
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Register two simulated scans of an elephant, and compare with the truth."""
    outputs = Outputs(picture=picture)
    outputs.check({})
    with _session(quiet, "samples") as progress:
        from nonsac import api, simulate

        scans = simulate.demo_scans(seed)
        if save_scans is not None:
            _write_scans(save_scans, scans, as_json)
        result = api.register_clouds(scans.source, scans.target, workers=workers, rng=seed, progress=progress)
    error = _errors(result, scans.T)
    if not as_json:
        _print(f"two scans of {len(scans.source):,} points, overlap {scans.overlap:.2f}, turned at random")
        if _is_found(result):
            _print(f"off the truth by {error['rotation_deg']:.3f} deg and {error['translation']:.2g} in translation")
    more = {"truth": {"T": scans.T.tolist(), "overlap": scans.overlap}, "error": error}
    _finish(result, (scans.source, scans.target), ("source", "target"), outputs, as_json, more)


@app.command()
def warmup() -> None:
    """Compile all kernels now, so that no later run has to wait for it."""
    with _session(False, "problems") as progress:
        from nonsac import Pcr99, api, simulate

        scans = simulate.demo_scans(0, points=1500)
        pairs = simulate.registration(300, 0.5, 0.01, 0)
        tasks: list[Callable[[], object]] = [
            lambda: api.register_clouds(scans.source, scans.target, samples=2),
            lambda: api.register_pairs(pairs.source, pairs.target, noise=0.01),
            lambda: api.register_pairs(pairs.source, pairs.target, noise=0.01, scale=None),
            lambda: api.register_pairs(pairs.source, pairs.target, noise=0.01, estimator=Pcr99(order="random")),
        ]
        for done, task in enumerate(tasks):
            progress(done, len(tasks))
            task()
    _print("all kernels are compiled")


@reproduce.command()
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
    outputs.check({"--cloud": cloud})
    with _session(quiet, "trials") as progress:
        from nonsac.reproduce import table4 as experiment

        report = experiment.run(cloud, trials, seed, workers, progress)
    text = json.dumps(report, indent=1, allow_nan=False)
    if to_stdout:
        _print(text)
    else:
        import rich

        rich.print(experiment.table(report))
    if outputs.report is not None:
        from nonsac.io import write_atomically

        write_atomically(outputs.report, lambda temporary: temporary.write_text(text + "\n", encoding="utf-8"))
        _wrote(outputs.report, "all numbers", to_stdout)
    if picture is not None:
        experiment.picture(picture, report)
        _wrote(picture, "the picture", to_stdout)


# --- what is written ---------------------------------------------------


@dataclass(frozen=True)
class Outputs:
    """The files asked for. All are checked before the computation, so that nobody waits for a mistyped suffix."""

    transform: Path | None = None
    aligned: Path | None = None
    picture: Path | None = None
    report: Path | None = None

    def check(self, inputs: dict[str, Path]) -> None:
        """Refuse unknown suffixes, missing folders, and the same path twice."""
        from nonsac.io import check_target

        taken = {os.path.realpath(path): name for name, path in inputs.items()}
        for option, path, check_suffix in self._wanted():
            try:
                check_suffix(path)
                check_target(path)
            except ValueError as error:
                raise typer.BadParameter(str(error), param_hint=repr(option)) from error
            other = taken.setdefault(os.path.realpath(path), option)
            if other != option:
                raise typer.BadParameter(f"{path} is already used for {other}", param_hint=repr(option))

    def _wanted(self) -> Iterator[tuple[str, Path, Callable[[Path], object]]]:
        from nonsac.io.clouds import WRITERS, choose_by_suffix
        from nonsac.plot import picture_suffix

        checks: tuple[tuple[str, Path | None, Callable[[Path], object]], ...] = (
            ("--output", self.transform, _text_suffix),
            ("--save-aligned", self.aligned, lambda path: choose_by_suffix(path, WRITERS)),
            ("--picture", self.picture, picture_suffix),
            ("--json", self.report, lambda path: None),
        )
        return ((option, path, check) for option, path, check in checks if path is not None)

    def write(self, result: Result, source: Array, target: Array, quietly: bool) -> None:
        """Write the files, and say so."""
        from nonsac.io import write_cloud, write_transform

        if self.transform is not None and _worth_writing(self.transform, "T", result):
            write_transform(self.transform, result.T)
            _wrote(self.transform, "T", quietly)
        if self.aligned is not None and _worth_writing(self.aligned, "the source moved by T", result):
            write_cloud(self.aligned, result.apply(source))
            _wrote(self.aligned, f"the {len(source):,} source points moved by T", quietly)
        if self.picture is not None:
            _draw(self.picture, result, source, target, quietly)


def _worth_writing(path: Path, what: str, result: Result) -> bool:
    """Whether there is an answer; says loudly where there is none, or one that is not to be trusted."""
    found = _is_found(result)
    if not found:
        _say(f"{path} is NOT WRITTEN: no answer was found")
    elif not result.success:
        _say(f"{path} holds {what}, and T is a guess that is NOT TRUSTED")
    return found


def _draw(path: Path, result: Result, source: Array, target: Array, quietly: bool) -> None:
    import numpy as np

    from nonsac import plot

    if not all(np.isfinite(cloud).all(axis=1).any() for cloud in (source, target)):
        _say(f"{path} is NOT WRITTEN: a cloud has no finite point to draw")
        return
    title = f"trusted, {100 * result.inlier_ratio:.0f} % inliers"
    if not result.success:
        title = f"NOT TRUSTED: {result.status.replace('_', ' ')}"
    plot.clouds(path, source, target, result.T, title)
    _wrote(path, "the picture", quietly)


def _text_suffix(path: Path) -> None:
    from nonsac.io.clouds import READERS, TEXT_SUFFIXES

    others = {*READERS, ".png", ".pdf", ".svg"} - set(TEXT_SUFFIXES)
    if path.suffix.lower() in others:
        raise ValueError(f"{path}: T is written as text; end the name in .txt (the moved cloud is --save-aligned)")


def _finish(
    result: Result,
    clouds: tuple[Array, Array],
    names: tuple[str, str],
    outputs: Outputs,
    as_json: bool,
    more: dict[str, Any] | None = None,
) -> None:
    """Print the result first, so that a full disk cannot take it away; then write the files."""
    if as_json:
        _print(json.dumps(result.to_dict() | (more or {}), indent=1, allow_nan=False))
    else:
        _print(_described(result, *names))
    if not result.success:
        _say(f"NOT TRUSTED ({result.status}): {result.status.explanation}")
    outputs.write(result, *clouds, quietly=as_json)
    raise typer.Exit(0 if result.success else 1)


def _described(result: Result, source: str, target: str) -> str:
    if not _is_found(result):
        return repr(result)
    rows = "\n".join("  " + " ".join(f"{x:15.9g}" for x in row) for row in result.T)
    return f"{result!r}\nT, which moves {source} onto {target}; lengths are in the unit of the data:\n{rows}"


def _errors(result: Result, truth: Array) -> dict[str, float | None]:
    from nonsac.evaluation import rotation_error, translation_error

    if not _is_found(result):
        return {"rotation_deg": None, "translation": None}
    return {
        "rotation_deg": float(rotation_error(result.R, truth[:3, :3])),
        "translation": float(translation_error(result.t, truth[:3, 3])),
    }


def _write_scans(folder: Path, scans: CloudPair, quietly: bool) -> None:
    from nonsac.io import write_cloud, write_transform

    folder.mkdir(parents=True, exist_ok=True)
    write_cloud(folder / "source.ply", scans.source)
    write_cloud(folder / "target.ply", scans.target)
    write_transform(folder / "T.txt", scans.T)
    _wrote(folder, "source.ply, target.ply, and the true T.txt", quietly)


def _is_found(result: Result) -> bool:
    import numpy as np

    return bool(np.isfinite(result.T).all())


def _wrote(path: Path, what: str, quietly: bool) -> None:
    if not quietly:
        _print(f"wrote {path}: {what}")


def _print(text: str) -> None:
    typer.echo(text)


def _say(message: str) -> None:
    """One line on stderr."""
    typer.echo(f"nonsac: {' '.join(message.split())}", err=True)


# --- while it runs -----------------------------------------------------


@contextmanager
def _session(quiet: bool, unit: str) -> Iterator[Progress]:
    """Tell of warnings, compiling and progress on stderr."""
    with warnings.catch_warnings(), _compiling_noted(quiet), _progress_bar(quiet, unit) as progress:
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = lambda message, *_: _say(f"warning: {message}")
        yield progress


@contextmanager
def _compiling_noted(quiet: bool) -> Iterator[None]:
    """Say once that kernels are compiled, if any is: one that numba finds in its cache is not."""
    from numba.core import event

    class Listener(event.Listener):
        told = quiet

        def on_start(self, event: object) -> None:
            if not self.told:
                self.told = True
                _say("compiling kernels (first run only) ...")

        def on_end(self, event: object) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield


@contextmanager
def _progress_bar(quiet: bool, unit: str) -> Iterator[Progress]:
    if quiet or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn(unit), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(unit, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
