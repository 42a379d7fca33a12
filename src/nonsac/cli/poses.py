"""Poses of cameras."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nonsac.cli.drawings import drawing_of_pair, drawing_of_points
from nonsac.cli.inputs import (
    blaming,
    check_geometry,
    check_pair,
    check_points,
    check_table,
    check_unit,
    choose_camera,
    choose_cameras,
    image_of,
    is_hdf5,
    model_files,
    read_pair,
    read_photo,
    read_points,
)
from nonsac.cli.messages import say, wrote
from nonsac.cli.options import (
    AnyWorkers,
    AsJson,
    Camera1,
    Camera2,
    Columns,
    Dataset,
    Inliers,
    LastFit,
    MaxMemory,
    MaxSamples,
    OneCamera,
    Photo,
    PoseNoise,
    Quiet,
    Refine,
    Samples,
    SampleSizeOf3,
    SampleSizeOf5,
    Seed,
    TimeLimit,
    Transform,
    count_of,
    workers_of,
)
from nonsac.cli.outputs import Outputs, exit_code, is_found, matrix_text, show
from nonsac.cli.rows import note_share, open_rows, opens_as_source, seen_there, some_rows
from nonsac.cli.session import session

if TYPE_CHECKING:
    from nonsac.cameras.camera import Camera
    from nonsac.io import Matches
    from nonsac.result import Result


def relative_pose(
    file: Annotated[
        str,
        typer.Argument(
            metavar="MATCHES",
            help="Matches of two images: a table (.npz, .npy, .csv, .txt, Parquet, Arrow, HDF5, Zarr; also a folder or "
            "URL), a COLMAP database (.db), or the features of hloc (.h5).",
        ),
    ],
    second: Annotated[
        Path | None, typer.Argument(metavar="SECOND", show_default=False, help="The matches of hloc (.h5).")
    ] = None,
    image1: Annotated[
        str | None, typer.Option(metavar="NAME", help="First image, of hloc or in a database (there also its number).")
    ] = None,
    image2: Annotated[str | None, typer.Option(metavar="NAME", help="Second image.")] = None,
    columns: Columns = None,
    dataset: Dataset = None,
    camera1: Camera1 = None,
    camera2: Camera2 = None,
    noise: PoseNoise = None,
    samples: Samples = "auto",
    sample_size: SampleSizeOf5 = "auto",
    max_samples: MaxSamples = 100,
    time_limit: TimeLimit = None,
    max_memory: MaxMemory = None,
    refine: Refine = LastFit.polish,
    seed: Seed = 0,
    workers: AnyWorkers = None,
    output: Transform = None,
    save_inliers: Inliers = None,
    write_geometry: Annotated[
        bool,
        typer.Option(
            "--write-geometry",
            help="Write pose and inliers into the COLMAP database, in place of its two-view geometry, if trusted.",
        ),
    ] = False,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Draw the matches, and epipolar lines (.png, .pdf or .svg). The lines are straight, "
            "which is right only without lens distortion.",
        ),
    ] = None,
    photo1: Photo = None,
    photo2: Photo = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Pose of a second camera relative to a first one, from matched points of which most may be wrong.

    T maps the first camera's frame to the second's; the length of its translation, which is unknown, is set to 1.

    Points and cameras need one convention for the centres of pixels (COLMAP's is 0.5 more than OpenCV's and hloc's).
    """
    matches, outputs = Path(file), Outputs(transform=output, inliers=save_inliers, picture=picture)
    inputs = [("MATCHES", matches), ("SECOND", second), ("--photo1", photo1), ("--photo2", photo2)]
    outputs.check([*inputs, ("--camera1", camera1), ("--camera2", camera2)])
    of_images = any((second, image1, image2)) or (is_hdf5(matches) and dataset is None and columns is None)
    is_table = not of_images and opens_as_source(file, columns, dataset)
    check_table(is_table, columns, dataset, file)
    images = None if is_table else check_pair(matches, second, image1, image2)
    if write_geometry:
        check_geometry(matches, images, (camera1, camera2))
    with session(quiet, "samples") as progress:
        from nonsac import io, layouts
        from nonsac.calls import poses

        source = open_rows(file, layouts.MATCHES, columns, dataset) if is_table else None
        if source is None:
            pair = read_pair(matches, second, images)
        else:
            pair = io.Matches(*some_rows(source, layouts.MATCHES, picture))
        cameras = choose_cameras((camera1, camera2), matches, pair)
        check_unit(pair.points1, noise, cameras[0], "--camera1")
        photo_of_1 = read_photo("--photo1", photo1, picture, cameras[0])
        photo_of_2 = read_photo("--photo2", photo2, picture, cameras[1])
        given: tuple[Any, Any] = (pair.points1, pair.points2) if source is None else (source, None)
        with blaming(matches):
            result = poses.relative_pose(
                *given,
                *cameras,
                noise=noise,
                weights=pair.weights,
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
    named = {"camera1": cameras[0], "camera2": cameras[1]}
    what = "T, from the frame of the first camera to that of the second; the unknown length of t is set to 1"
    show(result, _described(result, named, what), _texts(named), as_json)
    seen = seen_there(result, source, picture)
    outputs.write(result, drawing_of_pair(seen, pair, cameras, (photo_of_1, photo_of_2)), as_json)
    note_share(source, picture, quiet)
    if write_geometry and images is not None:
        _write_geometry(matches, images, result, pair, as_json)
    raise exit_code(result)


def absolute_pose(
    file: Annotated[
        str,
        typer.Argument(
            metavar="POINTS",
            help="Image points matched to 3D points: a table (.npz, .npy, .csv, .txt, Parquet, Arrow, HDF5, Zarr; also "
            "a folder or URL), or the folder of a COLMAP model.",
        ),
    ],
    image: Annotated[
        str | None, typer.Option(metavar="NAME", help="Image of the COLMAP model: its name or number.")
    ] = None,
    columns: Columns = None,
    dataset: Dataset = None,
    camera: OneCamera = None,
    noise: PoseNoise = None,
    samples: Samples = "auto",
    sample_size: SampleSizeOf3 = "auto",
    max_samples: MaxSamples = 100,
    time_limit: TimeLimit = None,
    max_memory: MaxMemory = None,
    refine: Refine = LastFit.polish,
    seed: Seed = 0,
    workers: AnyWorkers = None,
    output: Transform = None,
    save_inliers: Inliers = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw the points, and where T projects theirs (.png, .pdf or .svg)."),
    ] = None,
    photo: Photo = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Pose of a camera in the world (PnP), from image points matched to 3D points, of which most may be wrong.

    T maps the world to the frame of the camera.

    Points and camera need one convention for the centres of pixels (COLMAP's is 0.5 more than OpenCV's and hloc's).
    """
    points, outputs = Path(file), Outputs(transform=output, inliers=save_inliers, picture=picture)
    outputs.check([*model_files(points), ("--photo", photo), ("--camera", camera)])
    is_table = image is None and opens_as_source(file, columns, dataset)
    check_table(is_table, columns, dataset, file)
    if not is_table:
        check_points(points, image)
    with session(quiet, "samples") as progress:
        from nonsac import io, layouts
        from nonsac.calls import poses

        source = open_rows(file, layouts.POINTS, columns, dataset) if is_table else None
        if source is None:
            matches = read_points(points, image)
        else:
            matches = io.PointMatches(*some_rows(source, layouts.POINTS, picture))
        chosen = choose_camera(camera, points, "camera", matches.camera)
        check_unit(matches.points2d, noise, chosen, "--camera")
        background = read_photo("--photo", photo, picture, chosen)
        given: tuple[Any, Any] = (matches.points2d, matches.points3d) if source is None else (source, None)
        with blaming(points):
            result = poses.absolute_pose(
                *given,
                chosen,
                noise=noise,
                weights=matches.weights,
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
    named = {"camera": chosen}
    centre = (-result.R.T @ result.t).tolist() if is_found(result) else None
    what = "T, from the world to the frame of the camera"
    if centre is not None:
        what += f", which is at [{', '.join(f'{x:.6g}' for x in centre)}]"
    show(result, _described(result, named, what), {**_texts(named), "centre": centre}, as_json)
    seen = seen_there(result, source, picture)
    outputs.write(result, drawing_of_points(seen, matches, chosen, background), as_json)
    note_share(source, picture, quiet)
    raise exit_code(result)


# --- what is printed ---------------------------------------------------


def _described(result: Result, cameras: dict[str, Camera | None], what: str) -> str:
    lines = [repr(result)]
    lines += [f"{name}: {camera or 'none, the points are normalised'}" for name, camera in cameras.items()]
    return "\n".join([*lines, f"{what}:", matrix_text(result)] if is_found(result) else lines)


def _texts(cameras: dict[str, Camera | None]) -> dict[str, Any]:
    return {name: None if camera is None else str(camera) for name, camera in cameras.items()}


# --- what is written ---------------------------------------------------


def _write_geometry(path: Path, images: tuple[str, str], result: Result, matches: Matches, quietly: bool) -> None:
    import numpy as np

    from nonsac import io

    if not result.success:
        say(f"{path}: the two-view geometry is NOT WRITTEN: the answer is not trusted")
        return
    image1, image2 = map(image_of, images)
    inliers = np.asarray(matches.indices)[result.inliers]
    io.write_two_view_geometry(path, image1, image2, result.T, inliers)
    wrote(path, f"the two-view geometry of {' and '.join(images)}, {len(inliers):,} matches", quietly)
