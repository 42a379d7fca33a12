"""Where many images were taken, in a model of COLMAP."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nonsac.calls.jobs import Job, may_end
from nonsac.calls.localization import Localization, LocalizedImage
from nonsac.calls.pair_records import warnings_told
from nonsac.calls.pooling import FIRST_PAIRS, PooledRun, pooled_noise
from nonsac.calls.run_arguments import (
    Progress,
    RunArguments,
    check_no_input,
    digest_of,
    settings_of_each,
    versions_of,
)
from nonsac.cameras.camera import Camera, CameraLike
from nonsac.cameras.unreadable import UnreadableCamera
from nonsac.files.errors import FilePath, in_one_line, input_error
from nonsac.io.camera_lists import cameras_of
from nonsac.io.colmap_pairs import DatabasePairs
from nonsac.io.colmap_whole_model import WholeModel
from nonsac.io.hloc_pairs import HlocPairs
from nonsac.io.matches import open_matches
from nonsac.io.poses import PosedImage, check_poses, write_poses
from nonsac.io.queries import QueryPairs
from nonsac.kernels.ahead import compile_for
from nonsac.layouts import POINTS
from nonsac.method.settings import shows_settings
from nonsac.running.executors import Workers
from nonsac.running.journal import Journal
from nonsac.running.many import pool_of, run_many
from nonsac.values.version import VERSION

Cameras = dict[str, Camera] | Camera | None


@shows_settings()
def localize(
    model: FilePath,
    *files: FilePath,
    output: FilePath,
    pairs: FilePath | None = None,
    cameras: FilePath | CameraLike | None = None,
    noise: float | None = None,
    workers: Workers = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
    **settings: Any,
) -> Localization:
    """Find where many images were taken (PnP), and write their poses.

    Parameters
    ----------
    model : path
        A COLMAP model: a folder such as sparse/0. Or, without `files`, a folder of tables of image points and the
        points that they show, one for each image, as `nonsac.open_source` reads them; the name of a file is that of
        its image.
    *files : path
        The features and the matches of hloc; or the database of COLMAP that the model was made of, to which the images
        were added and with which they were matched.
    output : path
        A file that ends in .txt, with a line ``name qw qx qy qz tx ty tz`` for each image that is found, as hloc has
        it; or a new folder, which becomes a COLMAP model of these images. Only answers that are to be trusted are
        written.
    pairs : path, optional
        For hloc, and if wanted for a database: the names of two images in each line, one of which is in the model.
    cameras : path or camera, optional
        hloc's list of queries with intrinsics (a name and a line of COLMAP's cameras.txt in each), or the camera of all
        images. By default all images that are not in the model, with the cameras of the database, or of the tables.
    noise : float, optional
        Standard deviation of an image point in each direction, in pixels; by default the first images measure it.
    workers, resume, overwrite, progress
        As for `nonsac.verify`.
    {others}
        As in `nonsac.absolute_pose`, for each image.

    Returns
    -------
    Localization

    Raises
    ------
    InputError
        If a file cannot be read or the output cannot be written, or they do not fit each other.
    ValueError, TypeError
        If an argument is out of its range; the message names it.
    """
    own = settings_of_each("localize", settings, noise)
    run = RunArguments(output, pairs, workers, resume, overwrite, progress)
    check_poses(output, overwrite)
    start = time.perf_counter()
    known = None if cameras is None else cameras_of(cameras)
    check_no_input(output, (*files, pairs, cameras))
    with _images(model, files, pairs, known, own) as images:
        header = {
            "images": digest_of(images.names),
            "files": digest_of(versions_of([model, *files, *([] if pairs is None else [pairs])])),
            "cameras": digest_of(_as_text(known)),
            "settings": {name: repr(value) for name, value in own.items()},
        }
        check = partial(_check_record, len(images.names))
        with Journal(run.journal, header | {"version": VERSION}, resume, "images", check) as kept:
            measured = _run(images, "noise" not in own, kept, run)
            found = tuple(map(LocalizedImage.of_record, kept.records()))
            write_poses(output, [_posed(image) for image in found if image.T is not None])
    run.journal.unlink()
    return Localization(found, measured if noise is None else noise, time.perf_counter() - start)


@dataclass(frozen=True, eq=False)
class _Images:
    """The names of images that are to be found, and the job of each."""

    names: Sequence[str]
    job: Callable[[str], Job]


def _as_text(cameras: Cameras) -> object:
    return {name: str(camera) for name, camera in cameras.items()} if isinstance(cameras, dict) else str(cameras)


@contextmanager
def _images(
    model: FilePath, files: Sequence[FilePath], pairs: FilePath | None, cameras: Cameras, own: dict[str, Any]
) -> Iterator[_Images]:
    named = list(cameras) if isinstance(cameras, dict) else None
    if not files:
        yield _of_tables(model, cameras, own)
    elif len(files) == 1:
        with DatabasePairs.open(files[0]) as source:
            found = QueryPairs.of(WholeModel.read(model), source, source.chosen(pairs)[0], named)
            yield _Images(list(found.pairs), partial(_job, found, cameras, own))
    elif len(files) == 2:
        if pairs is None or cameras is None:
            raise ValueError("files of hloc need pairs, a list of them, and cameras, which they do not hold")
        with HlocPairs.open(files[0], files[1], pairs, cameras) as hloc:
            found = QueryPairs.of(WholeModel.read(model), hloc, hloc.pairs, named)
            yield _Images(list(found.pairs), partial(_job, found, cameras, own))
    else:
        raise ValueError(f"files must be a database, or features and matches of hloc, got {len(files)} files")


def _job(queries: QueryPairs, cameras: Cameras, own: dict[str, Any], name: str) -> Job:
    points = queries.read(name)
    camera: Any = points.camera
    if isinstance(cameras, Camera):
        camera = str(cameras)
    elif cameras is not None:
        camera = str(cameras[name])
    elif not queries.has_known_focal_length(name):
        problem = f"the focal length of {name!r} is a guess of COLMAP's"
        camera = UnreadableCamera(input_error(queries.source.path, problem, "give its camera (--cameras)"))
    return Job("absolute_pose", points.points2d, points.points3d, name=name, **own, camera=camera)


def _of_tables(folder: FilePath, cameras: Cameras, own: dict[str, Any]) -> _Images:
    if not os.path.isdir(folder):
        raise input_error(folder, "is no folder of tables", "give the files of hloc, or a database, besides the model")
    if any(Path(folder, f"images{suffix}").exists() for suffix in (".bin", ".txt")):
        raise input_error(
            folder, "is a model, no folder of tables", "give the files of hloc, or a database, besides it"
        )
    by_name = {path.stem: path for path in sorted(Path(folder).iterdir()) if path.is_file()}
    if not by_name:
        raise input_error(folder, "holds no tables", "write the matches of each image into a file")
    names = [name for name in by_name if not isinstance(cameras, dict) or _of_list(cameras, name) is not None]

    def job(name: str) -> Job:
        camera = _of_list(cameras, name) if isinstance(cameras, dict) else cameras
        given = {} if camera is None else {"camera": camera}
        return Job("absolute_pose", by_name[name], name=name, **own, **given)

    return _Images(names, job)


def _of_list(cameras: dict[str, Camera], name: str) -> Camera | None:
    """The camera of an image, whose name may have been written without its suffix."""
    return cameras.get(name) or {Path(known).stem: camera for known, camera in cameras.items()}.get(name)


# --- the work ------------------------------------------------------------------------------


def _run(images: _Images, pools: bool, kept: Journal, run: RunArguments) -> float | None:
    """Do what is missing; returns the noise that the images share."""
    everything = range(len(images.names))
    first = everything[:FIRST_PAIRS] if pools else everything[:0]
    noise = None
    with pool_of(run.workers) as pool:
        for numbers in (first, everything):
            missing = [number for number in numbers if number not in kept]
            if missing:  # workers would each compile it for themselves
                compile_for("absolute_pose", noise)
            jobs = (images.job(images.names[number]) for number in missing)
            outcomes = run_many(_Localize(noise), jobs, pool, apart=may_end, together=True)
            for number, (job, outcome) in zip(missing, outcomes, strict=True):
                kept.add(number, outcome if isinstance(outcome, dict) else _failure(job, outcome))
                run.tell(kept.count, len(images.names))
            if numbers is first:
                measured = (record["noise"] for record in kept.records(first) if record["status"] == "ok")
                noise = pooled_noise(measured)
    return noise


@dataclass(frozen=True)
class _Localize:
    """Finds where an image was taken, where it is sent to."""

    noise: float | None

    def __call__(self, job: Job) -> dict[str, Any]:
        camera = Camera.parse(_camera_of(job))
        with warnings_told() as told:
            result = PooledRun(self.noise)(job)
        measured = result.info.get("measured_noise", result.noise)
        return LocalizedImage(
            job.name,
            str(result.status),
            result.T if result.success else None,
            result.num_rows,
            result.num_inliers,
            result.confidence,
            float(measured) if np.isfinite(measured) else None,
            (*result.remarks, *told),
            camera=str(camera),
        ).to_dict()


def _camera_of(job: Job) -> CameraLike:
    """That of the job, or of the table that it reads."""
    camera = job.settings.get("camera")
    if camera is None and isinstance(job.data[0], (str, os.PathLike)):
        (camera,) = open_matches(POINTS, job.data).cameras
    if camera is None:
        raise ValueError("there is no camera; give it with cameras (--cameras)")
    return camera


def _failure(job: Job, error: Exception) -> dict[str, Any]:
    return LocalizedImage(job.name, "failed", error=in_one_line(error)).to_dict()


def _posed(image: LocalizedImage) -> PosedImage:
    return PosedImage(image.name, Camera.parse(str(image.camera)), np.asarray(image.T))


def _check_record(count: int, position: int, record: Any) -> None:
    if not 0 <= position < count:
        raise ValueError("an image")
    LocalizedImage.of_record(record)
