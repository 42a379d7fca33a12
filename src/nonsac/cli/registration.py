"""Register clouds, and matched points."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nonsac.calls.registry import CALLS
from nonsac.cli.inputs import Table, bad, check_pairs
from nonsac.cli.messages import wrote
from nonsac.cli.options import (
    AsJson,
    Columns,
    Dataset,
    Hypotheses,
    Inliers,
    Quiet,
    Seed,
    Transform,
    Workers,
    takes_settings,
)
from nonsac.cli.outputs import Draw, Outputs, matrix_text, worth_writing
from nonsac.cli.run import Flow, Options, SomeRows, run

if TYPE_CHECKING:
    from nonsac.layouts import Array
    from nonsac.result import Result
    from nonsac.simulate import CloudPair

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


@takes_settings("register_clouds", before="output")
def register_clouds(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="Cloud to move (.ply, .pcd, .xyz, .npy, .las, ...).")
    ],
    target: Annotated[Path, typer.Argument(metavar="TARGET", help="Cloud that stays.")],
    output: Transform = None,
    save_aligned: Aligned = None,
    picture: Picture = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    **settings: Any,
) -> None:
    """Register two raw point clouds: no matches, no descriptors, no initial guess.

    T maps the source to the target.
    """
    outputs = Outputs(transform=output, aligned=save_aligned, picture=picture)
    options = Options(settings, outputs, as_json, quiet)
    run(_Clouds(options, (source.name, target.name), (source, target)), CALLS["register_clouds"], options)


@takes_settings(
    "register_pairs",
    before="output",
    helps={"noise": "Standard deviation of a right match, in the unit of the data."},
)
def register_pairs(
    file: Annotated[
        str,
        typer.Argument(
            metavar="PAIRS",
            help="Matched points, six numbers a row (.npz, .npy, .csv, .txt, Parquet, Arrow, HDF5, Zarr; also a folder "
            "or URL); or the source, if SECOND is given.",
        ),
    ],
    second: Annotated[
        Path | None, typer.Argument(metavar="SECOND", show_default=False, help="The target, matched row by row.")
    ] = None,
    columns: Columns = None,
    dataset: Dataset = None,
    output: Transform = None,
    save_aligned: Aligned = None,
    save_inliers: Inliers = None,
    picture: Picture = None,
    picture_hypotheses: Hypotheses = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    **settings: Any,
) -> None:
    """Register matched points, most of which may be matched wrongly.

    T maps the source to the target.
    """
    outputs = Outputs(output, save_aligned, save_inliers, picture, picture_hypotheses)
    options = Options(settings, outputs, as_json, quiet)
    names = (Path(file).name, second.name) if second else ("source", "target")
    run(_Pairs(options, names, Table(file, second, (), columns, dataset)), CALLS["register_pairs"], options)


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
    options = Options({"workers": workers, "rng": seed}, Outputs(picture=picture), as_json, quiet)
    run(_Demo(options, ("source", "target"), save_scans), CALLS["register_clouds"], options)


@dataclass
class _TwoClouds(Flow):
    """What the commands have in common that move one cloud to another."""

    options: Options
    names: tuple[str, str]
    clouds: tuple[Array, Array] = field(init=False)

    def described(self, result: Result) -> tuple[str, dict[str, Any]]:
        if not result.found:
            return repr(result), {}
        what = f"T, which moves {self.names[0]} onto {self.names[1]}; lengths are in the unit of the data"
        return f"{result!r}\n{what}:\n{matrix_text(result)}", {}

    def drawing(self, result: Result) -> Draw | None:
        import numpy as np

        from nonsac import plot

        source, target = self.clouds
        if not all(np.isfinite(cloud).all(axis=1).any() for cloud in (source, target)):
            return None
        return lambda path, title: plot.clouds(path, source, target, result.T, title)

    def finish(self, result: Result) -> None:
        path = self.options.outputs.aligned
        if path is None or not worth_writing(path, "the source moved by T", result):
            return
        from nonsac.io import write_cloud

        source = self.source_points()
        write_cloud(path, result.apply(source))
        wrote(path, f"the {len(source):,} source points moved by T", self.options.silent)

    def source_points(self) -> Array:
        """All points of the source."""
        return self.clouds[0]


class _Clouds(_TwoClouds):
    def __init__(self, options: Options, names: tuple[str, str], paths: tuple[Path, Path]) -> None:
        super().__init__(options, names)
        self.paths = paths

    def inputs(self) -> Iterable[tuple[str, str | Path | None]]:
        return zip(("SOURCE", "TARGET"), self.paths, strict=True)

    def open(self) -> tuple[Any, ...]:
        from nonsac.io import read_cloud

        self.clouds = read_cloud(self.paths[0]), read_cloud(self.paths[1])
        return self.clouds


class _Pairs(_TwoClouds):
    def __init__(self, options: Options, names: tuple[str, str], table: Table) -> None:
        super().__init__(options, names)
        self.table = table

    def inputs(self) -> Iterable[tuple[str, str | Path | None]]:
        return ("PAIRS", self.table.file), ("SECOND", self.table.second)

    def check(self) -> None:
        check_pairs(self.table)

    def open(self) -> tuple[Any, ...]:
        self.opened = self.table.opened("PAIRS")
        if self.options.outputs.aligned is not None and not self.opened.is_small:
            problem = f"{self.table.file} is read in pieces, never whole; write T with --output, and apply it"
            raise bad("--save-aligned", problem)
        self.some = SomeRows(self.opened, self.options.outputs.picture)
        first, second = self.table.parts("PAIRS", self.some.rows, len(self.some.source))
        self.clouds = first, second
        return (self.opened.source,)

    def source_points(self) -> Array:
        import numpy as np

        return np.concatenate([rows[:, :3] for rows in self.opened.source.chunks(2**20)])

    def finish(self, result: Result) -> None:
        super().finish(result)
        self.some.note_share(self.options.quiet)


class _Demo(_TwoClouds):
    def __init__(self, options: Options, names: tuple[str, str], folder: Path | None) -> None:
        super().__init__(options, names)
        self.folder = folder

    def inputs(self) -> Iterable[tuple[str, str | Path | None]]:
        return ()

    def open(self) -> tuple[Any, ...]:
        from nonsac import simulate

        self.scans = simulate.demo_scans(self.options.settings["rng"])
        if self.folder is not None:
            _write_scans(self.folder, self.scans, self.options.silent)
        self.clouds = self.scans.source, self.scans.target
        return self.clouds

    def described(self, result: Result) -> tuple[str, dict[str, Any]]:
        scans, error = self.scans, _errors(result, self.scans.T)
        lines = [f"two scans of {len(scans.source):,} points, overlap {scans.overlap:.2f}, turned at random"]
        if result.found:
            off = f"{error['rotation_deg']:.3f} deg and {error['translation']:.2g} in translation"
            lines.append(f"off the truth by {off}")
        text, _ = super().described(result)
        more = {"truth": {"T": scans.T.tolist(), "overlap": scans.overlap}, "error": error}
        return "\n".join([*lines, text]), more


def _errors(result: Result, truth: Array) -> dict[str, float | None]:
    from nonsac.evaluation import rotation_error, translation_error

    if not result.found:
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
    wrote(folder, "source.ply, target.ply, and the true T.txt", quietly)
