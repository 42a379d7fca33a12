"""Poses of cameras."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nonsac.calls.registry import CALLS
from nonsac.cli.drawings import drawing_of_pair, drawing_of_points
from nonsac.cli.inputs import (
    Table,
    blaming,
    check_geometry,
    check_pair,
    check_points,
    check_unit,
    choose_camera,
    choose_cameras,
    image_of,
    model_files,
    read_photo,
)
from nonsac.cli.messages import to_stderr, wrote
from nonsac.cli.options import (
    POSE_HELPS,
    AsJson,
    Camera1,
    Camera2,
    Columns,
    Dataset,
    Hypotheses,
    Inliers,
    OneCamera,
    Photo,
    Quiet,
    Transform,
    takes_settings,
)
from nonsac.cli.outputs import Draw, Outputs, matrix_text
from nonsac.cli.run import Flow, Options, SomeRows, run

if TYPE_CHECKING:
    from nonsac.cameras.camera import Camera
    from nonsac.result import Result


@takes_settings("relative_pose", before="output", helps=POSE_HELPS)
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
    picture_hypotheses: Hypotheses = None,
    photo1: Photo = None,
    photo2: Photo = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    **settings: Any,
) -> None:
    """Pose of a second camera relative to a first one, from matched points of which most may be wrong.

    T maps the first camera's frame to the second's; the length of its translation, which is unknown, is set to 1.

    Points and cameras need one convention for the centres of pixels (COLMAP's is 0.5 more than OpenCV's and hloc's).
    """
    outputs = Outputs(output, inliers=save_inliers, picture=picture, hypotheses=picture_hypotheses)
    options = Options(settings, outputs, as_json, quiet)
    table = Table(file, second, (image1, image2), columns, dataset)
    run(_Pair(options, table, (camera1, camera2), (photo1, photo2), write_geometry), CALLS["relative_pose"], options)


@takes_settings("absolute_pose", before="output", helps=POSE_HELPS)
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
    output: Transform = None,
    save_inliers: Inliers = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw the points, and where T projects theirs (.png, .pdf or .svg)."),
    ] = None,
    picture_hypotheses: Hypotheses = None,
    photo: Photo = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    **settings: Any,
) -> None:
    """Pose of a camera in the world (PnP), from image points matched to 3D points, of which most may be wrong.

    T maps the world to the frame of the camera.

    Points and camera need one convention for the centres of pixels (COLMAP's is 0.5 more than OpenCV's and hloc's).
    """
    outputs = Outputs(output, inliers=save_inliers, picture=picture, hypotheses=picture_hypotheses)
    options = Options(settings, outputs, as_json, quiet)
    run(_Points(options, Table(file, None, (image,), columns, dataset), camera, photo), CALLS["absolute_pose"], options)


@dataclass
class _Pair(Flow):
    options: Options
    table: Table
    named_cameras: tuple[str | None, str | None]
    named_photos: tuple[Path | None, Path | None]
    write_geometry: bool

    def inputs(self) -> Iterable[tuple[str, str | Path | None]]:
        yield from (("MATCHES", self.table.file), ("SECOND", self.table.second))
        yield from zip(("--photo1", "--photo2"), self.named_photos, strict=True)
        yield from zip(("--camera1", "--camera2"), self.named_cameras, strict=True)

    def check(self) -> None:
        check_pair(self.table)
        if self.write_geometry:
            check_geometry(self.table, self.named_cameras)

    def open(self) -> tuple[Any, ...]:
        picture = self.options.outputs.picture
        self.opened = self.table.opened("MATCHES")
        self.some = SomeRows(self.opened, picture)
        self.points = self.table.parts("MATCHES", self.some.rows, len(self.some.source))
        self.cameras = choose_cameras(self.named_cameras, self.table.file, self.opened.cameras)
        check_unit(self.points[0], self.options.settings["noise"], self.cameras[0], "--camera1")
        self.photos = (
            read_photo("--photo1", self.named_photos[0], picture, self.cameras[0]),
            read_photo("--photo2", self.named_photos[1], picture, self.cameras[1]),
        )
        return self.opened.source, None, *self.cameras

    @contextmanager
    def estimating(self) -> Iterator[None]:
        with blaming(self.table.file):
            yield

    def described(self, result: Result) -> tuple[str, dict[str, Any]]:
        named = {"camera1": self.cameras[0], "camera2": self.cameras[1]}
        what = "T, from the frame of the first camera to that of the second; the unknown length of t is set to 1"
        return _described(result, named, what), _texts(named)

    def drawing(self, result: Result) -> Draw | None:
        first, second = self.points
        return drawing_of_pair(self.some.seen(result), first, second, self.cameras, self.photos)

    def finish(self, result: Result) -> None:
        self.some.note_share(self.options.quiet)
        if self.write_geometry:
            self._write_geometry(result)

    def _write_geometry(self, result: Result) -> None:
        import numpy as np

        from nonsac import io

        path, images = Path(self.table.file), [image for image in self.table.images if image is not None]
        if not result.success:
            to_stderr(f"{path}: the two-view geometry is NOT WRITTEN: the answer is not trusted")
            return
        image1, image2 = map(image_of, images)
        inliers = np.asarray(self.opened.indices)[result.inliers]
        io.write_two_view_geometry(path, image1, image2, result.T, inliers)
        told = f"the two-view geometry of {' and '.join(images)}, {len(inliers):,} matches"
        wrote(path, told, self.options.silent)


@dataclass
class _Points(Flow):
    options: Options
    table: Table
    named_camera: str | None
    named_photo: Path | None

    def inputs(self) -> Iterable[tuple[str, str | Path | None]]:
        yield from model_files(Path(self.table.file))
        yield from (("--photo", self.named_photo), ("--camera", self.named_camera))

    def check(self) -> None:
        check_points(self.table)

    def open(self) -> tuple[Any, ...]:
        picture = self.options.outputs.picture
        self.opened = self.table.opened("POINTS")
        self.some = SomeRows(self.opened, picture)
        self.points = self.table.parts("POINTS", self.some.rows, len(self.some.source))
        in_file = self.opened.cameras[0] if self.opened.cameras else None
        self.camera = choose_camera(self.named_camera, self.table.file, "camera", in_file)
        check_unit(self.points[0], self.options.settings["noise"], self.camera, "--camera")
        self.photo = read_photo("--photo", self.named_photo, picture, self.camera)
        return self.opened.source, None, self.camera

    @contextmanager
    def estimating(self) -> Iterator[None]:
        with blaming(self.table.file):
            yield

    def described(self, result: Result) -> tuple[str, dict[str, Any]]:
        named, what = {"camera": self.camera}, "T, from the world to the frame of the camera"
        centre = (-result.R.T @ result.t).tolist() if result.found else None
        if centre is not None:
            what += f", which is at [{', '.join(f'{x:.6g}' for x in centre)}]"
        return _described(result, named, what), {**_texts(named), "centre": centre}

    def drawing(self, result: Result) -> Draw | None:
        first, second = self.points
        return drawing_of_points(self.some.seen(result), first, second, self.camera, self.photo)

    def finish(self, result: Result) -> None:
        self.some.note_share(self.options.quiet)


def _described(result: Result, cameras: dict[str, Camera | None], what: str) -> str:
    lines = [repr(result)]
    lines += [f"{name}: {camera or 'none, the points are normalised'}" for name, camera in cameras.items()]
    return "\n".join([*lines, f"{what}:", matrix_text(result)] if result.found else lines)


def _texts(cameras: dict[str, Camera | None]) -> dict[str, Any]:
    return {name: None if camera is None else str(camera) for name, camera in cameras.items()}
