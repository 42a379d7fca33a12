"""Register clouds, and matched points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nonsac.cli.inputs import check_table
from nonsac.cli.messages import tell, wrote
from nonsac.cli.options import (
    AnyWorkers,
    AsJson,
    Columns,
    Dataset,
    Inliers,
    LastFit,
    MaxMemory,
    MaxSamples,
    Quiet,
    Refine,
    Samples,
    SampleSizeOf3,
    Seed,
    TimeLimit,
    Transform,
    Workers,
    count_of,
    positive,
    scale_of,
    workers_of,
)
from nonsac.cli.options import scale as check_scale
from nonsac.cli.outputs import Draw, Outputs, exit_code, is_found, matrix_text, show, worth_writing
from nonsac.cli.rows import note_share, open_rows, opens_as_source, some_rows
from nonsac.cli.session import session

if TYPE_CHECKING:
    from nonsac.result import Array, Result
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


def register_clouds(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="Cloud to move (.ply, .pcd, .xyz, .npy, .las, ...).")
    ],
    target: Annotated[Path, typer.Argument(metavar="TARGET", help="Cloud that stays.")],
    samples: Annotated[int, typer.Option(min=1, help="Draw at most this many samples.")] = 40,
    sample_size: Annotated[int, typer.Option(min=3, help="Rows in each sample.")] = 2000,
    seed: Seed = 0,
    workers: Workers = None,
    output: Transform = None,
    save_aligned: Aligned = None,
    picture: Picture = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Register two raw point clouds: no matches, no descriptors, no initial guess.

    T maps the source to the target.
    """
    outputs = Outputs(transform=output, aligned=save_aligned, picture=picture)
    outputs.check([("SOURCE", source), ("TARGET", target)])
    with session(quiet, "samples") as progress:
        from nonsac.calls import clouds as calls
        from nonsac.io import read_cloud

        clouds = read_cloud(source), read_cloud(target)
        result = calls.register_clouds(
            *clouds, samples=samples, sample_size=sample_size, workers=workers, rng=seed, progress=progress
        )
    _finish(result, clouds, (source.name, target.name), outputs, as_json)


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
    noise: Annotated[
        float | None,
        typer.Option(
            callback=positive,
            show_default="measured",
            help="Standard deviation of a right match, in the unit of the data.",
        ),
    ] = None,
    scale: Annotated[
        str,
        typer.Option(callback=check_scale, metavar="free|FLOAT", help="Scale of T: known, or 'free' to estimate it."),
    ] = "1",
    samples: Samples = "auto",
    sample_size: SampleSizeOf3 = "auto",
    max_samples: MaxSamples = 100,
    time_limit: TimeLimit = None,
    max_memory: MaxMemory = None,
    refine: Refine = LastFit.polish,
    seed: Seed = 0,
    workers: AnyWorkers = None,
    output: Transform = None,
    save_aligned: Aligned = None,
    save_inliers: Inliers = None,
    picture: Picture = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Register matched points, most of which may be matched wrongly.

    T maps the source to the target.
    """
    pairs = Path(file)
    outputs = Outputs(transform=output, aligned=save_aligned, inliers=save_inliers, picture=picture)
    outputs.check([("PAIRS", pairs), ("SECOND", second)])
    is_table = second is None and (opens_as_source(file, columns, dataset) or pairs.suffix.lower() == ".parquet")
    check_table(is_table, columns, dataset, file)
    if is_table and save_aligned is not None:
        problem = f"{file} is read in pieces, never whole; write T with --output, and apply it"
        raise typer.BadParameter(problem, param_hint="'--save-aligned'")
    with session(quiet, "samples") as progress:
        from nonsac import layouts
        from nonsac.calls import pairs as calls
        from nonsac.io import read_pairs

        source = open_rows(file, layouts.PAIRS, columns, dataset) if is_table else None
        points = read_pairs(pairs, second) if source is None else some_rows(source, layouts.PAIRS, picture)
        given: tuple[Any, Any] = points if source is None else (source, None)
        result = calls.register_pairs(
            *given,
            noise=noise,
            scale=scale_of(scale),
            samples=count_of(samples),
            sample_size=count_of(sample_size),
            max_samples=max_samples,
            time_limit=time_limit,
            max_memory=max_memory,
            refine=refine.value,
            workers=workers_of(workers),
            rng=seed,
            progress=progress,
        )
    names = (pairs.name, second.name) if second else ("source", "target")
    note_share(source, picture, quiet)
    _finish(result, points, names, outputs, as_json)


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
    outputs.check([])
    with session(quiet, "samples") as progress:
        from nonsac import simulate
        from nonsac.calls import clouds as calls

        scans = simulate.demo_scans(seed)
        if save_scans is not None:
            _write_scans(save_scans, scans, as_json)
        result = calls.register_clouds(scans.source, scans.target, workers=workers, rng=seed, progress=progress)
    error = _errors(result, scans.T)
    if not as_json:
        tell(f"two scans of {len(scans.source):,} points, overlap {scans.overlap:.2f}, turned at random")
        if is_found(result):
            tell(f"off the truth by {error['rotation_deg']:.3f} deg and {error['translation']:.2g} in translation")
    more = {"truth": {"T": scans.T.tolist(), "overlap": scans.overlap}, "error": error}
    _finish(result, (scans.source, scans.target), ("source", "target"), outputs, as_json, more)


def _finish(
    result: Result,
    clouds: tuple[Array, Array],
    names: tuple[str, str],
    outputs: Outputs,
    as_json: bool,
    more: dict[str, Any] | None = None,
) -> None:
    show(result, _described(result, *names), more or {}, as_json)
    if outputs.aligned is not None and worth_writing(outputs.aligned, "the source moved by T", result):
        _write_aligned(outputs.aligned, result, clouds[0], as_json)
    outputs.write(result, _drawing(result, *clouds), as_json)
    raise exit_code(result)


def _write_aligned(path: Path, result: Result, source: Array, quietly: bool) -> None:
    from nonsac.io import write_cloud

    write_cloud(path, result.apply(source))
    wrote(path, f"the {len(source):,} source points moved by T", quietly)


def _drawing(result: Result, source: Array, target: Array) -> Draw | None:
    """What draws the clouds, unless one of them has no point to draw."""
    import numpy as np

    from nonsac import plot

    if not all(np.isfinite(cloud).all(axis=1).any() for cloud in (source, target)):
        return None
    return lambda path, title: plot.clouds(path, source, target, result.T, title)


def _described(result: Result, source: str, target: str) -> str:
    if not is_found(result):
        return repr(result)
    what = f"T, which moves {source} onto {target}; lengths are in the unit of the data"
    return f"{result!r}\n{what}:\n{matrix_text(result)}"


def _errors(result: Result, truth: Array) -> dict[str, float | None]:
    from nonsac.evaluation import rotation_error, translation_error

    if not is_found(result):
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
